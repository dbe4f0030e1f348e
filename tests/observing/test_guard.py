"""The guard of live input: right worlds give no notice, wrong ones name the fix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bodysense.demo import packaged_performance
from bodysense.devices.simulated.device import simulate
from bodysense.observing.guard import world_notices
from bodysense.observing.observation import Observation
from bodysense.tracking.tracker import Tracker, TrackerSettings


@pytest.fixture(scope="module")
def seen() -> Observation:
    return simulate(packaged_performance(), "headset_camera")[:60]


def moved(seen: Observation, change: Callable[[np.ndarray], np.ndarray]) -> Observation:
    return Observation(
        seen.points,
        change(seen.position),
        seen.rotation,
        seen.has_position,
        seen.has_rotation,
        seen.accuracy,
        seen.time,
    )


def test_right_worlds_give_no_notice(seen: Observation) -> None:
    assert world_notices(seen, 0.0) == ()
    assert world_notices(moved(seen, lambda place: place + np.array([0, 0.5, 0])), 0.5) == ()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda place: place[..., [0, 2, 1]] * [1, -1, 1], "up='z'"),
        (lambda place: place / 0.3048, "unit='ft'"),
        (lambda place: place - np.array([0, 1.6, 0]), "TrackerSettings(floor=-1.6)"),
    ],
)
def test_wrong_worlds_name_the_fix(seen: Observation, change: Callable[[np.ndarray], np.ndarray], said: str) -> None:
    assert any(said in notice for notice in world_notices(moved(seen, change), 0.0))


def test_points_of_other_people_and_exchanged_hands(seen: Observation) -> None:
    left, right = (seen.points.index(f"{side}_wrist") for side in ("left", "right"))
    far = seen.position.copy()
    far[:, left] += [3.0, 0, 0]
    assert any("left_wrist is" in notice for notice in world_notices(moved(seen, lambda _: far), 0.0))
    apart = seen.position.copy()
    head = apart[:, seen.points.index("head")]
    apart[:, left], apart[:, right] = head - np.array([0.5, 0.3, 0]), head + np.array([0.5, -0.3, 0])
    crossed = moved(seen, lambda _: apart)
    crossed.has_position[:, [left, right]] = True
    crossed.rotation[:, seen.points.index("head")] = [1, 0, 0, 0]
    assert any("exchange them" in notice for notice in world_notices(crossed, 0.0))


def test_the_tracker_asks_once_for_a_state(seen: Observation) -> None:
    tracker = Tracker(settings=TrackerSettings())
    high = moved(seen, lambda place: place / 0.3048)
    first, state = tracker.step(high[:1], tracker.start())
    again, state = tracker.step(high[1:2], state)
    assert first.notices and again.notices == ()
    late = replace(high[2:3], time=high.time[2:3] + 16.7)
    assert any("milliseconds" in notice for notice in tracker.step(late, state)[0].notices)
