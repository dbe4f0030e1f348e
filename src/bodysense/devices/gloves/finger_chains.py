"""Angles, positions and axes of fingers' joints, for the linear steps of `contact`.

Here every joint has all three angles of `body.hand`; `FREE` marks those that it really has. H hands lead every array,
joints are the 15 of the fingers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.hand import HAND_JOINTS, joint_bases, joint_places, limits
from bodysense.body.products import to_matrix
from bodysense.body.registration import moved
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.fingers import HandShape, in_order, reached

_BASIS = to_matrix(np.array(joint_bases()))  # (15, 3, 3) the hand's axes ← the joint's own, at rest
_PLACE, FREE = joint_places()  # (15, 3) which angles a joint has: flexion, abduction, twist
LOW, HIGH = (np.where(FREE, of[_PLACE], 0.0) for of in limits())  # (15, 3) rad


@dataclass(frozen=True, eq=False)
class PlacedFingers:
    """Positions and rotations of H hands."""

    rotation: np.ndarray  # (H, 15, 4) wxyz, parent ← joint
    position: np.ndarray  # (H, 21, 3) m: wrist, finger joints, fingertips
    parent: np.ndarray  # (H, 15, 3, 3) world ← the parent of each joint


def levers(hand: Skeleton) -> np.ndarray:
    """Return the distance (15,) m from each finger joint to its fingertip, with the finger straight."""
    rest = hand.path @ hand.rest_offset
    tips = [hand.index(f"{joint[:-1]}_tip") for joint in HAND_JOINTS[1:]]
    return np.linalg.norm(rest[tips] - rest[1:16], axis=1)


def placed_fingers(shape: HandShape, root: np.ndarray, wrist: np.ndarray, local: np.ndarray) -> PlacedFingers:
    """Place hands with wrists at `root` (H, 3) m, turned by `wrist` (H, 3, 3), and joints by `local` (H, 15, 4)."""
    turn = to_matrix(local).reshape(-1, 5, 3, 3, 3)
    parent = np.empty_like(turn)
    parent[:, :, 0] = wrist[:, None]
    for k in (0, 1):
        parent[:, :, k + 1] = parent[:, :, k] @ turn[:, :, k]
    position = moved(in_order(reached(local, shape), shape), wrist, root)
    return PlacedFingers(local, position, parent.reshape(-1, 15, 3, 3))


def turning_axes(placed: PlacedFingers, angles: np.ndarray) -> np.ndarray:
    """Return (H, 15, 3, 3) world: the axis (last index) of each joint's angle (third index)."""
    (sf, sa), (cf, ca) = ((of[..., 0], of[..., 1]) for of in (np.sin(angles), np.cos(angles)))
    own = np.zeros((*angles.shape, 3))
    own[..., 0, 2] = -1.0
    own[..., 1, 0], own[..., 1, 1] = sf, cf  # turned by the flexion
    own[..., 2, 0], own[..., 2, 1], own[..., 2, 2] = ca * cf, -ca * sf, -sa  # and by the abduction
    return own @ (placed.parent @ _BASIS).swapaxes(-1, -2)
