"""Scripted wearers: standing, seated, with raised arms, and recorded headset paths with hands held to the head.

Only the headset paths are real; they are read from a folder of recordings.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton, default_body, default_skeleton
from bodysense.devices.simulated.sensors import WRISTS
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    heading,
    quaternion_canonical,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.observing.observation import HEADSET_ACCURACY, Observation, accuracy_like
from bodysense_lab.core.scoring import RATE

Palms = Literal["none", "hanging", "inward", "down"]
PALMS: tuple[Palms, ...] = ("none", "hanging", "inward", "down")
RaiseDirection = Literal["ahead", "sideways"]
RAISES: tuple[RaiseDirection, ...] = ("ahead", "sideways")
# Recordings of people who stand and play.
TAKES = ("quest2_traj1", "quest2_traj2", "quest_pro_traj1", "quest_pro_traj2")
FILE = "headset_takes.npz"
LONGEST = 60.0  # s of each recording
HEIGHT = 1.70  # m, of wearers whose height is not varied
_GRIP = np.array([0.11, -0.50, 0.28])  # m from the head to the left wrist, in front of the body, of a wearer of HEIGHT
_SIGNS = {"left_wrist": 1.0, "right_wrist": -1.0}


@dataclass(frozen=True, eq=False)
class HeadPath:
    """Path of a head joint at `RATE`, with the feet on y = 0."""

    name: str
    position: np.ndarray  # (T, 3) m
    rotation: np.ndarray  # (T, 4) wxyz


def known_body(height: float) -> Skeleton:
    """Return the likeliest proportions for a height, m."""
    return Person(height=height).skeleton


def rest_heights(skeleton: Skeleton) -> np.ndarray:
    """Return the heights (P,) of the points over the floor in the rest pose, m."""
    return skeleton.rest_offset[0, 1] + (skeleton.path @ skeleton.rest_offset)[:, 1]


def head_paths(folder: Path, skeleton: Skeleton) -> Iterator[HeadPath]:
    """Yield the head paths of `TAKES`, shifted so that the head of the skeleton stands at their 95th percentile.

    Raises BodysenseError if the folder has no recordings of headsets.
    """
    path = folder / FILE
    if not path.is_file():
        raise BodysenseError(
            f"--headset {folder}: it has no {FILE}; give the folder of recorded headsets, or leave it out"
        )
    eyes = next(np.array(row["offset"]) for row in default_body()["landmarks"] if row["name"] == "between_eyes")
    eyes = eyes * skeleton.height / default_skeleton().height
    standing = float(rest_heights(skeleton)[skeleton.index("head")])
    with np.load(path, allow_pickle=False) as stored:
        for name in TAKES:
            begin, end = stored[f"{name}__moving_from_to_s"]
            time, end = stored[f"{name}__time_s"].astype(float), min(end, begin + LONGEST)
            # Take recorded frames without interpolation: they are at 72 Hz.
            chosen = np.searchsorted(time, np.arange(begin, min(end, time[-1]), 1 / RATE))
            rotation = stored[f"{name}__device_quat_xyzw"][chosen][:, [3, 0, 1, 2]].astype(float)
            rotation = quaternion_canonical(rotation / np.linalg.norm(rotation, axis=-1, keepdims=True))
            position = stored[f"{name}__device_pos_m"][chosen].astype(float)
            position = position - quaternion_rotate(rotation, np.broadcast_to(eyes, position.shape))
            position[:, 1] += standing - np.percentile(position[:, 1], 95)
            yield HeadPath(name, position, rotation)


def with_hands(path: HeadPath, palms: Palms, skeleton: Skeleton) -> Observation:
    """Return the observation of a head path and of wrists held rigidly to it.

    The wrists are in front of the body with palms down or inward, or hanging. `none` has no wrists.
    """
    count = len(path.position)
    turn = np.asarray(heading(path.rotation))
    standing, turned = forward_kinematics(standing_pose(skeleton))
    names, position, rotation = ["head"], [path.position], [path.rotation]
    for name in WRISTS if palms != "none" else ():
        place, sign = skeleton.index(name), _SIGNS[name]
        if palms == "hanging":
            offset, held = standing[place] - standing[skeleton.index("head")], turned[place]
        else:
            offset = _GRIP * [sign, 1.0, 1.0] * skeleton.height / default_skeleton().height
            held = quaternion_exp(np.array([0.0, -sign * np.pi / 2, 0.0]))  # fingers ahead, palm down
            if palms == "inward":
                held = quaternion_multiply(quaternion_exp(np.array([0.0, 0.0, -sign * np.pi / 2])), held)
        names.append(name)
        position.append(path.position + quaternion_rotate(turn, np.broadcast_to(offset, (count, 3))))
        rotation.append(quaternion_multiply(turn, np.broadcast_to(held, (count, 4))))
    tracked = np.ones((count, len(names)), dtype=bool)
    return Observation(
        points=tuple(names),
        position=np.stack(position, axis=1),
        rotation=quaternion_canonical(np.stack(rotation, axis=1)),
        has_position=tracked,
        has_rotation=tracked.copy(),
        accuracy=accuracy_like(tracked, HEADSET_ACCURACY),
        time=np.arange(count) / RATE,
    )


def standing_head(skeleton: Skeleton, lowered: float) -> HeadPath:
    """Return a still head, 3 cm ahead of its position in the rest pose and lowered by `lowered` metres."""
    place = (skeleton.path @ skeleton.rest_offset)[skeleton.index("head")] + [0.0, skeleton.rest_offset[0, 1], 0.03]
    count = round(4.0 * RATE)
    position = np.tile(place - [0.0, lowered, 0.0], (count, 1))
    return HeadPath("standing", position, np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)))


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


def arms_raised(skeleton: Skeleton, way: RaiseDirection) -> Pose:
    """Return a pose sequence of a standing wearer who raises the arms over the shoulders.

    The arms are low in front for 2 s, then rise within 0.7 s, in front of the body or at its sides, to 75°, until 6 s.
    """
    time = np.arange(round(6.0 * RATE)) / RATE
    share = np.clip((time - 2.0) / 0.7, 0, 1)
    share = share**3 * (10 - 15 * share + 6 * share**2)
    up = quaternion_exp(-np.radians(-35 + 110 * share)[:, None] * [1.0, 0.0, 0.0])
    out = np.radians(80) * np.sin(np.pi * share) if way == "sideways" else np.zeros(len(time))
    pose = standing_pose(skeleton)
    rotation = np.tile(pose.rotation, (len(time), 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        ahead = np.broadcast_to(quaternion_exp(np.array([0.0, -sign * np.pi / 2, 0.0])), (len(time), 4))
        aside = quaternion_exp(sign * out[:, None] * [0.0, 1.0, 0.0])
        turned = quaternion_multiply(aside, quaternion_multiply(up, ahead))
        rotation[:, skeleton.index(f"{side}_shoulder")] = turned
    return Pose(skeleton, np.tile(pose.root_position, (len(time), 1)), rotation)
