"""Skeletal hands for SteamVR by VMT: 31 bones of a hand, each in its parent, from the joints of a body.

Source: OpenVR's driver documentation, *Hand Skeleton*, and VMT's tables. Finger bones of a left hand have +X to the tip
and +Y out of the palm, of a right one −X and −Y; a wrist has +Z to the fingers and +Y to the thumb's side. The root is
where a controller is held.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from bodysense.body.rigid import RigidTransform
from bodysense.body.rotation import matrix_to_quaternion, quaternion_multiply
from bodysense.body.skeleton import Skeleton
from bodysense.io.mcap_take import hand_axes
from bodysense.serve.osc import bundled, message_bytes
from bodysense.serve.vmt import LEFT_HAND, RIGHT_HAND, device_message

BONES = 31
_FINGERS = ("thumb", "index", "middle", "ring", "pinky")
_LARGEST = 4000  # bytes of a bundle: the driver takes 4098, and this stays on one machine
# A bone's axes, as columns, in OpenXR's of the same joint (−Z to the tip, +Y out of the back of the hand).
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
_METACARPAL = 0.2  # of the way from the wrist to the knuckle: where a metacarpal begins, which our hands lack
_HELPERS = (4, 9, 14, 19, 24)  # bones that the last five repeat in the root's frame
_ABOUT_X = np.array([0.0, 1.0, 0.0, 0.0])


def hand_bones(
    side: str, skeleton: Skeleton, points: Mapping[str, np.ndarray], turns: Mapping[str, np.ndarray]
) -> tuple[RigidTransform, list[RigidTransform]]:
    """Where the controller of a hand is, world ← root, and its 31 bones, each parent ← bone.

    `points` (3,) m and `turns` (4,) wxyz are of the world, by the names of our joints and fingertips.
    """
    wrist = RigidTransform(points[f"{side}_wrist"], _bone_turn(side, skeleton, f"{side}_wrist", turns))
    place, turn = _WRIST_IN_ROOT[side]
    wrist_in_root = RigidTransform(np.array(place), np.array(turn) / np.linalg.norm(turn))
    root = wrist @ wrist_in_root.inverse()
    bones = [RigidTransform(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])), wrist_in_root]
    for finger in _FINGERS:
        parent = wrist
        for bone in _finger(side, finger, skeleton, points, turns):
            bones.append(parent.inverse() @ bone)
            parent = bone
    world = _from_root(bones)
    for k in _HELPERS:
        helper = world[k]
        turned = quaternion_multiply(helper.rotation, _ABOUT_X) if side == "left" else helper.rotation
        bones.append(RigidTransform(helper.translation, turned))
    return root, bones


def hand_messages(
    side: str, index: int, skeleton: Skeleton, points: Mapping[str, np.ndarray], turns: Mapping[str, np.ndarray]
) -> bytes:
    """One bundle: the virtual controller, its 31 bones, and the word that they are whole."""
    root, bones = hand_bones(side, skeleton, points, turns)
    kind = LEFT_HAND if side == "left" else RIGHT_HAND
    messages = [device_message(index, kind, root.translation, np.roll(root.rotation, -1))]
    for k, bone in enumerate(bones):
        values = *bone.translation.tolist(), *np.roll(bone.rotation, -1).tolist()
        messages.append(message_bytes("/VMT/Skeleton/Driver", "iifffffff", index, k, *values))
    messages.append(message_bytes("/VMT/Skeleton/Apply", "if", index, 0.0))
    (bundle,) = bundled(messages, _LARGEST)
    return bundle


def _finger(
    side: str, finger: str, skeleton: Skeleton, points: Mapping[str, np.ndarray], turns: Mapping[str, np.ndarray]
) -> list[RigidTransform]:
    """World ← bone of one finger: thumb 4, others 5, tips with the last bone's rotation."""
    names = [f"{side}_{finger}{k}" for k in (1, 2, 3)]
    bones = [RigidTransform(points[name], _bone_turn(side, skeleton, name, turns)) for name in names]
    if finger != "thumb":
        wrist, knuckle = points[f"{side}_wrist"], points[names[0]]
        along = RigidTransform(wrist, _bone_turn(side, skeleton, f"{side}_wrist", turns, finger=True))
        bones.insert(0, RigidTransform(wrist + _METACARPAL * (knuckle - wrist), along.rotation))
    return [*bones, RigidTransform(points[f"{side}_{finger}_tip"], bones[-1].rotation)]


def _bone_turn(
    side: str, skeleton: Skeleton, name: str, turns: Mapping[str, np.ndarray], finger: bool | None = None
) -> np.ndarray:
    """World ← bone (4,), from the world ← joint rotation of ours."""
    is_finger = not name.endswith("wrist") if finger is None else finger
    return quaternion_multiply(turns[name], _in_joint(side, skeleton, name, is_finger))


@lru_cache(maxsize=256)
def _in_joint(side: str, skeleton: Skeleton, name: str, is_finger: bool) -> np.ndarray:
    """Joint ← bone (4,)."""
    constant = matrix_to_quaternion(np.array((_FINGER if is_finger else _WRIST)[side], dtype=float))
    return quaternion_multiply(hand_axes(skeleton, side)[name], constant)


def _from_root(bones: list[RigidTransform]) -> list[RigidTransform]:
    """Root ← bone of the bones until now: the wrist hangs on the root, fingers on the wrist, bones on one another."""
    world = list(bones[:2])
    for k in range(2, len(bones)):
        first = k in (2, 6, 11, 16, 21)
        world.append(world[1 if first else k - 1] @ bones[k])
    return world
