"""The upward axis by evidence: rest pose, floor contact, and the file's word, over turned and lying motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from people.made import LYING, lying_clip

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.observing.world import (
    AXES,
    REST_POSE,
    USUAL,
    Upward,
    check_overruled,
    clearance_of,
    doubts,
    judged_up,
    moments,
    told_warning,
)
from bodysense.observing.world_axes import TURNS, UpAxis


@pytest.fixture(scope="module")
def performance() -> Clip:
    """Standing, gestures, sitting down and steps."""
    return packaged_performance()


def judged(clip: Clip, axis: UpAxis, words: dict[UpAxis, float] | None = None) -> Upward:
    """Judge a motion written with `axis` up."""
    place = np.asarray(forward_kinematics(clip.pose)[0])[:, clip.pose.skeleton.indices(BODY)]
    place = quaternion_rotate(np.broadcast_to(quaternion_conjugate(TURNS[axis]), (*place.shape[:-1], 4)), place)
    first, later, moment = moments(len(place), clip.frame_rate)
    at = {name: place[:, BODY.index(name)] for name in BODY}
    body = at["left_shoulder"] + at["right_shoulder"] - at["left_ankle"] - at["right_ankle"]
    return judged_up(place[first], place[later], moment, body[first], clearance=clearance_of(BODY), words=words)


@pytest.mark.parametrize("axis", AXES)
def test_every_axis_is_found_without_a_word(performance: Clip, axis: UpAxis) -> None:
    found = judged(performance, axis)
    assert found.axis == axis and not found.is_unsure and found.word is None
    assert doubts(found, "the file") == []


@pytest.mark.parametrize("axis", ["z", "-z", "x"])
def test_steps_overrule_the_usual_axis_and_a_rest_pose(performance: Clip, axis: UpAxis) -> None:
    usual = judged(performance, axis, {"y": USUAL})
    assert usual.axis == axis and usual.is_against_the_file
    check_overruled("take.trc", usual)  # clearly enough
    rest = judged(performance, axis, {"y": REST_POSE})
    assert rest.axis == axis
    assert "give --up y" in doubts(rest, "its rest pose")[0]


@pytest.mark.parametrize("how", LYING)
def test_a_lying_body_keeps_the_axis_of_its_rest_pose(how: str) -> None:
    found = judged(lying_clip(how), "y", {"y": REST_POSE})
    assert found.axis == "y"
    assert "is taken as up, as its rest pose has it" in doubts(found, "its rest pose")[0]


def test_a_doubtful_overruling_is_refused() -> None:
    found = Upward("z", margin=0.4, other="y", stands=0.9, word="y")
    with pytest.raises(BodysenseError, match=r"prone\.trc: .* give the upward axis, --up z or --up y"):
        check_overruled("prone.trc", found)


def test_a_given_axis_is_checked(performance: Clip) -> None:
    motion = judged(performance, "y")
    assert told_warning("y", motion) == []
    assert told_warning("z", motion) == ["--up z: the body stands along +Y, not +Z; leave it out, or give --up y"]


@pytest.mark.parametrize("word", ["y", "z"])
@pytest.mark.parametrize("forward", [-0.4, -0.1, 0.0, 0.1, 0.4])
def test_one_frame_overrules_a_rest_pose_or_warns(performance: Clip, word: UpAxis, forward: float) -> None:
    """A standing body, which could lie on a floor at 0 where its back or its toes are near the origin."""
    first = performance.pose[:1]
    place = first.root_position * [0, 1, 0] + [0, 0, forward]
    one = Clip("one", replace(first, root_position=place), performance.frame_rate)
    axis: UpAxis = "z" if word == "y" else "y"
    found = judged(one, axis, {word: REST_POSE})
    assert found.axis == axis or f"--up {axis}" in doubts(found, "its rest pose")[0]
    assert found.axis == axis or abs(forward) == 0.1


@pytest.mark.parametrize("how", LYING)
def test_one_frame_of_a_lying_body_keeps_the_axis_of_its_rest_pose(how: str) -> None:
    lying = lying_clip(how)
    for k in range(0, len(lying.pose.root_position), 10):
        found = judged(Clip("one", lying.pose[k : k + 1], lying.frame_rate), "y", {"y": REST_POSE})
        assert found.axis == "y", k


def test_one_frame_has_moments() -> None:
    first, later, moment = moments(1, 30.0)
    assert first.tolist() == later.tolist() == [0] and moment > 0
