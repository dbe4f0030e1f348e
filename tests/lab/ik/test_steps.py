"""One step of inverse kinematics against normal equations whose rows are written one by one."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.posture import posture
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_exp, quaternion_multiply, quaternion_to_matrix
from bodysense_lab.papers.ik.ik import IkSettings, IkState, InverseKinematics

from .bodies import random_pose


def chain(length: int) -> Skeleton:
    """One limb without a fork, with an end site."""
    offset = np.tile([0.0, 0.3, 0.0], (length + 1, 1))
    return Skeleton(tuple(f"j{k}" for k in range(length)), ("tip",), (-1, *range(length)), offset)


def bush() -> Skeleton:
    """Forks, an end site in the middle of a chain, two end sites on one joint, and a joint with nothing on it."""
    joints = ("root", "a", "b", "c", "a1", "a2", "a3", "a4", "b1", "b2", "bare")
    sites = ("a2_side", "a4_tip", "b1_tip", "b2_left", "b2_right", "root_site")
    parents = (-1, 0, 0, 1, 1, 4, 5, 6, 2, 2, 3, 5, 7, 8, 9, 9, 0)
    offset = np.random.default_rng(0).normal(0, 0.2, (len(parents), 3))
    return Skeleton(joints, sites, parents, offset)


SKELETONS = {
    "default": default_skeleton,
    "bush": bush,
    "one joint": lambda: Skeleton(("root",), (), (-1,), np.zeros((1, 3))),
    "chain of 2": lambda: chain(2),
    "chain of 9": lambda: chain(9),
}


def cross_matrix(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def slopes(matrix: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Derivatives (J, 3, 3) of twice the vector parts of q (J, 4) by turns in the world; q ← q exp(own turn)."""
    return np.array([(one[0] * np.eye(3) + cross_matrix(one[1:])) @ m.T for one, m in zip(q, matrix, strict=True)])


@pytest.mark.parametrize("name", SKELETONS)
@pytest.mark.parametrize("visible", [0.5, 0.0])
@pytest.mark.parametrize("is_aimed", [False, True])
def test_a_step_equals_that_of_explicit_rows(name: str, visible: float, is_aimed: bool) -> None:
    skeleton = SKELETONS[name]()
    rng = np.random.default_rng(1)
    joints, points = len(skeleton.joints), len(skeleton.points)
    damping, posture_weight = 1e-3, 1e-2
    ik = InverseKinematics(skeleton, IkSettings(1, posture_weight=posture_weight, damping=damping))
    pose = random_pose(rng, 0.2, skeleton)
    position, world = forward_kinematics(pose)
    target = position + rng.normal(0, 0.01, position.shape)
    weight = rng.uniform(0.1, 2, points) * (rng.uniform(size=points) < visible)
    aim = quaternion_multiply(world, quaternion_exp(rng.normal(0, 0.1, (joints, 3))))
    aim_weight = rng.uniform(0, 0.1, joints) * (rng.uniform(size=joints) < 0.5) * is_aimed
    tension = np.r_[0.0, rng.uniform(0, 1, points - 1)]

    # Rows of residuals, by the root's move and the joints' turns.
    at = [slice(3 + 3 * j, 6 + 3 * j) for j in range(joints)]
    size, parents, length = 3 + 3 * joints, np.array(skeleton.parents), skeleton.bone_length
    bone, matrix = position - position[np.maximum(parents, 0)], quaternion_to_matrix(world)
    lever = np.array([length[parents == joint].max(initial=0.01) for joint in range(joints)])
    rows, right = [], []
    for point in range(points):
        row = np.zeros((3, size))
        row[:, :3] = np.eye(3)
        for k in np.flatnonzero(skeleton.path[point]):
            row[:, at[parents[k]]] -= cross_matrix(bone[k])
        rows.append(row * np.sqrt(weight[point]))
        right.append((position[point] - target[point]) * np.sqrt(weight[point]))
    anatomy = posture(skeleton)
    stiffness = np.sqrt(posture_weight * anatomy.stiffness) * lever[:, None]
    local, relaxed = pose.rotation * np.copysign(1, pose.rotation[:, :1]), quaternion_exp(anatomy.relaxed)
    for joint, slope in enumerate(slopes(matrix, local)):
        if joint:
            row = np.zeros((3, size))
            row[:, at[joint]] += slope
            row[:, at[parents[joint]]] -= slope
            rows.append(row * stiffness[joint][:, None])
            right.append(stiffness[joint] * 2 * (local[joint, 1:] - relaxed[joint, 1:]))
    away = quaternion_multiply(quaternion_conjugate(aim), world)
    for joint, slope in enumerate(slopes(matrix, away)):
        row = np.zeros((3, size))
        row[:, at[joint]] = slope
        rows.append(row * np.sqrt(aim_weight[joint]))
        right.append(2 * away[joint, 1:] * np.sqrt(aim_weight[joint]))
    every, residual = np.concatenate(rows), np.concatenate(right)
    normal = every.T @ every + damping * np.diag(np.r_[np.ones(3), np.repeat(lever**2, 3)])
    for point in range(1, points):  # the curvature of taut bones
        taut = cross_matrix(bone[point])
        normal[at[parents[point]], at[parents[point]]] += tension[point] * taut.T @ taut
    expected = -np.linalg.solve(normal, every.T @ residual)

    start = IkState(ik.at(pose.root_position, world).body, np.inf, tension)
    _, after = ik.solve(target, weight, *((aim, aim_weight) if is_aimed else ()), state=start)
    turned = quaternion_multiply(after.body.world_rotation, quaternion_conjugate(world))
    turn = 2 * turned[:, 1:] / turned[:, :1]  # Cayley's map
    assert np.abs(expected).max() > 1e-6 or name == "one joint"
    moved = np.concatenate([after.body.root_position - pose.root_position, turn.ravel()])
    np.testing.assert_allclose(moved, expected, rtol=1e-6, atol=1e-9)


def test_poses_of_a_state_hold_no_other_memory() -> None:
    """A sequence keeps the body of each frame: 2 + 2 rotations a joint and a place a point, and no working memory."""
    skeleton = default_skeleton()
    place = np.asarray(forward_kinematics(Pose(skeleton, np.zeros(3), np.tile([1.0, 0, 0, 0], (52, 1))))[0])
    base = InverseKinematics(skeleton).solve(place)[1].body.position.base
    assert base is not None and base.nbytes <= 8 * (3 + 2 * 4 * 52 + 4 * 65)
