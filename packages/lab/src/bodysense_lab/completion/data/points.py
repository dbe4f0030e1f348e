"""Points that the completion network reads and predicts, and the reference body."""

from __future__ import annotations

import numpy as np

from bodysense.body.skeleton import BODY, INERTIAL_POINTS, default_skeleton

SITES = ("head_top", "left_toe", "right_toe")
BODY_POINTS = (*BODY, *SITES)  # points with a rest offset
KNUCKLES = ("left_knuckles", "right_knuckles")  # the mean of the four fingers' first joints
INPUT_POINTS = (*BODY_POINTS, *KNUCKLES)
SPIN_JOINTS = ("head", "left_wrist", "right_wrist")  # joints whose angular velocity is an input
ACCELERATION_POINTS = INERTIAL_POINTS  # inertial sensors whose acceleration is an input
CONTACT = ("left_ankle", "right_ankle", "left_foot", "right_foot")
JOINTS, BODY_POINT_COUNT, INPUT_POINT_COUNT = len(BODY), len(BODY_POINTS), len(INPUT_POINTS)
HEAD = BODY.index("head")
ACCELERATION_INDICES = [BODY.index(name) for name in ACCELERATION_POINTS]
SPIN_INDICES = [BODY.index(name) for name in SPIN_JOINTS]
HEAD_HEIGHT = 1.5  # m, height of the head joint over the soles in the rest pose, at the reference stature

SIDES = ("left", "right")
FINGERS = ("index", "middle", "pinky", "ring", "thumb")
WRISTS = [BODY.index(f"{side}_wrist") for side in SIDES]
_SKELETON = default_skeleton()
HAND_JOINTS = np.array(
    [
        [j for j in range(len(_SKELETON.joints)) if _SKELETON.wrist_of[j] == _SKELETON.index(f"{side}_wrist")]
        for side in SIDES
    ]
)  # (2, 15)
HAND_POINTS = np.array(
    [
        [*joints, *(p for p in range(len(_SKELETON.joints), len(_SKELETON.points)) if _SKELETON.parents[p] in joints)]
        for joints in HAND_JOINTS
    ]
)  # (2, 20) joints, then tips
FINGER_JOINTS, FINGER_POINTS = HAND_JOINTS.shape[1], HAND_POINTS.shape[1]
# (20,) index in `FINGERS` of the finger of each point of a hand
FINGER_OF = np.array([FINGERS.index(_SKELETON.points[p].split("_")[1].rstrip("123")) for p in HAND_POINTS[0]])


def body_indices() -> list[int]:
    """Return indices of `BODY_POINTS` in the 65 points of a skeleton."""
    return [int(place) for place in default_skeleton().indices(BODY_POINTS)]


def bone_parents() -> list[int]:
    """Return the parent joint of each of `BODY_POINTS` but the pelvis (24,)."""
    skeleton = default_skeleton()
    return [skeleton.parents[place] for place in body_indices()[1:]]


def path_from_head() -> np.ndarray:
    """Return the matrix (25, 24) from bones in the world to positions of `BODY_POINTS` relative to the head."""
    skeleton = default_skeleton()
    path = skeleton.path[np.ix_(body_indices(), body_indices()[1:])]
    return path - path[HEAD]


def reference_offsets() -> np.ndarray:
    """Return rest offsets (25, 3) m of the default body at the reference stature."""
    offset = default_skeleton().rest_offset[body_indices()]
    return offset / float(stature(offset[None])[0])


def stature(rest_offset: np.ndarray) -> np.ndarray:
    """Return rest heights (B,) of heads over the soles, divided by the reference height, for offsets (B, 25, 3) m."""
    height = (path_from_head() @ rest_offset[..., 1:, :])[..., 1]
    return -height.min(axis=-1) / HEAD_HEIGHT


def partners(names: tuple[str, ...]) -> list[int]:
    """Return the index of each name's counterpart on the other side, or its own index for a name in the middle."""
    swap = {"left": "right", "right": "left"}
    places = []
    for name in names:
        side, _, rest = name.partition("_")
        places.append(names.index(f"{swap[side]}_{rest}" if side in swap else name))
    return places
