"""Headset and controllers: head and wrists as forward kinematics has them, controllers rigid on their wrists."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_exp
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated.three_point import POINTS, ThreePoint, observe
from bodysense.errors import BodysenseError
from bodysense.io.augment import mirrored
from bodysense.io.clip import Clip
from bodysense.observation import check_observation

SKELETON = default_skeleton()
GRIP = ThreePoint((0.07, -0.02, 0.03), tuple(quaternion_exp(np.array([0.3, -0.5, 0.8])).tolist()))


def turns(quaternions: np.ndarray) -> Rotation:
    return Rotation.from_quat(quaternions[..., [1, 2, 3, 0]])


@pytest.mark.parametrize("batch", [(), (2, 3)])
def test_the_points_are_head_and_wrists(waving_clip: Clip, batch: tuple[int, ...]) -> None:
    pose = Pose(
        SKELETON,
        np.broadcast_to(waving_clip.pose.root_position, (*batch, 90, 3)),
        np.broadcast_to(waving_clip.pose.rotation, (*batch, 90, 52, 4)),
    )
    seen = check_observation(observe(pose, waving_clip.time))
    assert seen.points == ("head", "left_wrist", "right_wrist") and seen.position.shape == (*batch, 90, 3, 3)
    assert seen.has_position.all() and seen.has_rotation.all() and (seen.rotation[..., 0] >= 0).all()
    position, rotation = forward_kinematics(pose)
    places = SKELETON.indices(POINTS)
    np.testing.assert_allclose(seen.position, position[..., places, :], atol=1e-12)
    apart = turns(seen.rotation.reshape(-1, 4)) * turns(rotation[..., places, :].reshape(-1, 4)).inv()
    assert apart.magnitude().max() < 1e-9
    np.testing.assert_array_equal(seen.time, waving_clip.time)


def test_a_grip_is_rigid(waving_clip: Clip) -> None:
    """The controller's place in the left wrist's frame is the grip in every frame."""
    wrist, held = observe(waving_clip.pose, waving_clip.time), observe(waving_clip.pose, waving_clip.time, GRIP)
    turn = turns(wrist.rotation[:, 1])
    place = turn.inv().apply(held.position[:, 1] - wrist.position[:, 1])
    np.testing.assert_allclose(place, np.tile(GRIP.grip_position, (90, 1)), atol=1e-9)
    apart = turns(np.array(GRIP.grip_rotation)).inv() * turn.inv() * turns(held.rotation[:, 1])
    assert apart.magnitude().max() < 1e-9
    np.testing.assert_array_equal(held.position[:, 0], wrist.position[:, 0])
    np.testing.assert_array_equal(held.rotation[:, 0], wrist.rotation[:, 0])


def test_the_right_grip_is_the_mirror_image_of_the_left(waving_clip: Clip) -> None:
    seen = observe(waving_clip.pose, waving_clip.time, GRIP)
    other = observe(mirrored(waving_clip).pose, waving_clip.time, GRIP)
    np.testing.assert_allclose(other.position, seen.position[:, [0, 2, 1]] * [-1, 1, 1], atol=1e-12)
    expected = turns((seen.rotation[:, [0, 2, 1]] * [1, 1, -1, -1]).reshape(-1, 4))
    assert (turns(other.rotation.reshape(-1, 4)) * expected.inv()).magnitude().max() < 1e-9


def test_what_cannot_be_is_refused(waving_clip: Clip) -> None:
    with pytest.raises(BodysenseError, match="grip_rotation has length 2; give a unit quaternion"):
        ThreePoint(grip_rotation=(2.0, 0.0, 0.0, 0.0))
    with pytest.raises(BodysenseError, match=r"grip_position \(nan, 0.0, 0.0\) is not finite; give metres"):
        ThreePoint(grip_position=(float("nan"), 0.0, 0.0))
    snake = Skeleton(("head", "tail"), (), (-1, 0), np.zeros((2, 3)))
    pose = Pose(snake, np.zeros((1, 3)), np.tile([1.0, 0, 0, 0], (1, 2, 1)))
    with pytest.raises(BodysenseError, match="unknown joint 'left_wrist'"):
        observe(pose, np.zeros(1))
