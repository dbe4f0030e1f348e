"""A body as SolarXR tells of it: synthetic trackers, and bones from the joint that is nearer to the head.

Axes are a driver's: a segment that hangs down and faces −Z has the identity, and a bone points along its −Y.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bodysense.body.products import multiply, rotate
from bodysense.body.rotation import quaternion_exp, quaternion_multiply, shortest_arc
from bodysense.body.skeleton import Skeleton
from bodysense.serve.driver_axes import ABOUT_Y
from bodysense.serve.solarxr import Moved, Told

Places = Mapping[str, np.ndarray]  # by the names of points or joints
_DOWN = np.array([0.0, -1.0, 0.0])
# Ours has the identity with arms level, theirs with arms that hang.
_HANGING = {side: quaternion_exp(np.array([0.0, 0.0, sign * np.pi / 2])) for side, sign in (("left", 1), ("right", -1))}
TRACKERS: tuple[tuple[int, str, str, str], ...] = (  # body part, name, where it is, which joint turns it
    (5, "waist", "pelvis", "pelvis"),
    (22, "chest", "spine3", "spine3"),
    (10, "left foot", "left_ankle", "left_ankle"),
    (11, "right foot", "right_ankle", "right_ankle"),
    (6, "left knee", "left_knee", "left_hip"),
    (7, "right knee", "right_knee", "right_hip"),
    (16, "left elbow", "left_elbow", "left_shoulder"),
    (17, "right elbow", "right_elbow", "right_shoulder"),
)


@dataclass(frozen=True)
class _Bone:
    body_part: int
    start: str
    end: str
    turn: str  # the joint that turns it
    rest: tuple[float, float, float] = (0.0, -1.0, 0.0)  # where it points on somebody who stands, facing −Z


def _sided(number: int, start: str, end: str, turn: str, rest: tuple[float, float, float] = (0, -1, 0)) -> list[_Bone]:
    """The bones of both sides: the left one's number is the lower."""
    x, y, z = rest
    return [
        _Bone(number + k, f"{side}_{start}", f"{side}_{end}", f"{side}_{turn}", (sign * x, y, z))
        for k, side, sign in ((0, "left", 1), (1, "right", -1))
    ]


BONES: tuple[_Bone, ...] = (
    _Bone(2, "head", "neck", "neck"),
    _Bone(22, "neck", "spine3", "spine3"),
    _Bone(3, "spine3", "spine2", "spine2"),
    _Bone(4, "spine2", "spine1", "spine1"),
    _Bone(5, "spine1", "pelvis", "pelvis"),
    *_sided(20, "collar", "shoulder", "collar", (-1, 0, 0)),
    *_sided(16, "shoulder", "elbow", "shoulder"),
    *_sided(14, "elbow", "wrist", "elbow"),
    *_sided(18, "wrist", "middle1", "wrist"),
    *_sided(6, "hip", "knee", "hip"),
    *_sided(8, "knee", "ankle", "knee"),
    *_sided(10, "ankle", "foot", "ankle", (0, 0, -1)),
)
_HEAD = 1  # from between the eyes back to the joint
_ON_ARMS = ("shoulder", "elbow", "wrist")
_PLACES = [place for _, _, place, _ in TRACKERS]
_STARTS, _ENDS = [bone.start for bone in BONES], [bone.end for bone in BONES]
_TURNS = [*(turn for _, _, _, turn in TRACKERS), "head", *(bone.turn for bone in BONES)]
_REST = np.array([(0.0, 0.0, 1.0), *(bone.rest for bone in BONES)])  # (1 + B, 3)


def _to_segment(joint: str) -> np.ndarray:
    """(4,) what turns a joint's axes into those of its segment in a driver's world."""
    side, _, part = joint.partition("_")
    return quaternion_multiply(_HANGING[side], ABOUT_Y) if part in _ON_ARMS else ABOUT_Y


_SEGMENTS = np.array([_to_segment(joint) for joint in _TURNS])
_TO_BONE = np.asarray(shortest_arc(np.broadcast_to(_DOWN, _REST.shape), _REST))


def told_of(skeleton: Skeleton, eyes: np.ndarray) -> Told:
    """What is told of a body; `eyes` (3,) m from the head's joint."""
    rest = skeleton.path @ skeleton.rest_offset
    apart = np.linalg.norm(rest[skeleton.indices(_ENDS)] - rest[skeleton.indices(_STARTS)], axis=1)
    bones = zip((bone.body_part for bone in BONES), apart.tolist(), strict=True)
    trackers = tuple((part, name) for part, name, _, _ in TRACKERS)
    return Told(trackers, ((_HEAD, float(np.linalg.norm(eyes))), *bones))


def moved(points: Places, turns: Places, eyes: np.ndarray) -> Moved:
    """Trackers and bones of a body, from places (3,) m and rotations (4,) wxyz in the runtime's world."""
    segments = multiply(np.array([turns[joint] for joint in _TURNS]), _SEGMENTS)
    at_eyes = points["head"] + rotate(turns["head"][None], eyes[None])[0]
    start = np.array([at_eyes, *(points[name] for name in _STARTS)])
    along = np.array([points["head"], *(points[name] for name in _ENDS)]) - start
    turned = multiply(segments[len(TRACKERS) :], _TO_BONE)
    now = rotate(turned, _DOWN[None])
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    return Moved(
        place=np.array([points[name] for name in _PLACES]),
        turn=_wire(segments[: len(TRACKERS)]),
        head=start,
        along=_wire(multiply(np.asarray(shortest_arc(now, along)), turned)),
    )


def _wire(rotation: np.ndarray) -> np.ndarray:
    return np.roll(rotation, -1, axis=-1)
