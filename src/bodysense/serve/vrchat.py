"""A body as the trackers that VRChat takes by OSC: hip, chest, feet, knees, elbows and the head (docs/avatars.md).

Source: VRChat's documentation, *OSC Trackers*: world positions in metres and Euler angles in degrees in Unity's axes.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.capture.osc import bundled, message_bytes
from bodysense.serve.unity import one_finite_pose, unity_euler, unity_position

PORT = 9000
# Where each tracker is, and which joint turns it: on a person knees' trackers sit on thighs, elbows' on upper arms.
TRACKERS: dict[str, tuple[str, str]] = {
    "1": ("pelvis", "pelvis"),
    "2": ("spine3", "spine3"),
    "3": ("left_ankle", "left_ankle"),
    "4": ("right_ankle", "right_ankle"),
    "5": ("left_knee", "left_hip"),
    "6": ("right_knee", "right_hip"),
    "7": ("left_elbow", "left_shoulder"),
    "8": ("right_elbow", "right_shoulder"),
    "head": ("head", "head"),  # the joint, not the eyes: VRChat aligns it with the avatar's head bone
}


def vrchat_packets(pose: Pose, points: np.ndarray | None = None) -> list[bytes]:
    """One pose as packets of OSC: eight trackers and the head; `points` (P, 3) m says where they are, if it is known.

    Raises BodysenseError for a skeleton that lacks a joint, and for a pose that is not one frame of finite numbers.
    """
    one_finite_pose(pose)
    places = pose.skeleton.indices([place for place, _ in TRACKERS.values()])
    turns = pose.skeleton.indices([turn for _, turn in TRACKERS.values()])
    position, rotation = forward_kinematics(pose)
    position, angle = unity_position((position if points is None else points)[places]), unity_euler(rotation[turns])
    messages = []
    for name, place, turn in zip(TRACKERS, position.tolist(), angle.tolist(), strict=True):
        messages.append(message_bytes(f"/tracking/trackers/{name}/position", "fff", *place))
        messages.append(message_bytes(f"/tracking/trackers/{name}/rotation", "fff", *turn))
    return bundled(messages)
