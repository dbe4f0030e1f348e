"""The normal equations against rows that are written one by one."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense_lab.papers.ik.normal_equations import NormalEquations


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


@pytest.mark.parametrize("name", SKELETONS)
@pytest.mark.parametrize("visible", [0.5, 0.0])
def test_solution_equals_that_of_explicit_rows(name: str, visible: float) -> None:
    skeleton = SKELETONS[name]()
    rng = np.random.default_rng(1)
    joints, points = len(skeleton.joints), len(skeleton.points)
    lever = rng.uniform(0.1, 0.5, joints)
    bone, error = rng.normal(0, 0.3, (points - 1, 3)), rng.normal(0, 0.1, (points, 3))
    weight = rng.uniform(0.1, 2, points) * (rng.uniform(size=points) < visible)
    slope, spring = rng.normal(0, 0.3, (joints, 3, 3)), rng.normal(0, 0.3, (joints, 3))
    block = rng.normal(size=(joints, 3, 4))
    block[:, :, :3] = block[:, :, :3] @ block[:, :, :3].swapaxes(1, 2)
    slope[0] = spring[0] = 0
    damping = 1e-3

    size = 3 + 3 * joints
    at = [slice(3 + 3 * j, 6 + 3 * j) for j in range(joints)]
    jacobian = np.zeros((points, 3, size))
    jacobian[:, :, :3] = np.eye(3)
    for point in range(points):
        for k in np.flatnonzero(skeleton.path[point]):
            jacobian[point, :, at[skeleton.parents[k]]] = -cross_matrix(bone[k - 1])
    springs = np.zeros((joints, 3, size))
    for joint in range(1, joints):
        springs[joint, :, at[joint]] = slope[joint].T
        springs[joint, :, at[skeleton.parents[joint]]] = -slope[joint].T
    rows = np.concatenate([jacobian * np.sqrt(weight)[:, None, None], springs]).reshape(-1, size)
    right = np.concatenate([error * np.sqrt(weight)[:, None], spring]).ravel()
    normal, gradient = rows.T @ rows, rows.T @ right
    for joint in range(joints):
        normal[at[joint], at[joint]] += block[joint, :, :3]
        gradient[at[joint]] += block[joint, :, 3]
    normal += damping * np.diag(np.concatenate([np.ones(3), np.repeat(lever**2, 3)]))
    expected = -np.linalg.solve(normal, gradient)

    move, turn = NormalEquations(skeleton, lever).solve(
        bone=bone,
        error=error,
        weight=weight,
        slope=slope,
        spring=spring,
        block=block,
        damping=damping,
    )
    np.testing.assert_allclose(np.concatenate([move, turn.ravel()]), expected, rtol=1e-7, atol=1e-9)
