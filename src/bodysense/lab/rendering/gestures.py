"""Scripted gestures, whose videos are hard: arms straight out to the sides, up, at the camera, and blows."""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import Pose, standing_pose
from bodysense.body.rotation import quaternion_conjugate, quaternion_exp, quaternion_rotate, shortest_arc, slerp
from bodysense.body.skeleton import default_skeleton
from bodysense.io.clip import Clip

RATE = 30.0  # Hz
_ARM = tuple[tuple[float, float, float], tuple[float, float, float]]
# Where upper arm and forearm of the left arm point from a chest that faces +z; the right arm's are mirrored.
_HANG: _ARM = ((0.15, -1.0, 0.0), (0.1, -1.0, 0.15))
_OUT: _ARM = ((1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
_UP: _ARM = ((0.3, 1.0, 0.0), (0.15, 1.0, 0.0))
_AHEAD: _ARM = ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
_GUARD: _ARM = ((0.2, -0.85, 0.4), (-0.35, 0.75, 0.6))
_BLOW: _ARM = ((-0.1, 0.0, 1.0), (-0.15, 0.05, 1.0))
_HOOK: _ARM = ((0.75, 0.0, 0.65), (-0.75, 0.0, 0.65))
_UPPERCUT: _ARM = ((0.1, -0.3, 0.95), (-0.1, 0.9, 0.4))
# Of each: s, left arm, right arm, degrees by which the chest is turned to the left.
_Key = tuple[float, _ARM, _ARM, float]
GESTURES: dict[str, tuple[_Key, ...]] = {
    "t_pose": ((0.0, _HANG, _HANG, 0), (0.7, _HANG, _HANG, 0), (1.4, _OUT, _OUT, 0), (3.0, _OUT, _OUT, 0),
               (3.8, _HANG, _HANG, 0), (4.5, _HANG, _HANG, 0)),
    "arms_up": ((0.0, _HANG, _HANG, 0), (0.6, _HANG, _HANG, 0), (1.5, _UP, _UP, 0), (2.6, _UP, _UP, 0),
                (3.3, _OUT, _OUT, 0), (4.0, _HANG, _HANG, 0), (4.5, _HANG, _HANG, 0)),
    "arms_ahead": ((0.0, _HANG, _HANG, 0), (0.6, _HANG, _HANG, 0), (1.4, _AHEAD, _AHEAD, 0), (2.6, _AHEAD, _AHEAD, 0),
                   (3.4, _OUT, _OUT, 0), (4.5, _HANG, _HANG, 0)),
    "punches": ((0.0, _GUARD, _GUARD, 0), (0.6, _GUARD, _GUARD, 0), (0.8, _BLOW, _GUARD, -20), (1.1, _GUARD, _GUARD, 0),
                (1.3, _GUARD, _BLOW, 20), (1.6, _GUARD, _GUARD, 0), (1.85, _HOOK, _GUARD, -30),
                (2.2, _GUARD, _GUARD, 0), (2.45, _GUARD, _HOOK, 30), (2.8, _GUARD, _GUARD, 0),
                (3.0, _UPPERCUT, _GUARD, -15), (3.3, _GUARD, _GUARD, 0), (3.5, _GUARD, _UPPERCUT, 15),
                (3.8, _GUARD, _GUARD, 0), (4.1, _GUARD, _OUT, 0), (4.5, _GUARD, _GUARD, 0)),
}  # fmt: skip
_SPINE = ("spine1", "spine2", "spine3")


def gesture(name: str) -> Clip:
    """The motion of one of `GESTURES`, on the default body, with fingers; its category is its name."""
    keys, skeleton = GESTURES[name], default_skeleton()
    times = np.array([key[0] for key in keys])
    time = np.arange(round(times[-1] * RATE) + 1) / RATE
    after = np.clip(np.searchsorted(times, time, side="right"), 1, len(keys) - 1)
    share = np.clip((time - times[after - 1]) / (times[after] - times[after - 1]), 0, 1)
    share = share**3 * (10 - 15 * share + 6 * share**2)  # of least jerk
    pose = standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (len(time), 1, 1))
    if name == "punches":
        for joint, place in ((joint, skeleton.index(joint)) for joint in skeleton.joints if joint[-1] in "123"):
            if skeleton.wrist_of[place] >= 0 and "thumb" not in joint:
                rotation[:, place] = quaternion_exp(np.array([0.0, 0.0, -1.4 if joint.startswith("left") else 1.4]))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        turned = np.array([_arm(left if side == "left" else right, sign) for _, left, right, _ in keys])
        for joint, way in zip(("shoulder", "elbow"), np.moveaxis(turned, 1, 0), strict=True):
            rotation[:, skeleton.index(f"{side}_{joint}")] = slerp(way[after - 1], way[after], share)
    turn = np.radians([key[3] for key in keys])
    turn = turn[after - 1] + share * (turn[after] - turn[after - 1])
    for joint in _SPINE:
        rotation[:, skeleton.index(joint)] = quaternion_exp(turn[:, None] / len(_SPINE) * [0.0, 1.0, 0.0])
    root = np.tile(pose.root_position, (len(time), 1))
    return Clip(name, Pose(skeleton, root, rotation), RATE, has_fingers=True, category=name)


def _arm(ways: _ARM, sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Local rotations (4,) of a shoulder and an elbow."""
    bone, mirror = np.array([sign, 0.0, 0.0]), np.array([sign, 1.0, 1.0])
    upper, fore = (np.array(way) * mirror for way in ways)
    shoulder = shortest_arc(bone, upper)
    elbow = shortest_arc(bone, np.asarray(quaternion_rotate(quaternion_conjugate(shoulder), fore)))
    return np.asarray(shoulder), np.asarray(elbow)
