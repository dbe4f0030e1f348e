"""The fingers of a few hands as chains: angles, forward kinematics and its derivative, in tens of microseconds.

A finger joint turns by T = Rz(−flexion) · Ry(abduction) · Rx(twist) in axes of its own (body/hand.py). Here every joint
has all three angles; `FREE` marks those that it really has. H hands lead every array, joints are the 15 of the fingers.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import radians

import numpy as np

from bodysense.body.hand import FINGERS, FREEDOMS, HAND_JOINTS, joint_bases
from bodysense.body.products import MATRIX
from bodysense.body.registration import to_matrix
from bodysense.body.rotation import quaternion_to_matrix
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.fingers import QUARTER, WAVES, turning

_JOINTS = HAND_JOINTS[1:]
_COLUMN = {"flexion": 0, "abduction": 1, "twist": 2}
_BASIS = quaternion_to_matrix(np.array(joint_bases()))  # (15, 3, 3) the hand's axes ← the joint's own, at rest


def _per_joint(values: Iterable[float]) -> np.ndarray:
    """Return (15, 3) from one value a freedom; 0 for missing angles."""
    table = np.zeros((len(_JOINTS), 3))
    for freedom, value in zip(FREEDOMS, values, strict=True):
        table[_JOINTS.index(freedom.joint), _COLUMN[freedom.angle]] = value
    return table


FREE = _per_joint([1.0] * len(FREEDOMS)) > 0  # (15, 3) which angles a joint has: flexion, abduction, twist
LOW = _per_joint(radians(freedom.low) for freedom in FREEDOMS)  # (15, 3) rad
HIGH = _per_joint(radians(freedom.high) for freedom in FREEDOMS)


@dataclass(frozen=True, eq=False)
class FingerChains:
    """Constants of H hands."""

    base: np.ndarray = field(repr=False)  # (H, 5, 3) m, from the wrist to each finger's first joint
    bone: np.ndarray = field(repr=False)  # (H, 5, 3, 3, 1) m, from each joint to the next point


@dataclass(frozen=True, eq=False)
class PlacedFingers:
    """Positions and rotations of H hands."""

    rotation: np.ndarray  # (H, 15, 4) wxyz, parent ← joint
    position: np.ndarray  # (H, 21, 3) m: wrist, finger joints, fingertips
    parent: np.ndarray  # (H, 15, 3, 3) world ← the parent of each joint


def finger_chains(hands: Sequence[Skeleton]) -> FingerChains:
    """Build the chains of hand skeletons (body.hand.hand_skeleton)."""
    tips = [f"{finger}_tip" for finger in FINGERS]
    beyond = np.array([hand.rest_offset[hand.indices([*_JOINTS, *tips])] for hand in hands])
    chain = beyond[:, :15].reshape(-1, 5, 3, 3)
    following = np.concatenate([chain[:, :, 1:], beyond[:, 15:, None]], axis=2)
    return FingerChains(chain[:, :, 0].copy(), following[..., None])


def levers(hand: Skeleton) -> np.ndarray:
    """Return the distance (15,) m from each finger joint to its fingertip, with the finger straight."""
    rest = hand.path @ hand.rest_offset
    tips = [hand.index(f"{joint[:-1]}_tip") for joint in HAND_JOINTS[1:]]
    return np.linalg.norm(rest[tips] - rest[1:16], axis=1)


def _in_own_axes() -> np.ndarray:
    """Return (15, 16, 5): from q ⊗ q of a joint's rotation to entries of its matrix that define its angles."""
    matrix = np.einsum("jba,kbc,jcd->jkad", _BASIS, MATRIX.reshape(16, 3, 3), _BASIS)  # of BᵀRB
    sine = [-matrix[:, :, 1, 0], -matrix[:, :, 2, 0], matrix[:, :, 2, 1]]
    return np.stack([*sine, matrix[:, :, 0, 0], matrix[:, :, 2, 2]], axis=-1)


_IN_OWN_AXES = np.ascontiguousarray(_in_own_axes())
_FREE = FREE.astype(float)


def angles_of_rotations(local: np.ndarray) -> np.ndarray:
    """Return flexion, abduction and twist (H, 15, 3), rad, of local rotations (H, 15, 4); 0 for missing angles."""
    square = (local[..., :, None] * local[..., None, :]).reshape(-1, 15, 1, 16)
    told = (square @ _IN_OWN_AXES)[:, :, 0]
    sine, cosine = told[..., :3], np.empty((len(local), 15, 3))
    cosine[..., 0::2] = told[..., 3:]
    cosine[..., 1] = np.hypot(told[..., 0], told[..., 3])
    return np.arctan2(sine, cosine) * _FREE


_TURNING = turning()


def rotations_of_angles(angles: np.ndarray) -> np.ndarray:
    """Return local rotations (H, 15, 4), of either sign, of flexion, abduction and twist (H, 15, 3), rad."""
    return (np.cos(angles @ WAVES + QUARTER)[:, :, None] @ _TURNING)[:, :, 0]


def placed_fingers(chains: FingerChains, root: np.ndarray, wrist: np.ndarray, local: np.ndarray) -> PlacedFingers:
    """Place hands with wrists at `root` (H, 3) m, turned by `wrist` (H, 3, 3), and joints by `local` (H, 15, 4)."""
    count = len(local)
    turn = to_matrix(local).reshape(count, 5, 3, 3, 3)
    world, steps = np.empty((count, 5, 4, 3, 3)), np.empty((count, 5, 4, 3))
    world[:, :, 0] = wrist[:, None]
    for k in range(3):
        np.matmul(world[:, :, k], turn[:, :, k], out=world[:, :, k + 1])
    steps[:, :, 0] = chains.base @ wrist.swapaxes(1, 2) + root[:, None]
    steps[:, :, 1:] = (world[:, :, 1:] @ chains.bone)[..., 0]
    places = np.add.accumulate(steps, axis=2)
    position = np.empty((count, 21, 3))
    position[:, 0], position[:, 16:] = root, places[:, :, 3]
    position[:, 1:16] = places[:, :, :3].reshape(count, 15, 3)
    return PlacedFingers(local, position, world[:, :, :3].reshape(count, 15, 3, 3))


# Waves of a joint's flexion f and abduction a: cos f, cos a (unused), cos (f + a), cos (f − a), then sines.
_AXIS_WAVES = np.array([[1, 0, 0], [0, 0, 0], [1, 1, 0], [1, -1, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [1, -1, 0]]).T


def _axes_of_waves() -> np.ndarray:
    """Return (15, 8, 9): from these waves to the axes of a joint's three angles, in its parent's axes.

    In its own axes they are (0, 0, −1), (sin f, cos f, 0) and (cos a cos f, −cos a sin f, −sin a).
    """
    own = np.zeros((8, 3, 3))
    own[1, 0, 2] = -1.0  # of cos 0
    own[4, 1, 0] = own[0, 1, 1] = 1.0
    own[2:4, 2, 0], own[6:, 2, 1], own[5, 2, 2] = 0.5, -0.5, -1.0
    return np.einsum("jab,wcb->jwca", _BASIS, own).reshape(15, 8, 9)


_AXES_OF_WAVES = _axes_of_waves()


def turning_axes(placed: PlacedFingers, angles: np.ndarray) -> np.ndarray:
    """Return (H, 15, 3, 3) world: the axis (last index) of each joint's angle (third index)."""
    about = np.cos(angles @ _AXIS_WAVES + QUARTER)[:, :, None] @ _AXES_OF_WAVES
    return about.reshape(-1, 15, 3, 3) @ placed.parent.swapaxes(-1, -2)
