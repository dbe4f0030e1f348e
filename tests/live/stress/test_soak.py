"""Wearers over a bad network: sessions answer, resume and stay small."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("prometheus_client", reason="needs packages/live")
from ..conftest import free_port, storing
from .soak import SoakPlan, faults, soak

pytestmark = [pytest.mark.slow, pytest.mark.alone]


def test_wearers_over_a_bad_network_are_answered_and_resume() -> None:
    plan = SoakPlan(sessions=4, seconds=25.0, seconds_connected=5.0)
    counts = soak(plan, np.random.default_rng(1))
    assert faults(counts, plan) == []
    assert counts.breaks > 2 and counts.resumed > 2
    assert counts.answered > 0.7 * counts.sent


def test_wearers_of_killed_processes_resume_in_another() -> None:
    with storing(free_port()) as address:
        plan = SoakPlan(sessions=4, seconds=25.0, workers=2, shared=address, seconds_between_kills=10.0)
        counts = soak(plan, np.random.default_rng(2))
    assert faults(counts, plan) == []
    assert counts.killed >= 2 and counts.resumed > 2
