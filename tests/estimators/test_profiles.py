"""Profiles: what arrives decides, with patience both ways."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.glove import glove_points
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.estimators.profiles import PROFILES, Arrivals, Profile, ProfileSettings, arrived, kinds_of, profile_of
from bodysense.estimators.pulled import TRACKERS
from bodysense.observation import Observation
from bodysense.occlusion.three_point import POINTS

SETTINGS = ProfileSettings()
FINGERS = tuple(name for name in default_skeleton().points if name.startswith(("left_index", "right_thumb")))
SIGNALS: dict[Profile, tuple[str, ...]] = {
    "head": ("head",),
    "three-point": POINTS,
    "hands": (*POINTS, *FINGERS),
    "trackers": (*POINTS, *FINGERS, *TRACKERS),
    "headset-camera": default_skeleton().points,
    "gloves": (*POINTS, "pelvis", *glove_points("left")),
}


def frame(points: tuple[str, ...], time: float, hidden: tuple[str, ...] = ()) -> Observation:
    known = np.array([[name not in hidden for name in points]])
    count = len(points)
    return Observation(
        points=points,
        position=np.zeros((1, count, 3)),
        rotation=np.zeros((1, count, 4)),
        has_position=known,
        has_rotation=np.zeros_like(known),
        accuracy=np.full(known.shape, 0.001),
        time=np.array([time]),
    )


@pytest.mark.parametrize("profile", PROFILES)
def test_what_is_there_at_first_counts_at_once(profile: Profile) -> None:
    points = SIGNALS[profile]
    assert profile_of(arrived(frame(points, 0.0), Arrivals(), SETTINGS), SETTINGS) == profile
    # Points that are named and not tracked make no profile.
    nothing = arrived(frame(points, 0.0, hidden=points), Arrivals(), SETTINGS)
    assert profile_of(nothing, SETTINGS) == "head"


def test_what_comes_later_counts_after_a_while_and_is_missed_after_a_while() -> None:
    """Fingers come at 1 s, go at 2 s, with a hole of 0.3 s in between that nobody sees."""
    points, arrivals, told = SIGNALS["hands"], Arrivals(), []
    times = np.arange(0, 3, 1 / 90)
    for time in times:
        there = 1 <= time < 2 and not 1.5 < time < 1.8
        arrivals = arrived(frame(points, float(time), () if there else FINGERS), arrivals, SETTINGS)
        told.append(profile_of(arrivals, SETTINGS))
    found = times[[profile == "hands" for profile in told]]
    assert found[0] == pytest.approx(1 + SETTINGS.appears, abs=0.02)
    assert found[-1] == pytest.approx(2 + SETTINGS.holds, abs=0.02)
    assert len(found) == round((found[-1] - found[0]) * 90) + 1
    assert set(told) == {"three-point", "hands"}


def test_a_glimpse_is_no_profile() -> None:
    points, arrivals = SIGNALS["trackers"], Arrivals()
    for k in range(60):
        hidden = () if k == 30 else (*FINGERS, *TRACKERS)
        arrivals = arrived(frame(points, k / 60, hidden), arrivals, SETTINGS)
        if k < 30 + SETTINGS.appears * 60 - 1:
            assert profile_of(arrivals, SETTINGS) == "three-point"


def test_joints_that_nobody_wears_trackers_at_are_seen_by_cameras() -> None:
    assert set(kinds_of(("head", "left_elbow"))) == {"trackers"}
    assert set(kinds_of(("head", "left_elbow", "left_shoulder", "left_index1"))) == {"cameras"}
    assert kinds_of(("head", "somebody's hat")) == {}


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(BodysenseError, match="profile settings: holds is -1; it must be 0 or more"):
        ProfileSettings(holds=-1)
