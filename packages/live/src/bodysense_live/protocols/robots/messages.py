"""Bodies as retargeters of humanoid robots read them: GMR's dictionary of a frame, and SONIC's packed message.

Both worlds are right-handed with +Z up. Our world becomes theirs by exchanging axes: our +Z, where a body in the T-pose
faces, is their +X, our +X their +Y, our +Y their +Z. Names and order of the 22 joints are SMPL's, as ours are.

Sources: GMR (Araujo et al. 2025), "Human/Robot Motion Data Formulation" of its README; NVIDIA's GR00T-WholeBodyControl,
"Streaming Motion Tracking", protocol version 3.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Literal

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import BODY
from bodysense.geometry.products import log
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
)

RobotFormat = Literal["gmr", "sonic"]
PORT = 5556  # the port at which SONIC looks for a publisher
TOPIC = b"pose"
HEADER = 1280  # bytes of SONIC's header, filled with zeros
_TO_ROBOT = np.array([0.5, 0.5, 0.5, 0.5])  # world of robots ← ours: x, y, z become y, z, x
_HANDS = ("left_middle1", "right_middle1")  # the last two of SMPL's 24 joints
_MOTORS = 29  # of a Unitree G1, in IsaacLab's order


def robot_places(points: np.ndarray) -> np.ndarray:
    """Return positions (..., 3) m in the world of robots."""
    return points[..., [2, 0, 1]]


def gmr_message(pose: Pose, points: np.ndarray, turns: np.ndarray, time: float) -> bytes:
    """Return a body as JSON: `{"time": s, "joints": {name: [[x, y, z], [w, x, y, z]]}}`, metres, global rotations.

    `points` (P, 3) m and `turns` (J, 4) wxyz are in our world. A joint has the identity in the T-pose that faces +X.
    """
    skeleton = pose.skeleton
    place = robot_places(points)
    turned = quaternion_canonical(quaternion_multiply(np.broadcast_to(_TO_ROBOT, turns.shape), turns))
    joints = {
        name: [np.round(part, 6).tolist() for part in (place[skeleton.index(name)], turned[skeleton.index(name)])]
        for name in BODY
    }
    return json.dumps({"time": time, "joints": joints}, separators=(",", ":")).encode()


def sonic_message(pose: Pose, points: np.ndarray, turns: np.ndarray, frame: int) -> bytes:
    """Return one frame of SONIC's protocol 3: topic, header and numbers, little-endian single precision.

    `smpl_joints` are relative to the pelvis and turned back by its rotation; `smpl_pose` are local rotation vectors of
    all joints but the pelvis; `body_quat` is the pelvis, the identity while the body faces +X. Motors' targets are 0:
    of them SONIC reads the wrists alone, which stay straight.
    """
    skeleton = pose.skeleton
    root = quaternion_multiply(
        quaternion_multiply(_TO_ROBOT, turns[skeleton.index("pelvis")]), quaternion_conjugate(_TO_ROBOT)
    )
    joints = robot_places(points[skeleton.indices((*BODY, *_HANDS))])
    back = np.broadcast_to(quaternion_conjugate(root), (len(joints), 4))
    local = quaternion_rotate(back, joints - joints[0])
    rotation = np.asarray(pose.rotation)[skeleton.indices(BODY[1:])]
    none = np.zeros((1, _MOTORS))
    return packed(
        {
            "body_quat": quaternion_canonical(root)[None],
            "frame_index": np.array([frame]),
            "joint_pos": none,
            "joint_vel": none,
            "smpl_joints": local[None],
            "smpl_pose": log(rotation)[None],
        }
    )


def packed(fields: Mapping[str, np.ndarray], version: int = 3) -> bytes:
    """Return topic, header and numbers of SONIC's packed message; integers become i32, other numbers f32."""
    columns = {name: values.astype("<i4" if values.dtype.kind == "i" else "<f4") for name, values in fields.items()}
    listed = [
        {"name": name, "dtype": "i32" if values.dtype.kind == "i" else "f32", "shape": list(values.shape)}
        for name, values in columns.items()
    ]
    header = json.dumps({"v": version, "endian": "le", "count": 1, "fields": listed}, separators=(",", ":")).encode()
    assert len(header) <= HEADER
    return TOPIC + header.ljust(HEADER, b"\0") + b"".join(values.tobytes() for values in columns.values())
