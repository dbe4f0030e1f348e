"""Scripted poses: a plank, a lunge, kneeling, a crouch, and sitting."""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import euler_to_quaternion, quaternion_exp, quaternion_multiply, slerp, smooth_step
from bodysense_lab.completion.score.sight.wearers import rest_heights
from bodysense_lab.core.scoring import RATE

Turn = tuple[float, float, float]  # degrees about x, y and z of the parent, in this order
_STANDS, _HELD, _ENDS = 1.0, 2.5, 5.0  # s at which the wearer begins to move, is in the pose, and the motion ends
_CLEARANCE = 0.05  # m, smallest height of points that are not of a foot
_SOLES = ("ankle", "foot", "toe")


def _both(**turns: Turn) -> dict[str, Turn]:
    """Return turns of joints of both sides, given those of the left side."""
    mirrored = {f"right_{name}": (x, -y, -z) for name, (x, y, z) in turns.items()}
    return {f"left_{name}": turn for name, turn in turns.items()} | mirrored


# Local rotations of the joints that differ from standing. An arm in the rest pose points to its side.
POSES: dict[str, dict[str, Turn]] = {
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
}


def scripted_pose(skeleton: Skeleton, name: str) -> Pose:
    """Return a motion from standing into a pose of `POSES` that is then held; its lowest point is on the floor."""
    time = np.arange(round(_ENDS * RATE)) / RATE
    share = smooth_step(np.clip((time - _STANDS) / (_HELD - _STANDS), 0, 1))
    pose = standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (len(share), 1, 1))
    for joint, turn in POSES[name].items():
        place = skeleton.index(joint)
        rotation[:, place] = slerp(rotation[:, place], euler_to_quaternion(np.radians(turn)[None, ::-1], "ZYX"), share)
    root = np.tile(pose.root_position, (len(share), 1))
    clearance = np.full(len(skeleton.points), _CLEARANCE)
    soles = skeleton.indices([f"{side}_{part}" for side in ("left", "right") for part in _SOLES])
    clearance[soles] = rest_heights(skeleton)[soles]
    position = np.asarray(forward_kinematics(Pose(skeleton, root, rotation))[0])
    root[:, 1] -= (position[..., 1] - clearance).min(axis=-1)
    return Pose(skeleton, root, rotation)


def seated(skeleton: Skeleton, seconds: float = 15.0) -> Pose:
    """Return a pose sequence of an upright seated wearer with hands before the lap, looking around a little."""
    time = np.arange(round(seconds * RATE)) / RATE
    pose = standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (len(time), 1, 1))

    def turn(name: str, x: np.ndarray | float = 0.0, y: np.ndarray | float = 0.0) -> None:
        vector = np.zeros((len(time), 3))
        vector[:, 0], vector[:, 1] = np.radians(x), np.radians(y)
        joint = skeleton.index(name)
        rotation[:, joint] = quaternion_multiply(rotation[:, joint], quaternion_exp(vector))

    sway = 2 * np.sin(2 * np.pi * 0.21 * time)
    turn("spine1", x=3 + sway, y=2 * np.sin(2 * np.pi * 0.13 * time))
    turn("neck", x=4 * np.sin(2 * np.pi * 0.17 * time), y=18 * np.sin(2 * np.pi * 0.11 * time))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        turn(f"{side}_hip", x=-88.0)
        turn(f"{side}_knee", x=88.0)
        turn(f"{side}_elbow", y=-sign * 65.0)
    root = np.tile(pose.root_position, (len(time), 1))
    ankles = skeleton.indices(["left_ankle", "right_ankle"])
    low = np.asarray(forward_kinematics(Pose(skeleton, root, rotation))[0])[:, ankles, 1].min(axis=-1)
    root[:, 1] += rest_heights(skeleton)[ankles[0]] - low
    return Pose(skeleton, root, rotation)
