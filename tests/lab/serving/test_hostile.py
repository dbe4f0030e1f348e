"""Hostile messages and packets: few here, a million in `bench live-fuzz` and `bench packet-fuzz`."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("prometheus_client", reason="needs packages/live")
from bodysense_lab.serving.hostile_clients import FuzzCounts, run_fuzz
from bodysense_lab.serving.hostile_packets import fuzz_packets


def test_hostile_clients_are_refused_and_others_are_served() -> None:
    counts = FuzzCounts()
    run_fuzz(3_000, 1, counts)
    assert counts.errors == [] and counts.frames >= 3_000
    assert 0 < counts.refused <= counts.connections
    assert counts.watched > 1 and counts.answered > 5


def test_hostile_packets_of_every_protocol_raise_nothing() -> None:
    found = fuzz_packets(3000, np.random.default_rng(3))
    assert set(found) == {"vmc", "vmt", "vrchat", "solarxr input", "slimevr", "solarxr"} and sum(found.values()) == 3000
