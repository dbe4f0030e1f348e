"""Hostile messages and packets: other clients are still served, and nothing is raised."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("prometheus_client", reason="needs packages/live")
from .hostile_clients import FuzzCounts, run_fuzz
from .hostile_packets import fuzz_packets

PROTOCOLS = {"vmc", "vmt", "vrchat", "slimevr", "solarxr", "solarxr input", "solarxr requests", "solarxr driver"}
FEW_AND_MANY = [3_000, pytest.param(20_000, marks=pytest.mark.slow)]


@pytest.mark.parametrize("frames", FEW_AND_MANY)
def test_hostile_clients_are_refused_and_others_are_served(frames: int) -> None:
    counts = FuzzCounts()
    run_fuzz(frames, frames, counts)
    assert counts.errors == [] and counts.frames >= frames
    assert 0 < counts.refused <= counts.connections
    assert counts.watched > 1 and counts.answered > 5


@pytest.mark.parametrize("packets", FEW_AND_MANY)
def test_hostile_packets_of_every_protocol_raise_nothing(packets: int) -> None:
    counts = fuzz_packets(packets, np.random.default_rng(packets))
    assert set(counts) == PROTOCOLS
    assert sum(counts.values()) == packets
