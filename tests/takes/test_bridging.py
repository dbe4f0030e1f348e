"""Bridging: brief gaps are interpolated, others and known frames are unchanged."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.devices.simulated.noise import hide
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp
from bodysense.observing.observation import Observation
from bodysense.takes.bridging import DRIFT, LONGEST, bridge_gaps

SECONDS = 1 / 30
MOST = round(LONGEST / SECONDS)
FRAMES = 60


def moving(frames: int = FRAMES) -> Observation:
    """A head on a straight line and a wrist on a parabola, both turning evenly about +Y."""
    time = np.arange(frames) * SECONDS
    turn = np.zeros((frames, 2, 3))
    turn[:, :, 1] = (1.5 * time - 1)[:, None]
    position = np.zeros((frames, 2, 3))
    position[:, 0, 0], position[:, 0, 1] = 1.2 * time, 1.6
    position[:, 1, 2], position[:, 1, 1] = 0.8 * time, 1 + 2 * (time - 1) ** 2
    seen = np.ones((frames, 2), dtype=bool)
    return Observation(
        points=("head", "left_wrist"),
        position=position,
        rotation=quaternion_exp(turn),
        has_position=seen,
        has_rotation=seen.copy(),
        accuracy=np.full((frames, 2), 0.002),
        time=time,
    )


def without(seen: Observation, point: int, *frames: int) -> Observation:
    hidden = np.zeros(seen.has_position.shape, dtype=bool)
    hidden[list(frames), point] = True
    return hide(seen, hidden)


@pytest.mark.parametrize("count", [1, 2, MOST])
def test_a_brief_gap_is_bridged(count: int) -> None:
    whole = moving()
    gap = range(20, 20 + count)
    for point, most in ((0, 1e-9), (1, 0.004)):
        found = bridge_gaps(without(whole, point, *gap), SECONDS)
        assert found.has_position.all() and found.has_rotation.all()
        assert np.abs(found.position - whole.position).max() < most
        assert geodesic_angle(found.rotation, whole.rotation).max() < 1e-6


def test_a_longer_gap_is_not_bridged() -> None:
    seen = without(moving(), 1, *range(20, 21 + MOST))
    found = bridge_gaps(seen, SECONDS)
    np.testing.assert_array_equal(found.has_position, seen.has_position)
    np.testing.assert_array_equal(found.position, seen.position)


def test_gaps_at_beginning_and_end_are_not_bridged() -> None:
    seen = without(moving(), 0, 0, 1, FRAMES - 1)
    np.testing.assert_array_equal(bridge_gaps(seen, SECONDS).has_position, seen.has_position)


def test_a_point_seen_in_every_other_frame_is_bridged() -> None:
    whole = moving()
    found = bridge_gaps(without(whole, 1, *range(1, FRAMES - 1, 2)), SECONDS)
    assert found.has_position[1:-1].all() and np.abs(found.position - whole.position)[1:-1].max() < 0.004


def test_the_middle_of_a_gap_is_least_certain() -> None:
    found = bridge_gaps(without(moving(), 1, *range(20, 25)), SECONDS)
    expected = 0.002 + DRIFT * SECONDS * np.array([1, 2, 3, 2, 1])
    np.testing.assert_allclose(found.accuracy[20:25, 1], expected)
    np.testing.assert_array_equal(found.accuracy[:, 0], 0.002)


def test_gaps_are_counted_in_seconds() -> None:
    seen = without(moving(), 1, *range(20, 20 + MOST))
    assert not bridge_gaps(seen, 2 * SECONDS).has_position.all()
    assert not bridge_gaps(seen, SECONDS, longest=LONGEST / 2).has_position.all()


@settings(max_examples=40, deadline=None)
@given(st.lists(st.booleans(), min_size=2, max_size=40), st.integers(0, 2**32 - 1))
def test_known_frames_are_unchanged(known: list[bool], seed: int) -> None:
    rng = np.random.default_rng(seed)
    hidden = np.flatnonzero(~np.array(known))
    seen = without(moving(len(known)), int(rng.integers(2)), *hidden.tolist())
    found = bridge_gaps(seen, SECONDS)
    for name, has in (("position", "has_position"), ("rotation", "has_rotation")):
        before = getattr(seen, has)
        np.testing.assert_array_equal(getattr(found, name)[before], getattr(seen, name)[before])
        assert (getattr(found, has) | ~before).all() and np.isfinite(getattr(found, name)[getattr(found, has)]).all()
