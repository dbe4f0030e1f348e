"""The fingers of a few hands as chains of matrices: forward kinematics and its derivative, in tens of microseconds.

A finger joint turns by T = Rz(−flexion) · Ry(abduction) · Rx(twist) in axes of its own (body/hand.py). Here every joint
has all three angles; `FREE` says which of them are its own. H hands lead every array, joints are the 15 of the fingers.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import radians

import numpy as np

from bodysense.body.hand import FINGERS, FREEDOMS, HAND_JOINTS, joint_bases
from bodysense.body.products import CONJUGATE, multiply
from bodysense.body.rotation import quaternion_to_matrix
from bodysense.body.skeleton import Skeleton

_JOINTS = HAND_JOINTS[1:]
_COLUMN = {"flexion": 0, "abduction": 1, "twist": 2}
_BASIS = quaternion_to_matrix(np.array(joint_bases()))  # (15, 3, 3) the hand's axes ← the joint's own, at rest


def _per_joint(values: Iterable[float]) -> np.ndarray:
    """(15, 3) from one value a freedom; 0 where a joint has none."""
    table = np.zeros((len(_JOINTS), 3))
    for freedom, value in zip(FREEDOMS, values, strict=True):
        table[_JOINTS.index(freedom.joint), _COLUMN[freedom.angle]] = value
    return table


FREE = _per_joint([1.0] * len(FREEDOMS)) > 0  # (15, 3) which angles a joint has: flexion, abduction, twist
LOW = _per_joint(radians(freedom.low) for freedom in FREEDOMS)  # (15, 3) rad
HIGH = _per_joint(radians(freedom.high) for freedom in FREEDOMS)


@dataclass(frozen=True, eq=False)
class FingerChains:
    """What stays of H hands."""

    base: np.ndarray = field(repr=False)  # (H, 5, 3) m, from the wrist to each finger's first joint
    bone: np.ndarray = field(
        repr=False
    )  # (H, 5, 3, 3, 1) m, from each joint to the next point, in the joint's own axes
    into: np.ndarray = field(repr=False)  # (5, 3, 3, 3) axes of a joint's own ← the next joint's own, at rest
    first: np.ndarray = field(repr=False)  # (5, 3, 3) the wrist's axes ← each first joint's own


@dataclass(frozen=True, eq=False)
class PlacedFingers:
    """Where H hands are."""

    position: np.ndarray  # (H, 21, 3) m: wrist, finger joints, fingertips
    axes: np.ndarray  # (H, 15, 3, 3) world ← each joint's own axes, before it turns


def finger_chains(hands: Sequence[Skeleton]) -> FingerChains:
    """Of hand skeletons (body.hand.hand_skeleton)."""
    tips = [f"{finger}_tip" for finger in FINGERS]
    beyond = np.array([hand.rest_offset[hand.indices([*_JOINTS, *tips])] for hand in hands])
    chain = beyond[:, :15].reshape(-1, 5, 3, 3)
    following = np.concatenate([chain[:, :, 1:], beyond[:, 15:, None]], axis=2)
    basis = _BASIS.reshape(5, 3, 3, 3)
    onward = np.concatenate([basis[:, :2].swapaxes(-1, -2) @ basis[:, 1:], basis[:, 2:].swapaxes(-1, -2)], axis=1)
    bone = basis.swapaxes(-1, -2) @ following[..., None]
    return FingerChains(chain[:, :, 0], np.ascontiguousarray(bone), onward, np.ascontiguousarray(basis[:, 0]))


def levers(hand: Skeleton) -> np.ndarray:
    """(15,) m: from each finger joint to its fingertip, when the finger is straight."""
    rest = hand.path @ hand.rest_offset
    tips = [hand.index(f"{joint[:-1]}_tip") for joint in HAND_JOINTS[1:]]
    return np.linalg.norm(rest[tips] - rest[1:16], axis=1)


def own_turns(local: np.ndarray) -> np.ndarray:
    """Local rotations (H, 15, 3, 3) in the joints' own axes."""
    return _BASIS.swapaxes(-1, -2) @ local @ _BASIS


def angles_of_turns(turn: np.ndarray) -> np.ndarray:
    """Flexion, abduction and twist (H, 15, 3), rad, of turns (H, 15, 3, 3)."""
    a, b = turn[..., 0, 0], turn[..., 1, 0]
    return np.stack(
        [
            -np.arctan2(b, a),
            np.arctan2(-turn[..., 2, 0], np.sqrt(a * a + b * b)),
            np.arctan2(turn[..., 2, 1], turn[..., 2, 2]),
        ],
        axis=-1,
    )


def turns_of_angles(angles: np.ndarray) -> np.ndarray:
    """Turns (H, 15, 3, 3) of flexion, abduction and twist (H, 15, 3), rad."""
    cosine, sine = np.cos(angles), np.sin(angles)
    cz, cy, cx = cosine[..., 0], cosine[..., 1], cosine[..., 2]
    sz, sy, sx = -sine[..., 0], sine[..., 1], sine[..., 2]
    turn = np.empty((*angles.shape[:-1], 3, 3))
    turn[..., 0, 0], turn[..., 1, 0], turn[..., 2, 0] = cz * cy, sz * cy, -sy
    zy, zz = cz * sy, sz * sy
    turn[..., 0, 1], turn[..., 1, 1], turn[..., 2, 1] = zy * sx - sz * cx, zz * sx + cz * cx, cy * sx
    turn[..., 0, 2], turn[..., 1, 2], turn[..., 2, 2] = zy * cx + sz * sx, zz * cx - cz * sx, cy * cx
    return turn


def placed_fingers(chains: FingerChains, root: np.ndarray, wrist: np.ndarray, turn: np.ndarray) -> PlacedFingers:
    """Hands whose wrists are at `root` (H, 3) m, turned by `wrist` (H, 3, 3), their joints by `turn` (H, 15, 3, 3)."""
    turn = turn.reshape(-1, 5, 3, 3, 3)
    count = len(turn)
    position, axes = np.empty((count, 21, 3)), np.empty((count, 5, 3, 3, 3))
    joints = position[:, 1:16].reshape(count, 5, 3, 3)
    place = root[:, None] + chains.base @ wrist.swapaxes(-1, -2)
    own = wrist[:, None] @ chains.first
    for k in range(3):
        joints[:, :, k], axes[:, :, k] = place, own
        turned = own @ turn[:, :, k]
        place = place + (turned @ chains.bone[:, :, k])[..., 0]
        own = turned @ chains.into[:, k]
    position[:, 0], position[:, 1:16], position[:, 16:] = root, joints.reshape(count, 15, 3), place
    return PlacedFingers(position, axes.reshape(count, 15, 3, 3))


def turning_axes(placed: PlacedFingers, angles: np.ndarray) -> np.ndarray:
    """(H, 15, 3, 3) world: the axis, in the last place, about which each joint's angle, third place, turns it."""
    f, a = angles[..., 0], angles[..., 1]
    cf, sf, ca, sa = np.cos(f), np.sin(f), np.cos(a), np.sin(a)
    about = np.zeros((*f.shape, 3, 3))
    about[..., 0, 2] = -1.0
    about[..., 1, 0], about[..., 1, 1] = sf, cf
    about[..., 2, 0], about[..., 2, 1], about[..., 2, 2] = ca * cf, -ca * sf, -sa
    return about @ placed.axes.swapaxes(-1, -2)


def turned_by(rotation: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Local rotations (H, 15, 4) wxyz of joints whose angles (H, 15, 3), rad, were one and become another."""
    own = _half_turns(np.stack([after, before]))
    turn = multiply(own[0].reshape(-1, 4), own[1].reshape(-1, 4) * CONJUGATE).reshape(rotation.shape)
    turn[..., 1:] = (_BASIS @ turn[..., 1:, None])[..., 0]
    turned = multiply(turn.reshape(-1, 4), rotation.reshape(-1, 4)).reshape(rotation.shape)
    return turned * np.copysign(1.0, turned[..., :1])


def _half_turns(angles: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) of flexion, abduction and twist (..., 3), rad, in the joints' own axes."""
    cosine, sine = np.cos(angles / 2), np.sin(angles / 2)
    cz, cy, cx = cosine[..., 0], cosine[..., 1], cosine[..., 2]
    sz, sy, sx = -sine[..., 0], sine[..., 1], sine[..., 2]
    cc, cs, sc, ss = cz * cy, cz * sy, sz * cy, sz * sy
    return np.stack([cc * cx + ss * sx, cc * sx - ss * cx, cs * cx + sc * sx, sc * cx - cs * sx], axis=-1)
