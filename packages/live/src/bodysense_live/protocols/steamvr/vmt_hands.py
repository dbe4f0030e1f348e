"""Skeletal hands for SteamVR by VMT: 31 bones of a hand, each in its parent's frame, from the joints of a body.

Source: OpenVR's driver documentation, *Hand Skeleton*, and VMT's tables. Finger bones of a left hand have +X to the tip
and +Y out of the palm, of a right one −X and −Y; a wrist has +Z to the fingers and +Y to the thumb's side. The root is
where a controller is held.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.geometry.products import CONJUGATE, multiply, rotate
from bodysense.geometry.rotation import matrix_to_quaternion
from bodysense.io.formats.mcap_take import hand_axes
from bodysense.io.formats.osc import PacketForm
from bodysense_live.protocols.steamvr.vmt import LEFT_HAND, RIGHT_HAND, device_message

BONES = 31
_FINGERS = ("index", "middle", "ring", "pinky")
_LARGEST = 4000  # bytes of a bundle; the driver accepts 4098
# Axes of a bone as columns, in OpenXR's frame of the joint (−Z to the tip, +Y out of the back of the hand).
_FINGER = {
    "left": [[0, 0, -1], [0, -1, 0], [-1, 0, 0]],
    "right": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
}
_WRIST = {
    "left": [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    "right": [[0, -1, 0], [-1, 0, 0], [0, 0, -1]],
}
_WRIST_IN_ROOT = {  # of the rest pose: m, wxyz
    "left": ((-0.0340, 0.0365, 0.1647), (-0.0551, -0.0786, -0.9203, 0.3793)),
    "right": ((0.0340, 0.0365, 0.1647), (-0.0551, -0.0786, 0.9203, -0.3793)),
}
_METACARPAL = 0.2  # start of a metacarpal, which our hands lack, as a share of the distance from wrist to knuckle
_HELPERS = (4, 9, 14, 19, 24)  # bones that the last five repeat in the root's frame
_ABOUT_X = np.tile([0.0, 1.0, 0.0, 0.0], (len(_HELPERS), 1))
_IDENTITY = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
_BONES = (  # our joint that turns a bone, and the bone's start: wrist, thumb, and fingers with metacarpals
    ("wrist", "wrist"),
    *((f"thumb{k}", f"thumb{k}") for k in (1, 2, 3)),
    ("thumb3", "thumb_tip"),
    *(
        row
        for finger in _FINGERS
        for row in (("wrist", "wrist"), *((f"{finger}{k}",) * 2 for k in (1, 2, 3)), (f"{finger}3", f"{finger}_tip"))
    ),
)
_JOINTS, _POINTS = zip(*_BONES, strict=True)
_METACARPALS = np.array([6, 11, 16, 21])
_CHILDREN = np.array([*range(2, 26), *_HELPERS])
_PARENTS = np.array([*(1 if k in (2, *_METACARPALS) else k - 1 for k in range(2, 26)), *len(_HELPERS) * [0]])


def hand_bones(
    side: str, skeleton: Skeleton, points: Mapping[str, np.ndarray], turns: Mapping[str, np.ndarray]
) -> np.ndarray:
    """Return poses (32, 7) of a hand, m and wxyz: its controller, world ← root, then its 31 bones, each parent ← bone.

    `points` (3,) m and `turns` (4,) wxyz are in the world, by the names of our joints and fingertips.
    """
    joints = [f"{side}_{joint}" for joint in _JOINTS]
    offset, rest = (np.array([values]) for values in _WRIST_IN_ROOT[side])
    rest /= np.linalg.norm(rest)
    place = np.empty((1 + len(joints), 3))  # root, wrist and fingers in the world
    place[1:] = [points[f"{side}_{point}"] for point in _POINTS]
    place[_METACARPALS] = place[1] + _METACARPAL * (place[_METACARPALS + 1] - place[1])
    turn = np.empty((1 + len(joints), 4))
    turn[1:] = multiply(np.array([turns[joint] for joint in joints]), _in_joints(side, skeleton))
    turn[:1] = multiply(turn[1:2], rest * CONJUGATE)
    place[:1] = place[1:2] - rotate(turn[:1], offset)
    back = turn[_PARENTS] * CONJUGATE
    bones = np.empty((1 + BONES, 7))
    bones[0] = np.append(place[0], turn[0])
    bones[1] = _IDENTITY
    bones[2] = np.append(offset, rest)
    bones[3:, :3] = rotate(back, place[_CHILDREN] - place[_PARENTS])
    bones[3:, 3:] = multiply(back, turn[_CHILDREN])
    if side == "left":
        bones[-len(_HELPERS) :, 3:] = multiply(bones[-len(_HELPERS) :, 3:], _ABOUT_X)
    return bones


def hand_packet(
    side: str, index: int, skeleton: Skeleton, points: Mapping[str, np.ndarray], turns: Mapping[str, np.ndarray]
) -> bytes:
    """Return a bundle of the virtual controller, its 31 bones, and the message that applies them."""
    bones = hand_bones(side, skeleton, points, turns)
    (packet,) = _form(side, index).filled(bones[:, [0, 1, 2, 4, 5, 6, 3]].ravel())
    return packet


@lru_cache
def _form(side: str, index: int) -> PacketForm:
    bones = [("/VMT/Skeleton/Driver", "iifffffff", (index, k)) for k in range(BONES)]
    device = device_message(index, LEFT_HAND if side == "left" else RIGHT_HAND)
    return PacketForm([device, *bones, ("/VMT/Skeleton/Apply", "if", (index, 0.0))], _LARGEST)


@lru_cache(maxsize=64)
def _in_joints(side: str, skeleton: Skeleton) -> np.ndarray:
    """Return rotations joint ← bone, (25, 4) wxyz, of the wrist and the fingers' bones."""
    axes = hand_axes(skeleton, side)
    finger, wrist = (matrix_to_quaternion(np.array(rows[side], dtype=float)) for rows in (_FINGER, _WRIST))
    in_axes = np.array([wrist, *(len(_JOINTS) - 1) * [finger]])
    return multiply(np.array([axes[f"{side}_{joint}"] for joint in _JOINTS]), in_axes)
