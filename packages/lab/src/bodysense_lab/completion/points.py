"""The points that the completion network reads and places, and the body of reference that it works at."""

from __future__ import annotations

import numpy as np

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.observation import INERTIAL_POINTS

SITES = ("head_top", "left_toe", "right_toe")
BODY_POINTS = (*BODY, *SITES)  # what has a rest offset here
KNUCKLES = ("left_knuckles", "right_knuckles")  # the mean of the four fingers' first joints
INPUT_POINTS = (*BODY_POINTS, *KNUCKLES)
SPINNING = ("head", "left_wrist", "right_wrist")  # whose angular velocity is read
ACCELERATED = INERTIAL_POINTS  # inertial sensors whose acceleration is read
CONTACT = ("left_ankle", "right_ankle", "left_foot", "right_foot")
JOINTS, PLACED, READ = len(BODY), len(BODY_POINTS), len(INPUT_POINTS)
HEAD = BODY.index("head")
ACCELERATED_PLACES = [BODY.index(name) for name in ACCELERATED]
SPIN_PLACES = [BODY.index(name) for name in SPINNING]
HEAD_HEIGHT = 1.5  # m: where the head joint of the reference stature rests above the soles

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
# (20,) for each point of a hand: the place of its finger in `FINGERS`
FINGER_OF = np.array([FINGERS.index(_SKELETON.points[p].split("_")[1].rstrip("123")) for p in HAND_POINTS[0]])


def body_places() -> list[int]:
    """Indices of `BODY_POINTS` in the 65 points of a skeleton."""
    return [int(place) for place in default_skeleton().indices(BODY_POINTS)]


def bone_parents() -> list[int]:
    """(24,) for each of `BODY_POINTS` but the pelvis the joint that carries it."""
    skeleton = default_skeleton()
    return [skeleton.parents[place] for place in body_places()[1:]]


def path_from_head() -> np.ndarray:
    """(25, 24): bones in the world → positions of `BODY_POINTS` from the head."""
    skeleton = default_skeleton()
    path = skeleton.path[np.ix_(body_places(), body_places()[1:])]
    return path - path[HEAD]


def reference_offsets() -> np.ndarray:
    """(25, 3) m: rest offsets of the default body at the reference stature."""
    offset = default_skeleton().rest_offset[body_places()]
    return offset / float(stature(offset[None])[0])


def stature(rest_offset: np.ndarray) -> np.ndarray:
    """Return (B,): the head's rest height over the soles, of (B, 25, 3) m, divided by the reference's."""
    height = (path_from_head() @ rest_offset[..., 1:, :])[..., 1]
    return -height.min(axis=-1) / HEAD_HEIGHT


def partners(names: tuple[str, ...]) -> list[int]:
    """The place of each name's partner on the other side; a name of the middle is its own."""
    swap = {"left": "right", "right": "left"}
    places = []
    for name in names:
        side, _, rest = name.partition("_")
        places.append(names.index(f"{swap[side]}_{rest}" if side in swap else name))
    return places
