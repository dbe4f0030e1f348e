"""Conversion of devices' points, above all WebXR's, to points of the tracker, and the placement of the signal's world.

Axes of WebXR and OpenXR: the viewer and every joint of a hand look along −Z, with +Y up (out of the back of a hand). A
grip's −Z points to the thumb's end of a held rod, its +X out of the back of a right hand (WebXR device API,
`gripSpace`; WebXR hand input, 4.1). Ours: the identity in the T-pose, facing +Z, left hand toward +X, palms down.

A placement follows from the headset: the origin, and how far a seated wearer is raised.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.hand import glove_marker
from bodysense.body.skeleton import Skeleton, default_body, default_skeleton
from bodysense.geometry.products import CONJUGATE, MATRIX, multiply, rotate
from bodysense.geometry.rotation import matrix_to_quaternion
from bodysense.io.formats.protocol import (
    ACCURACY_UNIT,
    HAS_POSITION,
    HAS_ROTATION,
    MOST_POINTS,
    ProtocolError,
    SignalFrame,
)
from bodysense.observing.observation import CAMERA_ACCURACY, TRACKER_ACCURACY, Observation, usual_accuracy
from bodysense.observing.raw_poses import AXES
from bodysense_live.sessions.inertial import IMUS

IDENTITY, ZERO = np.array([1.0, 0, 0, 0]), np.zeros(3)
# q @ _RIGHT, as a 4×4 matrix M: p @ M is the quaternion product p · q.
_RIGHT = np.array([multiply(np.eye(4), np.repeat(unit[None], 4, axis=0)).ravel() for unit in np.eye(4)])
_NO_POSITION, _NO_ROTATION = ZERO.astype(np.float32), IDENTITY.astype(np.float32)
_CARRIERS = (
    "pelvis",
    "spine3",
    *(f"{side}_{part}" for part in ("ankle", "knee", "elbow") for side in ("left", "right")),
)
# Strapped trackers by name → joint. Their rotations are used once their mounting is known.
TRACKERS = {"hip": "pelvis", "waist": "pelvis", "chest": "spine3"} | {f"{joint}_tracker": joint for joint in _CARRIERS}
UNASSIGNED = tuple(f"tracker_{k}" for k in range(1, 9))  # trackers whose joints calibration finds
STRAPPED = (*TRACKERS, *UNASSIGNED)
_SEGMENTS = {"phalanx-proximal": "1", "phalanx-intermediate": "2", "phalanx-distal": "3", "tip": "_tip"}
_THUMB = {"metacarpal": "1", "phalanx-proximal": "2", "phalanx-distal": "3", "tip": "_tip"}
# Axes x, y, z of a device's frame, as columns, if the wearer is in the T-pose.
_LOOKING = np.array(AXES["headset"])
_HAND = {"left": [[0.0, 0, -1], [0, 1, 0], [1, 0, 0]], "right": [[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]}
_GRIP = {side: AXES[f"{side}_controller"] for side in ("left", "right")}


@dataclass(frozen=True, eq=False)
class PointMapping:
    """The conversion of a signal's N points to M points of the tracker."""

    points: tuple[str, ...]  # M, of the tracker
    target: np.ndarray  # (N,) index into `points`; -1 for unused points
    turn: np.ndarray  # (N, 4) wxyz, device ← our point
    shift: np.ndarray  # (N, 3) m from the device to our point, in our point's frame
    gives_rotation: np.ndarray  # (N,) bool: the device's rotation gives our point's
    accuracy: np.ndarray  # (N,) m, if the device does not send its accuracy
    is_plain: bool  # no point is turned or shifted
    strapped: frozenset[str]  # points that only strapped trackers give


def point_mapping(
    names: Sequence[str], skeleton: Skeleton, tracker_joints: Mapping[str, str] = MappingProxyType({})
) -> PointMapping:
    """Return the conversion of points by their names in a hello. Raises ProtocolError for unknown or repeated names.

    Several names may give one point (a controller, and the wrist of a tracked hand): the last in a frame counts.

    Args:
        names: names of the signal's points.
        skeleton: the wearer's; its size scales the distance of a device from its joint.
        tracker_joints: joints of strapped trackers that are worn elsewhere than their names say, and of unassigned
            ones; '' if a tracker is ignored. Unassigned trackers without a joint keep their names.
    """
    if len(names) > MOST_POINTS:
        raise ProtocolError(f"{len(names)} points; give at most {MOST_POINTS}")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ProtocolError(f"the point {twice[0]!r} is named twice; give it once")
    rows: list[tuple[str, np.ndarray, np.ndarray, bool] | None] = []
    for name in names:
        if name not in STRAPPED:
            rows.append(_device_point(name, skeleton))
            continue
        joint = tracker_joints.get(name, TRACKERS.get(name, name))
        rows.append((joint, IDENTITY, ZERO, True) if joint else None)
    points = tuple(dict.fromkeys(row[0] for row in rows if row is not None))
    not_strapped = {row[0] for name, row in zip(names, rows, strict=True) if row is not None and name not in STRAPPED}
    used = [(points.index(row[0]), *row[1:]) if row is not None else (-1, IDENTITY, ZERO, False) for row in rows]
    target, turn, shift, gives_rotation = zip(*used, strict=True) if used else ((), (), (), ())
    turns, shifts = np.array(turn).reshape(-1, 4), np.array(shift).reshape(-1, 3)
    # cameras track the joints of WebXR's hands
    return PointMapping(
        points,
        np.array(target, dtype=int),
        turns,
        shifts,
        np.array(gives_rotation, dtype=bool),
        np.array(
            [(CAMERA_ACCURACY if ":" in name else float(usual_accuracy([name])[0])) for name in names], dtype=float
        ),
        bool((turns == IDENTITY).all() and not shifts.any()),
        frozenset(points) - not_strapped,
    )


@dataclass(frozen=True)
class Placement:
    """How the signal's world is moved into the body's: body = Ry(heading) · signal + offset."""

    heading: float = 0.0  # rad, about +Y
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m

    @cached_property
    def _matrix(self) -> np.ndarray:
        """(3, 3) matrix of the heading, to be multiplied from the right."""
        sine, cosine = math.sin(self.heading), math.cos(self.heading)
        return np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])

    @cached_property
    def _offset(self) -> np.ndarray:
        """The offset as an array, (3,) m."""
        return np.array(self.offset)

    @cached_property
    def _quaternion(self) -> np.ndarray:
        """The heading as a quaternion, (1, 4) wxyz."""
        return np.array([[math.cos(self.heading / 2), 0.0, math.sin(self.heading / 2), 0.0]])

    def inverse(self) -> Placement:
        """Return the placement from the body's world back into the signal's."""
        back = Placement(-self.heading)
        x, y, z = (-back.place(self._offset[None])[0]).tolist()
        return Placement(-self.heading, (x, y, z))

    def place(self, position: np.ndarray) -> np.ndarray:
        """Return positions (N, 3) m in the body's world."""
        return position @ self._matrix + self._offset

    def turn(self, rotation: np.ndarray) -> np.ndarray:
        """Return rotations (N, 4) wxyz in the body's world."""
        if not self.heading:
            return rotation
        return multiply(np.repeat(self._quaternion, len(rotation), axis=0), rotation)


def to_observation(
    mapping: PointMapping, frame: SignalFrame, visible: np.ndarray, placement: Placement, time: float
) -> Observation:
    """Convert a signal frame to an observation of one frame at `time` s; drop points with false `visible` (N,)."""
    layout = _frame_layout(mapping, frame.point.astype(np.uint8).tobytes(), visible.tobytes())
    has, position, rotation, accuracy = frame.has, frame.position, frame.rotation, layout.accuracy
    if layout.use is not None:
        has, position, rotation = has[layout.use], position[layout.use], rotation[layout.use]
    if frame.accuracy is not None and frame.accuracy.any():
        reported = frame.accuracy if layout.use is None else frame.accuracy[layout.use]
        accuracy = np.where(reported > 0, ACCURACY_UNIT * reported, accuracy)
    is_complete = has.tobytes() == layout.complete
    if is_complete:
        has_position, has_rotation = layout.all, layout.all
    else:
        has_position, has_rotation = has & HAS_POSITION != 0, has & HAS_ROTATION != 0
        # Values of untracked points may be anything, so they are replaced before computing.
        position = np.where(has_position[:, None], position, _NO_POSITION)
        rotation = np.where(has_rotation[:, None], rotation, _NO_ROTATION)
    position, rotation = position.astype(float), rotation.astype(float)
    if len(has):
        rotation /= np.sqrt(np.vecdot(rotation, rotation))[:, None]
        if not mapping.is_plain:
            rotation = (rotation[:, None, :] @ layout.turn)[:, 0]
            shift = (rotation[:, :, None] * rotation[:, None, :]).reshape(-1, 1, 16) @ layout.shift
            # Without the device's rotation its own position is the best guess of our point's.
            position += shift[:, 0] if is_complete else shift[:, 0] * has_rotation[:, None]
            has_rotation = has_rotation & layout.gives_rotation
        position, rotation = placement.place(position), placement.turn(rotation)
    moment = np.array([time])
    if is_complete and layout.is_whole:
        return Observation(
            points=mapping.points,
            position=position[None],
            rotation=rotation[None],
            has_position=has_position[None],
            has_rotation=has_rotation[None],
            accuracy=accuracy[None],
            time=moment,
        )
    count, target = len(mapping.points), layout.target
    places, turns = np.full((1, count, 3), np.nan), np.full((1, count, 4), np.nan)
    known, turned = np.zeros((1, count), dtype=bool), np.zeros((1, count), dtype=bool)
    places[0, target[has_position]], turns[0, target[has_rotation]] = position[has_position], rotation[has_rotation]
    known[0, target[has_position]], turned[0, target[has_rotation]] = True, True
    errors = np.full((1, count), TRACKER_ACCURACY)
    errors[0, target[has_position]] = accuracy[has_position]
    return Observation(mapping.points, places, turns, known, turned, errors, moment)


class _FrameLayout(NamedTuple):
    """Values that frames with equal points share. K of the points are used."""

    use: np.ndarray | None  # (N,) bool; None if all are used
    target: np.ndarray  # (K,) index into the points of the mapping
    turn: np.ndarray  # (K, 4, 4): q @ turn is our point's rotation, for a device's rotation q
    shift: np.ndarray  # (K, 16, 3): (q qᵀ) @ shift is our point from the device, m, for our point's rotation q
    gives_rotation: np.ndarray  # (K,) bool
    accuracy: np.ndarray  # (K,) m; read-only, because frames share it
    is_whole: bool  # the K points are all points of the mapping, in order, with rotations
    complete: bytes  # the frame's `has` if all points have position and rotation
    all: np.ndarray  # (K,) True; read-only, because frames share it


@lru_cache(maxsize=1024)
def _frame_layout(mapping: PointMapping, point: bytes, visible: bytes) -> _FrameLayout:
    rows = np.frombuffer(point, dtype=np.uint8)
    use = (mapping.target[rows] >= 0) & np.frombuffer(visible, dtype=bool)[rows]
    rows = rows[use]
    target, gives_rotation, every = mapping.target[rows], mapping.gives_rotation[rows], np.ones(len(rows), dtype=bool)
    accuracy = mapping.accuracy[rows]
    every.setflags(write=False)
    accuracy.setflags(write=False)
    return _FrameLayout(
        None if use.all() else use,
        target,
        (mapping.turn[rows] @ _RIGHT).reshape(-1, 4, 4),
        np.einsum("cij,kj->kci", MATRIX.reshape(16, 3, 3), mapping.shift[rows]),
        gives_rotation,
        accuracy,
        bool(gives_rotation.all()) and target.tolist() == list(range(len(mapping.points))),
        bytes([HAS_POSITION | HAS_ROTATION] * len(rows)),
        every,
    )


def _device_point(name: str, skeleton: Skeleton) -> tuple[str, np.ndarray, np.ndarray, bool] | None:
    """Return a device's point, turn, shift and `gives_rotation` (see `PointMapping`); None for an unused device."""
    size = skeleton.height / default_skeleton().height
    if name == "headset":
        return "head", _inverse(_LOOKING), -size * _landmark("between_eyes"), True
    side, _, rest = name.partition("_")
    if rest == "controller" and side in _GRIP:
        return f"{side}_wrist", _inverse(_GRIP[side]), -size * _landmark(f"{side}_palm"), True
    if name in IMUS:
        return name, IDENTITY, ZERO, True
    if glove_marker(name) is not None:
        return name, IDENTITY, ZERO, False
    side, colon, rest = name.partition(":")
    if colon:
        return _webxr_hand_point(name, side, rest)
    if name not in skeleton.points:
        raise ProtocolError(f"the point {name!r} is unknown; see docs/protocol.md for the names")
    return name, IDENTITY, ZERO, name in skeleton.joints


def _webxr_hand_point(name: str, side: str, rest: str) -> tuple[str, np.ndarray, np.ndarray, bool] | None:
    """Return the same for a joint of WebXR's hand. Fingers give only positions: their axes differ from bone to bone."""
    if side not in _HAND:
        raise ProtocolError(f"the point {name!r} names no hand; begin it with 'left:' or 'right:'")
    if rest == "wrist":
        return f"{side}_wrist", _inverse(_HAND[side]), ZERO, True
    finger, _, segment = rest.partition("-")
    segment = segment.removeprefix("finger-") if finger != "thumb" else segment
    table = _THUMB if finger == "thumb" else _SEGMENTS
    known = finger == "thumb" or (
        finger in ("index", "middle", "ring", "pinky") and rest == f"{finger}-finger-{segment}"
    )
    if known and segment == "metacarpal" and finger != "thumb":
        return None
    if not known or segment not in table:
        raise ProtocolError(f"the point {name!r} is not a joint of WebXR's hands; see docs/protocol.md for the names")
    return f"{side}_{finger}{table[segment]}", IDENTITY, ZERO, False


def _inverse(axes: Sequence[Sequence[float]] | np.ndarray) -> np.ndarray:
    """Return (4,) wxyz, device ← our point, from the device's axes (columns) in the T-pose."""
    return matrix_to_quaternion(np.array(axes, dtype=float)) * CONJUGATE


def between_eyes(skeleton: Skeleton) -> np.ndarray:
    """Return the point between the eyes, (3,) m from the head's joint, in its axes."""
    return skeleton.height / default_skeleton().height * _landmark("between_eyes")


@lru_cache(maxsize=8)
def _landmark(name: str) -> np.ndarray:
    """Return a landmark's position on the default body, (3,) m from its joint."""
    return next(np.array(row["offset"]) for row in default_body()["landmarks"] if row["name"] == name)


def recentred(placement: Placement, raw: Observation) -> Placement:
    """Return the placement in which the head is over the origin and faces +Z. `raw`: a frame in the signal's world."""
    head = raw.points.index("head")
    ahead = rotate(raw.rotation[0, [head]], np.array([[0.0, 0, 1]]))[0]
    has_heading = raw.has_rotation[0, head] and math.hypot(ahead[0], ahead[2]) > 0.1
    heading = -math.atan2(ahead[0], ahead[2]) if has_heading else 0.0
    turned = Placement(heading).place(raw.position[:, head])[0]
    return Placement(heading, (-float(turned[0]), placement.offset[1], -float(turned[2])))


def raised(placement: Placement, raw: Observation, standing: float | None) -> Placement:
    """Return the placement in which the head is at height `standing` (m); None: the placement without raising."""
    up = 0.0 if standing is None else standing - float(raw.position[0, raw.points.index("head"), 1])
    x, _, z = placement.offset
    return replace(placement, offset=(x, up, z))
