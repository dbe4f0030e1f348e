"""The mean body reproduces the bodies that it was fitted on, also at other sizes and headings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import Clip, at_height
from bodysense.io.formats.bvh import write_bvh
from bodysense_lab.completion.score.baselines import cached_mean_body, fit_mean_body

SKELETON = default_skeleton()


def posed(drop: float, bend: float) -> Clip:
    """Return two seconds of a still standing body, lowered by `drop` m, with knees bent by `bend` radians."""
    pose = standing_pose(SKELETON)
    turn = [np.cos(bend / 2), np.sin(bend / 2), 0.0, 0.0]
    pose.rotation[SKELETON.indices(["left_knee", "right_knee"])] = turn
    root = np.tile(pose.root_position - [0.0, drop, 0.0], (60, 1))
    return Clip("posed", Pose(SKELETON, root, np.tile(pose.rotation, (60, 1, 1))), 30.0)


def turned(clip: Clip, angle: float) -> Clip:
    """Return the clip turned about +Y at the origin."""
    yaw, rotation = quaternion_exp(np.array([0.0, angle, 0.0])), clip.pose.rotation.copy()
    rotation[:, 0] = quaternion_multiply(yaw, rotation[:, 0])
    return replace(clip, pose=Pose(clip.pose.skeleton, quaternion_rotate(yaw, clip.pose.root_position), rotation))


def test_the_height_of_the_head_gives_the_legs() -> None:
    standing, sitting = posed(0.0, 0.0), posed(0.5, 1.5)
    body = fit_mean_body([standing, sitting])
    head = SKELETON.index("head")
    for clip in (standing, turned(standing, 2.0), at_height(sitting, 1.5), turned(at_height(sitting, 1.9), -1.0)):
        position, rotation = forward_kinematics(clip.pose)
        found = body.positions(position[:, head], rotation[:, head], clip.pose.skeleton)
        np.testing.assert_allclose(found, position, atol=0.02)
        np.testing.assert_allclose(found[:, head], position[:, head], atol=1e-9)


def test_heads_outside_the_training_motion_have_a_body(waving_clip: Clip) -> None:
    body = fit_mean_body([waving_clip])
    heads = np.array([[0.0, -3.0, 0.0], [1.0, 9.0, 2.0], [0.0, 1.0, 0.0]])
    found = body.positions(heads, np.tile([0.6, 0.8, 0.0, 0.0], (3, 1)), SKELETON)
    assert np.isfinite(found).all() and np.abs(found - heads[:, None]).max() < 3
    with pytest.raises(BodysenseError, match="needs motion"):
        fit_mean_body([])


def test_the_mean_body_is_cached(tmp_path: Path, waving_clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    people = ("anna", "ben", "cleo", "dora", "emil", "fay", "gus", "hana")  # most of them are of the train split
    for person in people:
        (tmp_path / "motion" / person).mkdir(parents=True)
        write_bvh(tmp_path / "motion" / person / "a.bvh", replace(waving_clip, pose=waving_clip.pose[:20]))
    read: list[Clip] = []
    first = cached_mean_body(tmp_path / "motion", read.append)
    again = cached_mean_body(tmp_path / "motion", lambda clip: pytest.fail("was read again"))
    assert first is not None and again is not None and 0 < len(read) <= len(people)
    np.testing.assert_array_equal(first.place, again.place)
    (tmp_path / "empty").mkdir()
    assert cached_mean_body(tmp_path / "empty") is None
