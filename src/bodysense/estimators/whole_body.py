"""From the 22 joints of `BODY` to a whole skeleton: fingers relaxed, arms and legs bent to where they should end."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.products import CONJUGATE, LEFT, MATRIX, multiply
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.estimators.learned import MEASURED_ERROR
from bodysense.estimators.limbs import reach

HELD_ERROR = 0.01  # m: what is expected of a foot that is held
FINGER_ERROR = 0.03  # m: of a relaxed finger about its wrist
_LIMBS = [[f"{side}_{part}" for part in ("shoulder", "elbow", "wrist")] for side in ("left", "right")]
_LIMBS += [[f"{side}_{part}" for part in ("hip", "knee", "ankle")] for side in ("left", "right")]
# Axes about which straight limbs bend, in their upper bone's frame: elbows forward, knees backward.
_HINGES = np.array([[0.0, -1, 0], [0, 1, 0], [1, 0, 0], [1, 0, 0]])


class WholeBody:
    """A skeleton with fingers and end sites from the world rotations of its 22 joints.

    One body or, with `together`, many: arrays may lead with a batch axis, written `…` below. Raises BodysenseError for
    a skeleton that lacks one of the 22 joints, or a toe.
    """

    def __init__(self, skeleton: Skeleton) -> None:
        sides = ("left", "right")
        self.skeleton = skeleton
        self.joints = skeleton.indices(BODY)
        self.wrists = [BODY.index(name) for name in ("left_wrist", "right_wrist")]
        self.limbs = np.array([[BODY.index(name) for name in limb] for limb in _LIMBS]).T  # (3, 4)
        self.ankle_and_ball = np.array([[BODY.index(f"{side}_{part}") for part in ("ankle", "foot")] for side in sides])
        toes = skeleton.indices([f"{side}_toe" for side in sides])
        self.toe_offset = skeleton.rest_offset[toes][..., None]
        self.hands = [
            np.append(wrist, np.flatnonzero(skeleton.wrist_of == wrist)) for wrist in self.joints[self.wrists]
        ]
        self.fingers = np.flatnonzero(skeleton.wrist_of[: len(skeleton.joints)] >= 0)
        self.finger_wrists = skeleton.wrist_of[self.fingers]
        _, world = forward_kinematics(standing_pose(skeleton))
        self.relaxed = multiply(world[self.finger_wrists] * CONJUGATE, world[self.fingers])  # wrist ← finger
        self.parents = np.array(skeleton.parents[1:])
        self.joint_parents = np.maximum(np.array(skeleton.parents[: len(skeleton.joints)]), 0)
        self.offset = skeleton.rest_offset[1:, :, None].copy()
        self.path = np.ascontiguousarray(skeleton.path[:, 1:])
        joints = [list(self.joints).index(parent) for parent in self.parents[self.joints[1:] - 1]]
        self.joint_bones = (np.array(joints), self.joints[1:] - 1, self.path[np.ix_(self.joints, self.joints[1:] - 1)])
        # Of the 22 joints the nearest at or above each point, whose expected error is the point's own.
        place = {int(joint): k for k, joint in enumerate(self.joints)}
        self.nearest = np.array([_first_above(skeleton.parents, point, place) for point in range(len(skeleton.points))])
        self.feet = np.stack([self.joints[self.ankle_and_ball[:, 0]], self.joints[self.ankle_and_ball[:, 1]], toes])
        self.head = [point for point, name in enumerate(skeleton.points) if name in ("head", "head_top")]
        self.is_finger = skeleton.wrist_of >= 0

    def placed(self, root: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (…, P, 3) m and world rotations (…, J, 4) of bodies from those of the 22 joints; fingers relaxed."""
        world = np.empty((*rotation.shape[:-2], len(self.joint_parents), 4))
        world[..., self.joints, :] = rotation
        world[..., self.fingers, :] = _product(world.take(self.finger_wrists, axis=-2), self.relaxed)
        bone = (_matrix(world).take(self.parents, axis=-3) @ self.offset)[..., 0]
        return self.path @ bone + root[..., None, :], world

    def placed_joints(self, rotation: np.ndarray) -> np.ndarray:
        """The 22 joints alone (…, 22, 3) m, from the root."""
        parents, bones, path = self.joint_bones
        bone = _matrix(rotation).take(parents, axis=-3) @ self.offset.take(bones, axis=-3)
        return path @ bone[..., 0]

    def local(self, world: np.ndarray) -> np.ndarray:
        """(…, J, 4) parent ← joint, w ≥ 0, of world rotations (…, J, 4)."""
        local = _product(world.take(self.joint_parents, axis=-2) * CONJUGATE, world)
        local[..., 0, :] = world[..., 0, :]
        local *= (np.copysign(1.0, local[..., 0]) / np.sqrt(np.einsum("...j,...j->...", local, local)))[..., None]
        return local

    def foot(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """(…, 2, 3, 3) m: ankle, ball and toe tip of each foot, from positions and rotations of the 22 joints."""
        balls = self.ankle_and_ball[:, 1]
        feet = np.empty((*position.shape[:-2], 2, 3, 3))
        feet[..., :2, :] = position[..., self.ankle_and_ball, :]
        feet[..., 2, :] = feet[..., 1, :] + (_matrix(rotation.take(balls, axis=-2)) @ self.toe_offset)[..., 0]
        return feet

    def reach(self, position: np.ndarray, world: np.ndarray, target: np.ndarray) -> None:
        """Turn arms and legs, in place, so that wrists and ankles come to `target` (…, 4, 3) m; hands and feet stay."""
        start, middle, end = (position.take(joints, axis=-2).reshape(-1, 3) for joints in self.limbs)
        bending = np.stack([world.take(joints, axis=-2).reshape(-1, 4) for joints in self.limbs[:2]])
        hinge = (_matrix(bending[0]).reshape(-1, 4, 3, 3) @ _HINGES[:, :, None]).reshape(-1, 3)
        turned = reach(middle - start, end - middle, target.reshape(-1, 3) - start, bending, hinge)
        shape = (*world.shape[:-2], 4, 4)
        world[..., self.limbs[0], :], world[..., self.limbs[1], :] = (turn.reshape(shape) for turn in turned)

    def expected(self, error: np.ndarray, measured: np.ndarray, held: np.ndarray) -> np.ndarray:
        """(…, P) m: expected errors of all points from those of the 22 joints."""
        whole = error.take(self.nearest, axis=-1)
        whole[..., self.is_finger] = FINGER_ERROR
        whole[..., self.head] = MEASURED_ERROR
        wrists = self.joints[self.wrists]
        whole[..., wrists] = np.where(measured, MEASURED_ERROR, whole[..., wrists])
        whole[..., self.feet] = np.where(held[..., None, :], HELD_ERROR, whole[..., self.feet])
        return whole


def together(bodies: Sequence[WholeBody]) -> WholeBody:
    """Bodies of one tree as one that is many: its first axis is that of `bodies`."""
    first = bodies[0]
    if all(body is first for body in bodies):
        return first  # what is the same for all needs no axis
    many = copy(first)
    many.offset, many.toe_offset, many.relaxed = (
        np.array([getattr(body, name) for body in bodies]) for name in ("offset", "toe_offset", "relaxed")
    )
    return many


def _matrix(q: np.ndarray) -> np.ndarray:
    """(…, 4) → (…, 3, 3)."""
    return ((q[..., :, None] * q[..., None, :]).reshape(-1, 16) @ MATRIX).reshape(*q.shape[:-1], 3, 3)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton products (…, 4); `b` may lack the batch axis."""
    left = (a @ LEFT).reshape(*a.shape[:-1], 4, 4)
    return (left @ b[..., None])[..., 0]


def _first_above(parents: Sequence[int], point: int, place: dict[int, int]) -> int:
    while point not in place:
        point = parents[point]
    return place[point]
