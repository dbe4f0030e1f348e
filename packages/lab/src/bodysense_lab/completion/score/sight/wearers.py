"""Wearers of recorded headsets, with hands held to the head."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics, standing_pose
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
# Recordings of people who stand and play.
TAKES = ("quest2_traj1", "quest2_traj2", "quest_pro_traj1", "quest_pro_traj2")
FILE = "headset_takes.npz"
LONGEST = 60.0  # s of each recording
HEIGHT = 1.70  # m, of the wearers
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
    eyes = eyes * skeleton.extent / default_skeleton().extent
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
            offset = _GRIP * [sign, 1.0, 1.0] * skeleton.extent / default_skeleton().extent
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
