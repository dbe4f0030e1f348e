"""A body as SolarXR describes it: synthetic trackers, and bones that start at the joint nearer to the head.

Axes are a driver's: a segment that hangs down and faces −Z has the identity rotation, and a bone points along its −Y.
Source: the public schema SolarXR-Protocol and its driver in Monado.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.geometry.products import multiply, rotate
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, shortest_arc
from bodysense_live.protocols.driver_axes import ABOUT_Y
from bodysense_live.protocols.virtual_trackers import TURNED_BY


@dataclass(frozen=True)
class BodyLayout:
    """The constant part of updates: trackers (body part, name) and bones (body part, length in m).

    The last bone is the hip, which older runtimes do not know: body part 0.
    """

    trackers: tuple[tuple[int, str], ...]
    bones: tuple[tuple[int, float], ...]


@dataclass(frozen=True, eq=False)
class BodyFrame:
    """The part that changes with every update: positions in m and rotations xyzw, in the runtime's world."""

    tracker_position: np.ndarray  # (T, 3)
    tracker_rotation: np.ndarray  # (T, 4)
    bone_start: np.ndarray  # (B, 3)
    bone_rotation: np.ndarray  # (B, 4)


Places = Mapping[str, np.ndarray]  # by the names of points or joints
_DOWN = np.array([0.0, -1.0, 0.0])
# Our identity rotation is a level arm, SolarXR's a hanging one.
_HANGING = {side: quaternion_exp(np.array([0.0, 0.0, sign * np.pi / 2])) for side, sign in (("left", 1), ("right", -1))}
TRACKERS: tuple[tuple[int, str, str], ...] = (  # body part, name, point
    (5, "waist", "pelvis"),
    (22, "chest", "spine3"),
    (10, "left foot", "left_ankle"),
    (11, "right foot", "right_ankle"),
    (6, "left knee", "left_knee"),
    (7, "right knee", "right_knee"),
    (16, "left elbow", "left_elbow"),
    (17, "right elbow", "right_elbow"),
)


@dataclass(frozen=True)
class _Bone:
    body_part: int
    start: str
    end: str
    joint: str  # the bone has its rotation
    key: str  # name in SlimeVR 22
    rest: tuple[float, float, float] = (0.0, -1.0, 0.0)  # direction if the body stands and faces −Z


def _sided(
    number: int, start: str, end: str, joint: str, key: str, rest: tuple[float, float, float] = (0, -1, 0)
) -> list[_Bone]:
    """Return the left and right bone; the right one's body part is `number + 1`."""
    x, y, z = rest
    return [
        _Bone(number + k, f"{side}_{start}", f"{side}_{end}", f"{side}_{joint}", f"{side}_{key}", (sign * x, y, z))
        for k, side, sign in ((0, "left", 1), (1, "right", -1))
    ]


BONES: tuple[_Bone, ...] = (
    _Bone(2, "head", "neck", "neck", "neck"),
    _Bone(22, "neck", "spine3", "spine3", "upper_chest"),
    _Bone(3, "spine3", "spine2", "spine2", "lower_chest"),
    _Bone(4, "spine2", "spine1", "spine1", "upper_waist"),
    _Bone(5, "spine1", "pelvis", "pelvis", "lower_waist"),
    *_sided(20, "collar", "shoulder", "collar", "shoulder", (-1, 0, 0)),
    *_sided(16, "shoulder", "elbow", "shoulder", "upper_arm"),
    *_sided(14, "elbow", "wrist", "elbow", "lower_arm"),
    *_sided(18, "wrist", "middle1", "wrist", "hand"),
    *_sided(6, "hip", "knee", "hip", "upper_leg"),
    *_sided(8, "knee", "ankle", "knee", "lower_leg"),
    *_sided(10, "ankle", "foot", "ankle", "foot", (0, 0, -1)),
)
HIP = _Bone(0, "pelvis", "hips", "pelvis", "hip")  # of drivers alone; "hips" is the point between the hips
_ALL = (*BONES, HIP)
_HEAD = 1  # from between the eyes back to the joint
_ARM_JOINTS = ("shoulder", "elbow", "wrist")
_TRACKER_POINTS = [point for _, _, point in TRACKERS]
_STARTS, _ENDS = [bone.start for bone in _ALL], [bone.end for bone in _ALL]
_JOINTS = [*(TURNED_BY[point] for point in _TRACKER_POINTS), "head", *(bone.joint for bone in _ALL)]
_REST = np.array([(0.0, 0.0, 1.0), *(bone.rest for bone in _ALL)])  # (1 + B, 3)


def _to_segment(joint: str) -> np.ndarray:
    """Return the rotation (4,) wxyz from a joint's axes to its segment's axes in a driver's world."""
    side, _, part = joint.partition("_")
    return quaternion_multiply(_HANGING[side], ABOUT_Y) if part in _ARM_JOINTS else ABOUT_Y


_SEGMENTS = np.array([_to_segment(joint) for joint in _JOINTS])
TO_BONE = np.asarray(shortest_arc(np.broadcast_to(_DOWN, _REST.shape), _REST))
# (1 + B, 4) wxyz: turns −Y to the direction of a bone that stands and faces −Z


def body_layout(skeleton: Skeleton, eyes: np.ndarray) -> BodyLayout:
    """Return trackers and bone lengths of a body. `eyes`: point between the eyes, (3,) m from the head's joint."""
    rest = dict(zip(skeleton.points, skeleton.path @ skeleton.rest_offset, strict=True))
    rest["hips"] = (rest["left_hip"] + rest["right_hip"]) / 2
    apart = [float(np.linalg.norm(rest[bone.end] - rest[bone.start])) for bone in _ALL]
    bones = zip((bone.body_part for bone in _ALL), apart, strict=True)
    trackers = tuple((part, name) for part, name, _ in TRACKERS)
    return BodyLayout(trackers, ((_HEAD, float(np.linalg.norm(eyes))), *bones))


def body_frame(points: Places, turns: Places, eyes: np.ndarray) -> BodyFrame:
    """Return the poses of trackers and bones from positions (3,) m and rotations (4,) wxyz in the runtime's world."""
    points = {**points, "hips": (points["left_hip"] + points["right_hip"]) / 2}
    segments = multiply(np.array([turns[joint] for joint in _JOINTS]), _SEGMENTS)
    at_eyes = points["head"] + rotate(turns["head"][None], eyes[None])[0]
    start = np.array([at_eyes, *(points[name] for name in _STARTS)])
    direction = np.array([points["head"], *(points[name] for name in _ENDS)]) - start
    turned = multiply(segments[len(TRACKERS) :], TO_BONE)
    now = rotate(turned, _DOWN[None])
    direction = direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-9)
    return BodyFrame(
        tracker_position=np.array([points[name] for name in _TRACKER_POINTS]),
        tracker_rotation=_to_xyzw(segments[: len(TRACKERS)]),
        bone_start=start,
        bone_rotation=_to_xyzw(multiply(np.asarray(shortest_arc(now, direction)), turned)),
    )


def _to_xyzw(rotation: np.ndarray) -> np.ndarray:
    return np.roll(rotation, -1, axis=-1)
