"""A body as the trackers that VRChat takes by OSC: hip, chest, feet, knees, elbows and the head (docs/avatars.md).

Source: VRChat's documentation, *OSC Trackers*: world positions in metres and Euler angles in degrees in Unity's axes.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.serve.osc import bundled, message_bytes
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
    wanted = {name: where for name, where in TRACKERS.items() if name in trackers or name == "head"}
    places = pose.skeleton.indices([place for place, _ in wanted.values()])
    joints = pose.skeleton.indices([turn for _, turn in wanted.values()])
    position, angle = unity_position(points[places]), unity_euler(turns[joints])
    messages = []
    for name, place, turn in zip(wanted, position.tolist(), angle.tolist(), strict=True):
        messages.append(message_bytes(f"/tracking/trackers/{name}/position", "fff", *place))
        messages.append(message_bytes(f"/tracking/trackers/{name}/rotation", "fff", *turn))
    return bundled(messages)
