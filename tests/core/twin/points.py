"""The points of a body as plain indices: 22 joints of the body, 30 of the fingers, 13 end sites."""

import numpy as np

from bodysense.body.skeleton import default_skeleton

SKELETON = default_skeleton()
at = SKELETON.index
POINTS, JOINTS, BODY = 65, 52, 22
PARENT, PARTNER, PATH = np.array(SKELETON.parents), SKELETON.mirror, SKELETON.path
BODY_POINTS = np.array(
    [*range(BODY), at("head_top"), at("left_toe"), at("right_toe")]
)  # that the network predicts errors of
BODY_PARTNER = np.array([list(BODY_POINTS).index(PARTNER[p]) for p in BODY_POINTS])
SIDES = ("left", "right")
WRISTS = tuple(at(f"{side}_wrist") for side in SIDES)
FINGERS = ("index", "middle", "pinky", "ring", "thumb")
HAND_JOINTS = [[at(f"{side}_{finger}{k}") for finger in FINGERS for k in (1, 2, 3)] for side in SIDES]
HAND_POINTS = [
    [*joints, *(at(f"{side}_{finger}_tip") for finger in FINGERS)]
    for side, joints in zip(SIDES, HAND_JOINTS, strict=True)
]
PELVIS, SPINE3, HEAD, HEAD_TOP = (at(name) for name in ("pelvis", "spine3", "head", "head_top"))
HIPS = (at("left_hip"), at("right_hip"))


def rest_height(rest_offset: np.ndarray, point: int) -> float:
    """Height (m) of a point over the floor in the T-pose, for offsets (65, 3)."""
    return float(rest_offset[PELVIS, 1] + PATH[point] @ rest_offset[:, 1])
