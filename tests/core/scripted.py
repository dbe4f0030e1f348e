"""Scripted wearers with truth: bowing, kneeling and standing still, of any height."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.geometry.rotation import (
    euler_to_quaternion,
    quaternion_multiply,
    quaternion_rotate,
    slerp,
    smooth_step,
)
from bodysense.tracking.estimate import Estimate
from bodysense.tracking.tracker import Tracker

RATE = 30.0
SIDES = ("left", "right")
PARTS = ("ankle", "foot", "toe")


def body_of(height: float) -> Skeleton:
    """The likeliest body of a height, m."""
    return Person(height=height).skeleton


def posed(skeleton: Skeleton, turns: Mapping[str, tuple[float, float, float]], seconds: float = 7.0) -> Pose:
    """A body that stands, takes on local turns (degrees about x, y, z) from 1.5 to 3 s, and stands again at the end.

    Its ankles stay where they are on average.
    """
    time = np.arange(round(seconds * RATE)) / RATE
    share = smooth_step(np.clip((time - 1.5) / 1.5, 0, 1)) - smooth_step(np.clip((time - seconds + 2) / 1.5, 0, 1))
    pose = standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (len(time), 1, 1))
    for joint, turn in turns.items():
        place = skeleton.index(joint)
        rotation[:, place] = slerp(rotation[:, place], euler_to_quaternion(np.radians(turn)[None, ::-1], "ZYX"), share)
    root = np.tile(pose.root_position, (len(time), 1))
    ankles = skeleton.indices(["left_ankle", "right_ankle"])
    middle = np.asarray(forward_kinematics(Pose(skeleton, root, rotation))[0])[:, ankles].mean(axis=1)
    return Pose(skeleton, root + middle[0] - middle, rotation)


def bowing(skeleton: Skeleton, pitch: float) -> Pose:
    """A body that bows with straight legs by `pitch` degrees, the pelvis behind the feet, the hands hanging."""
    turns = {"pelvis": (0.75 * pitch, 0.0, 0.0), "spine1": (0.15 * pitch, 0, 0), "spine2": (0.1 * pitch, 0, 0)}
    for side, sign in (("left", 1), ("right", -1)):
        turns |= {f"{side}_hip": (12 - 0.75 * pitch, 0, 0), f"{side}_ankle": (-12.0, 0, 0)}
        turns[f"{side}_shoulder"] = (0.0, -sign * 40.0, -sign * 60.0)
    return posed(skeleton, turns)


def carried(skeleton: Skeleton, yaw: np.ndarray, aside: np.ndarray) -> Pose:
    """A standing body that a platform turns about its middle (degrees, T) and moves to its left (m, T)."""
    time, pose = np.arange(len(yaw)), standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (len(time), 1, 1))
    for side, sign in (("left", 1), ("right", -1)):
        hanging = euler_to_quaternion(np.radians([0.0, 0.0, -sign * 60.0])[None, ::-1], "ZYX")
        rotation[:, skeleton.index(f"{side}_shoulder")] = hanging
    turn = euler_to_quaternion(np.radians(np.stack([yaw, 0 * yaw, 0 * yaw], axis=-1)), "YXZ")
    rotation[:, 0] = quaternion_multiply(turn, rotation[:, 0])
    moved = np.stack([aside, 0 * aside, 0 * aside], axis=-1)
    return Pose(skeleton, np.asarray(quaternion_rotate(turn, pose.root_position)) + moved, rotation)


def tracked(pose: Pose, device: str | SensorSet, person: Person | None = None) -> Estimate:
    """The estimate of a device's observation of a motion; of a known body if no person is given."""
    time = np.arange(len(pose.root_position)) / RATE
    seen = observe(pose, time, SENSOR_SETS[device] if isinstance(device, str) else device)
    tracker = Tracker(Person(pose.skeleton) if person is None else person)
    return tracker.step(seen, tracker.start())[0]


def over_rest(skeleton: Skeleton, points: np.ndarray) -> np.ndarray:
    """How high the lower of ankle and ball of each foot (T, 2) is over its height at rest, m, for points (T, 65, 3)."""
    rest = skeleton.rest_offset[0, 1] + (skeleton.path @ skeleton.rest_offset)[:, 1]
    index = skeleton.indices([f"{side}_{part}" for part in PARTS[:2] for side in SIDES])
    return (points[:, index, 1] - rest[index]).reshape(-1, 2, 2).min(axis=1)


def feet(skeleton: Skeleton, points: np.ndarray) -> np.ndarray:
    """Ankles, balls and toes (T, 6, 3) of points (T, 65, 3)."""
    return points[:, skeleton.indices([f"{side}_{part}" for part in PARTS for side in SIDES])]
