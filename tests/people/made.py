"""Made-up people whose places are known: who lies, crawls or stands on the hands, and who steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.demo import packaged_performance
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.observing.world import clearance_of

QUARTER = np.pi / 2
LYING = {  # rotations of the pelvis, radians
    "on the back": (-QUARTER, 0.0, 0.0),
    "on the face": (QUARTER, 0.0, 0.0),
    "on the side": (0.0, 0.0, QUARTER),
    "on the hands": (0.0, 0.0, np.pi),
}
_WAVED = ("hip", "knee", "shoulder", "elbow")


def lying_clip(how: str, frames: int = 40, rate: float = 30.0, seed: int = 1) -> Clip:
    """Return a person who rests on the floor in one of `LYING`'s ways, and moves one arm and one leg at a time."""
    rng = np.random.default_rng(seed)
    clip = packaged_performance()
    skeleton = clip.pose.skeleton
    rotation = np.zeros((frames, len(skeleton.joints), 4))
    rotation[..., 0] = 1
    time = np.arange(frames) / rate
    for side in ("left", "right"):
        for part in _WAVED if side == "left" else _WAVED[:2]:
            axis = np.array([1.0, 0.0, 0.0]) if part in _WAVED[:2] else np.array([0.0, -1.0, 0.0])
            sign = -1.0 if part == "hip" else 1.0
            angle = 0.35 * (1 - np.cos(2 * np.pi * 0.7 * time + (0.0 if part in _WAVED[:2] else rng.uniform(0, 1))))
            if side == "right":
                angle = 0.5 * angle
            rotation[:, skeleton.index(f"{side}_{part}")] = quaternion_exp(sign * angle[:, None] * axis)
    heading = quaternion_exp(np.array([0.0, rng.uniform(-np.pi, np.pi), 0.0]))
    rotation[:, 0] = quaternion_multiply(heading, quaternion_exp(np.array(LYING[how])))
    pose = Pose(skeleton, np.zeros((frames, 3)), rotation)
    places = np.asarray(forward_kinematics(pose)[0])
    root = np.zeros((frames, 3))
    root[:, 1] = -(places[:, skeleton.indices(BODY), 1] - clearance_of(BODY)).min()
    return replace(clip, name=how, pose=Pose(skeleton, root, rotation), frame_rate=rate)
