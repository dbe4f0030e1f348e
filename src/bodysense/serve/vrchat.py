"""A body as the trackers that VRChat takes by OSC: hip, chest, feet, knees, elbows and the head (docs/avatars.md).

Source: VRChat's documentation, *OSC Trackers*: world positions in metres and Euler angles in degrees in Unity's axes.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.serve.osc import PacketForm
from bodysense.serve.unity import one_finite_pose, unity_euler, unity_position

PORT = 9000
# Where each tracker is, and which joint turns it: on a person knees' trackers sit on thighs, elbows' on upper arms.
TRACKERS: dict[str, tuple[str, str]] = {
    "1": ("pelvis", "pelvis"),
    "2": ("left_ankle", "left_ankle"),
    "3": ("right_ankle", "right_ankle"),
    "4": ("left_knee", "left_hip"),
    "5": ("right_knee", "right_hip"),
    "6": ("spine3", "spine3"),
    "7": ("left_elbow", "left_shoulder"),
    "8": ("right_elbow", "right_shoulder"),
    "head": ("head", "head"),  # the joint, not the eyes: VRChat aligns it with the avatar's head bone
}


def vrchat_packets(
    pose: Pose, world: tuple[np.ndarray, np.ndarray] | None = None, trackers: Collection[str] = tuple(TRACKERS)
) -> list[bytes]:
    """One pose as packets of OSC: `trackers`, by their numbers, and the head.

    `world`: places (P, 3) m of its points and rotations (J, 4) wxyz of its joints, if they are known. Raises
    BodysenseError for a skeleton that lacks a joint, and for a pose that is not one frame of finite numbers.
    """
    one_finite_pose(pose)
    points, turns = forward_kinematics(pose) if world is None else world
    wanted = tuple(name for name in TRACKERS if name in trackers or name == "head")
    places = pose.skeleton.indices([TRACKERS[name][0] for name in wanted])
    joints = pose.skeleton.indices([TRACKERS[name][1] for name in wanted])
    return _form(wanted).filled(np.hstack([unity_position(points[places]), unity_euler(turns[joints])]).ravel())


@lru_cache(maxsize=64)
def _form(trackers: tuple[str, ...]) -> PacketForm:
    """What is sent but for where the trackers are and how they are turned."""
    rows = [(f"/tracking/trackers/{name}/{what}", "fff", ()) for name in trackers for what in ("position", "rotation")]
    return PacketForm(rows)
