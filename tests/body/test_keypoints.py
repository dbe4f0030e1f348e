"""Key-points of arms, torso and hands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.arms import ARM_JOINTS, with_arms
from bodysense.body.keypoints import (
    ArmKeypoints,
    arm_directions,
    arms_from_torso,
    body_torso,
    check_keypoints,
    torso_rotation,
)
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip


def keypoints(frames: int = 4) -> ArmKeypoints:
    rng = np.random.default_rng(0)
    arm = rng.standard_normal((frames, 2, 2, 3))
    torso = rng.standard_normal((frames, 4))
    return ArmKeypoints(
        time=np.arange(frames) / 30,
        arm=arm / np.linalg.norm(arm, axis=-1, keepdims=True),
        has_arm=np.ones((frames, 2), dtype=bool),
        torso=torso / np.linalg.norm(torso, axis=-1, keepdims=True),
        has_torso=np.ones(frames, dtype=bool),
        hand=rng.standard_normal((frames, 2, 21, 2)),
        has_hand=np.ones((frames, 2), dtype=bool),
    )


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_a_torso_turns_with_the_body(batch: tuple[int, ...]) -> None:
    """SciPy turns a trunk whose axes are the world's; what is found is that turn."""
    turn = Rotation.random(int(np.prod(batch, dtype=int)), rng=np.random.default_rng(1))
    shoulders, hips = np.array([[0.2, 0.5, 0], [-0.2, 0.5, 0]]), np.array([[0.1, 0, 0], [-0.1, 0, 0]])
    turned = [
        np.stack([turn.apply(point) for point in points], axis=1).reshape(*batch, 2, 3) + np.array([1.0, 2, 3])
        for points in (shoulders, hips)
    ]
    found = torso_rotation(turned[0], turned[1])
    assert found.shape == (*batch, 4)
    wanted = turn.as_quat(canonical=True, scalar_first=True).reshape(*batch, 4)
    np.testing.assert_allclose(np.abs((found * wanted).sum(axis=-1)), 1, atol=1e-12)


def test_the_left_hand_of_a_person_facing_the_camera_is_on_the_right() -> None:
    facing = torso_rotation(np.array([[0.2, 0.5, 0], [-0.2, 0.5, 0]]), np.array([[0.1, 0, 0], [-0.1, 0, 0]]))
    np.testing.assert_allclose(facing, [1, 0, 0, 0], atol=1e-12)


def test_directions_are_of_unit_length_along_the_bones() -> None:
    points = np.array([[0.0, 0, 0], [0.3, 0, 0], [0.3, -0.2, 0]])
    np.testing.assert_allclose(arm_directions(points), [[1, 0, 0], [0, -1, 0]], atol=1e-12)


def test_good_key_points_pass_and_hidden_values_may_be_anything() -> None:
    good = keypoints()
    good.hand[1, 0], good.has_hand[1, 0] = np.nan, False
    good.arm[2, 1], good.has_arm[2, 1] = 7.0, False
    assert check_keypoints(good) is good


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": np.array([0.0, 0.1, 0.1, 0.2])}, r"time goes from 0\.1 s to 0\.1 s at frame 2"),
        ({"time": np.array([0.0, np.nan, 0.1, 0.2])}, "a time is not a number"),
        ({"time": np.zeros((4, 1))}, r"time has shape \(4, 1\)"),
        ({"arm": np.zeros((4, 2, 3, 3))}, r"arm has shape \(4, 2, 3, 3\); 4 frames need \(4, 2, 2, 3\)"),
        ({"hand": np.full((4, 2, 21, 2), np.nan)}, "has_hand is set where hand is not finite"),
        ({"torso": np.full((4, 4), 1.0)}, "torso has length 2"),
        ({"arm": np.full((4, 2, 2, 3), 3**-0.5) * np.array([1.0, 2])[:, None]}, "arm has length 2"),
    ],
)
def test_invalid_key_points_are_refused_by_name(change: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(BodysenseError, match=message):
        check_keypoints(replace(keypoints(), **change))


def test_arms_from_the_torso_keep_their_world_rotations(waving_clip: Clip) -> None:
    """On a body whose chest stands in the torso as at rest, they turn all arm joints as the pose turns them."""
    pose = waving_clip.pose[::9]
    skeleton, bent = pose.skeleton, pose.rotation.copy()
    bent[:, skeleton.index("spine2")] = [np.cos(0.15), np.sin(0.15), 0, 0]  # a chest that leans forward
    pose = Pose(skeleton, pose.root_position, bent)
    torso = Rotation.from_quat(body_torso(pose), scalar_first=True)
    at_rest = Rotation.from_quat(body_torso(rest_pose(skeleton)), scalar_first=True)
    body = rest_pose(skeleton, (len(bent),))
    body.rotation[:, 0] = (torso * at_rest.inv()).as_quat(scalar_first=True)
    ours = forward_kinematics(with_arms(body, arms_from_torso(pose)))[1]
    places = skeleton.indices(ARM_JOINTS)
    assert geodesic_angle(ours[:, places], forward_kinematics(pose)[1][:, places]).max() < 1e-6
