"""Scripted poses that are rare in recordings: handstand, lying, plank, lunge, kneeling, crouch, bow and others."""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import euler_to_quaternion, slerp, smooth_step
from bodysense_lab.completion.score.sight.wearers import rest_heights
from bodysense_lab.core.scoring import RATE

Turn = tuple[float, float, float]  # degrees about x, y and z of the parent, in this order
_STANDS, HELD, _ENDS = 1.0, 2.5, 5.0  # s at which the wearer begins to move, is in the pose, and the motion ends
_CLEARANCE = 0.05  # m, smallest height of points that are not of a foot
_SOLES = ("ankle", "foot", "toe")


def _both(**turns: Turn) -> dict[str, Turn]:
    """Return turns of joints of both sides, given those of the left side."""
    mirrored = {f"right_{name}": (x, -y, -z) for name, (x, y, z) in turns.items()}
    return {f"left_{name}": turn for name, turn in turns.items()} | mirrored


# Local rotations of the joints that differ from standing. An arm in the rest pose points to its side.
RARE: dict[str, dict[str, Turn]] = {
    "handstand": {"pelvis": (180, 0, 0), "head": (-25, 0, 0)} | _both(shoulder=(0, 0, 85)),
    "lying": {"pelvis": (-90, 0, 0)},
    "plank": {"pelvis": (73, 0, 0), "head": (-25, 0, 0)} | _both(shoulder=(0, -80, 0), wrist=(0, 0, 70)),
    "lunge": {
        "left_hip": (-80, 0, 0),
        "left_knee": (80, 0, 0),
        "right_hip": (20, 0, 0),
        "right_knee": (60, 0, 0),
        "right_ankle": (-30, 0, 0),
    },
    "kneeling_on_one": {
        "left_hip": (-88, 0, 0),
        "left_knee": (88, 0, 0),
        "right_knee": (90, 0, 0),
        "right_ankle": (55, 0, 0),
    },
    "kneeling_on_both": _both(knee=(90, 0, 0), ankle=(55, 0, 0)),
    "crouch": {"pelvis": (20, 0, 0), "spine1": (20, 0, 0)}
    | _both(hip=(-115, 0, 0), knee=(130, 0, 0), ankle=(-20, 0, 0), shoulder=(0, -60, -25)),
    "bow": {"pelvis": (30, 0, 0), "spine1": (30, 0, 0), "spine2": (20, 0, 0)}
    | _both(hip=(-30, 0, 0), shoulder=(0, -75, 0)),
    "split_stance": {
        "left_hip": (-35, 0, 0),
        "left_knee": (10, 0, 0),
        "left_ankle": (25, 0, 0),
        "right_hip": (32, 0, 0),
        "right_knee": (8, 0, 0),
        "right_ankle": (-30, 0, 0),
    },
    "arms_crossed_behind": _both(shoulder=(120, 0, -62), elbow=(0, -85, 0)),
}


def rare_pose(skeleton: Skeleton, name: str) -> Pose:
    """Return a motion from standing into a pose of `RARE` that is then held; its lowest point is on the floor."""
    time = np.arange(round(_ENDS * RATE)) / RATE
    share = smooth_step(np.clip((time - _STANDS) / (HELD - _STANDS), 0, 1))
    pose = standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (len(share), 1, 1))
    for joint, turn in RARE[name].items():
        place = skeleton.index(joint)
        rotation[:, place] = slerp(rotation[:, place], euler_to_quaternion(np.radians(turn)[None, ::-1], "ZYX"), share)
    root = np.tile(pose.root_position, (len(share), 1))
    clearance = np.full(len(skeleton.points), _CLEARANCE)
    soles = skeleton.indices([f"{side}_{part}" for side in ("left", "right") for part in _SOLES])
    clearance[soles] = rest_heights(skeleton)[soles]
    position = np.asarray(forward_kinematics(Pose(skeleton, root, rotation))[0])
    root[:, 1] -= (position[..., 1] - clearance).min(axis=-1)
    return Pose(skeleton, root, rotation)
