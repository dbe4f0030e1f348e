"""Rotations of solved bodies: hinges and twists that positions leave open, and orientation targets."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply

from .bodies import BODY, EXACT, IK, ONE_STEP, bent, distance, points, random_pose

# Freedom that positions do not determine


@pytest.mark.parametrize("bend", [20, 100])
@pytest.mark.parametrize("side", ["left", "right"])
def test_elbows_and_knees_bend_about_their_hinges(side: str, bend: float) -> None:
    sign = 1 if side == "left" else -1
    swing = {f"{side}_shoulder": (0, 0, -50 * sign), f"{side}_hip": (-50, 0, 0)}
    truth = bent(**swing, **{f"{side}_elbow": (0, -bend * sign, 0), f"{side}_knee": (bend, 0, 0)})
    pose, _ = IK.solve(points(truth))
    for joint in ("shoulder", "elbow", "hip", "knee"):
        index = BODY.index(f"{side}_{joint}")
        assert np.degrees(geodesic_angle(pose.rotation[index], truth.rotation[index])) < 15, joint


def test_straight_limb_keeps_its_twist_from_frame_to_frame() -> None:
    rng = np.random.default_rng(6)
    target = points(bent())
    _, state = IK.solve(target)
    first = state.body.world_rotation
    for _ in range(50):
        _, state = IK.solve(target + rng.normal(0, 1e-4, target.shape), state=state)
    arms = BODY.indices(["left_shoulder", "left_elbow", "left_hip", "left_knee", "head"])
    assert np.degrees(geodesic_angle(state.body.world_rotation[arms], first[arms])).max() < 3


# Orientation targets


def test_orientation_target_settles_the_head() -> None:
    truth = bent(neck=(0, 20, 0), head=(10, 40, 0))
    position, rotation = forward_kinematics(truth)
    head = BODY.index("head")
    target, weight = np.full((len(BODY.joints), 4), np.nan), np.zeros(len(BODY.joints))
    target[head], weight[head] = -rotation[head], 0.05
    without = EXACT.solve(position)[1].body.world_rotation[head]
    _, state = EXACT.solve(position, None, target, weight)
    assert np.degrees(geodesic_angle(without, rotation[head])) > 20
    assert np.degrees(geodesic_angle(state.body.world_rotation[head], rotation[head])) < 0.1
    assert distance(state.position, position) < 1e-4


def test_orientation_targets_of_every_joint_give_back_the_pose() -> None:
    truth = random_pose(np.random.default_rng(9), 0.8)
    position, rotation = forward_kinematics(truth)
    pose, state = EXACT.solve(position, None, rotation)
    assert state.cost < 1e-6
    assert np.degrees(geodesic_angle(pose.rotation, truth.rotation)).max() < 0.2


def test_a_frame_may_start_at_any_body() -> None:
    """At the answer itself, its rotations as weak targets: one step, which keeps even what positions leave open."""
    pose = random_pose(np.random.default_rng(1))
    place, world = forward_kinematics(pose)
    solved, _ = ONE_STEP.solve(place, None, world, np.full(len(world), 1e-3), IK.at(pose.root_position, world))
    np.testing.assert_allclose(points(solved), place, atol=1e-4)
    assert np.degrees(geodesic_angle(solved.rotation, pose.rotation)).max() < 0.5


def test_positions_and_orientations_that_disagree_are_weighed() -> None:
    position, rotation = forward_kinematics(bent())
    turn = quaternion_exp(np.radians([0, 0, 30.0]))
    wanted = np.full_like(rotation, np.nan)
    knee = BODY.index("left_knee")
    wanted[knee] = quaternion_multiply(turn, rotation[knee])
    weight = np.zeros(len(BODY.joints))
    angles = []
    for weight[knee] in (1e-4, 1e-1, 1e2):
        solved = EXACT.solve(position, None, wanted, weight)[1].body.world_rotation[knee]
        angles.append(np.degrees(geodesic_angle(solved, wanted[knee])))
    assert 30 > angles[0] > angles[1] > angles[2]
    assert angles[2] < 1
