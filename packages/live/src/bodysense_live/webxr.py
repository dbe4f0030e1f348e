"""Conversion of devices' points, above all WebXR's, to points of the tracker.

WebXR and OpenXR: the viewer and every joint of a hand look along −Z, +Y up (out of the back of a hand); a grip's −Z
points to the thumb's end of a rod that is held, its +X out of the back of a right hand (WebXR device API, `gripSpace`;
WebXR hand input, 4.1). Ours: the identity in the T-pose, facing +Z, left hand toward +X, palms down.

Placements follow from the headset: the origin, and how far a seated wearer is raised.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from bodysense.body.hand import glove_marker
from bodysense.body.products import CONJUGATE, MATRIX, multiply, rotate
from bodysense.body.rotation import matrix_to_quaternion
from bodysense.body.skeleton import Skeleton, default_body, default_skeleton
from bodysense.io.protocol import ACCURACY_UNIT, HAS_POSITION, HAS_ROTATION, MOST_POINTS, ProtocolError, SignalFrame
from bodysense.observation import CAMERA_ACCURACY, TRACKER_ACCURACY, Observation, usual_accuracy
from bodysense.raw_poses import AXES
from bodysense_live.inertial import IMUS

IDENTITY, STILL = np.array([1.0, 0, 0, 0]), np.zeros(3)
# q @ _RIGHT is the 4×4 matrix, row by row, by which a row is multiplied to multiply by q from the right.
_RIGHT = np.array([multiply(np.eye(4), np.repeat(unit[None], 4, axis=0)).ravel() for unit in np.eye(4)])
_NOWHERE, _UPRIGHT = STILL.astype(np.float32), IDENTITY.astype(np.float32)
_WORN = ("pelvis", "spine3", *(f"{side}_{part}" for part in ("ankle", "knee", "elbow") for side in ("left", "right")))
# Strapped on somehow about the joint: their rotations count from when it is known how they are worn.
TRACKERS = {"hip": "pelvis", "waist": "pelvis", "chest": "spine3"} | {f"{joint}_tracker": joint for joint in _WORN}
UNDECIDED = tuple(f"tracker_{k}" for k in range(1, 9))  # until a calibration second tells where each is worn
_SEGMENTS = {"phalanx-proximal": "1", "phalanx-intermediate": "2", "phalanx-distal": "3", "tip": "_tip"}
_THUMB = {"metacarpal": "1", "phalanx-proximal": "2", "phalanx-distal": "3", "tip": "_tip"}
# Axes of a device's frame, as columns, where the wearer stands in the T-pose: x, y, z.
_LOOKING = np.array(AXES["headset"])
_HAND = {"left": [[0.0, 0, -1], [0, 1, 0], [1, 0, 0]], "right": [[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]}
_GRIP = {side: AXES[f"{side}_controller"] for side in ("left", "right")}


@dataclass(frozen=True, eq=False)
class Door:
    """The conversion of the N points of a signal."""

    points: tuple[str, ...]  # M, of the waist
    target: np.ndarray  # (N,) place among them; -1 for points that are not used
    turn: np.ndarray  # (N, 4) wxyz: device ← our point
    shift: np.ndarray  # (N, 3) m, of our point in its own frame, from the device
    turned: np.ndarray  # (N,) bool: its rotation says how our point is turned
    accuracy: np.ndarray  # (N,) m, of devices that do not say theirs
    is_plain: bool  # nothing is turned or shifted
    strapped: frozenset[str]  # points of which every device is a tracker that is strapped on somehow


def door(names: Sequence[str], skeleton: Skeleton, worn: Mapping[str, str] = MappingProxyType({})) -> Door:
    """The door for the points of a hello. `skeleton` says how far from a device the joint is that wears it.

    `worn` says which joints undecided trackers are on; others of them keep their names.
    Several names may be of one point (a controller, and the wrist of a tracked hand): the last in a frame counts.
    Raises ProtocolError for names that are unknown or stand twice.
    """
    if len(names) > MOST_POINTS:
        raise ProtocolError(f"{len(names)} points; give at most {MOST_POINTS}")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ProtocolError(f"the point {twice[0]!r} is named twice; give it once")
    rows = [
        (worn.get(name, name), IDENTITY, STILL, True) if name in UNDECIDED else _ours(name, skeleton) for name in names
    ]
    points = tuple(dict.fromkeys(row[0] for row in rows if row is not None))
    held = {
        row[0] for name, row in zip(names, rows, strict=True) if row is not None and name not in (*TRACKERS, *UNDECIDED)
    }
    used = [(points.index(row[0]), *row[1:]) if row is not None else (-1, IDENTITY, STILL, False) for row in rows]
    target, turn, shift, turned = zip(*used, strict=True) if used else ((), (), (), ())
    turns, shifts = np.array(turn).reshape(-1, 4), np.array(shift).reshape(-1, 3)
    return Door(
        points,
        np.array(target, dtype=int),
        turns,
        shifts,
        np.array(turned, dtype=bool),
        np.array([_accuracy(name) for name in names], dtype=float),
        bool((turns == IDENTITY).all() and not shifts.any()),
        frozenset(points) - held,
    )


@dataclass(frozen=True)
class Placement:
    """How the signal's world is moved into the body's: body = Ry(heading) · signal + offset."""

    heading: float = 0.0  # rad, about +Y
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m

    @cached_property
    def _matrix(self) -> np.ndarray:
        """(3, 3) that turns rows."""
        sine, cosine = math.sin(self.heading), math.cos(self.heading)
        return np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])

    @cached_property
    def _away(self) -> np.ndarray:
        """(3,) m."""
        return np.array(self.offset)

    @cached_property
    def _half(self) -> np.ndarray:
        """(1, 4) the turn as a quaternion."""
        return np.array([[math.cos(self.heading / 2), 0.0, math.sin(self.heading / 2), 0.0]])

    def inverse(self) -> Placement:
        """From the body's world back into the signal's."""
        back = Placement(-self.heading)
        x, y, z = (-back.place(self._away[None])[0]).tolist()
        return Placement(-self.heading, (x, y, z))

    def place(self, position: np.ndarray) -> np.ndarray:
        """Positions (N, 3) m in the body's world."""
        return position @ self._matrix + self._away

    def turn(self, rotation: np.ndarray) -> np.ndarray:
        """Rotations (N, 4) in the body's world."""
        if not self.heading:
            return rotation
        return multiply(np.repeat(self._half, len(rotation), axis=0), rotation)


def through(door: Door, frame: SignalFrame, shown: np.ndarray, placement: Placement, time: float) -> Observation:
    """One frame of the waist, at `time` s, from a signal frame; points that are not `shown` (N,) are left out."""
    told = _told(door, frame.point.astype(np.uint8).tobytes(), shown.tobytes())
    has, position, rotation, accuracy = frame.has, frame.position, frame.rotation, told.accuracy
    if told.use is not None:
        has, position, rotation = has[told.use], position[told.use], rotation[told.use]
    if frame.accuracy is not None and frame.accuracy.any():
        said = frame.accuracy if told.use is None else frame.accuracy[told.use]
        accuracy = np.where(said > 0, ACCURACY_UNIT * said, accuracy)
    everything = has.tobytes() == told.everything
    if everything:
        has_position, has_rotation = told.all, told.all
    else:
        has_position, has_rotation = has & HAS_POSITION != 0, has & HAS_ROTATION != 0
        # Values of untracked points may be anything, so they are replaced before computing.
        position = np.where(has_position[:, None], position, _NOWHERE)
        rotation = np.where(has_rotation[:, None], rotation, _UPRIGHT)
    position, rotation = position.astype(float), rotation.astype(float)
    if len(has):
        rotation /= np.sqrt(np.vecdot(rotation, rotation))[:, None]
        if not door.is_plain:
            rotation = (rotation[:, None, :] @ told.turn)[:, 0]
            shift = (rotation[:, :, None] * rotation[:, None, :]).reshape(-1, 1, 16) @ told.shift
            # Where the device's rotation is not known, its own place is the best guess of ours.
            position += shift[:, 0] if everything else shift[:, 0] * has_rotation[:, None]
            has_rotation = has_rotation & told.turned
        position, rotation = placement.place(position), placement.turn(rotation)
    moment = np.array([time])
    if everything and told.is_whole:
        return Observation(
            points=door.points,
            position=position[None],
            rotation=rotation[None],
            has_position=has_position[None],
            has_rotation=has_rotation[None],
            accuracy=accuracy[None],
            time=moment,
        )
    count, target = len(door.points), told.target
    places, turns = np.full((1, count, 3), np.nan), np.full((1, count, 4), np.nan)
    known, turned = np.zeros((1, count), dtype=bool), np.zeros((1, count), dtype=bool)
    places[0, target[has_position]], turns[0, target[has_rotation]] = position[has_position], rotation[has_rotation]
    known[0, target[has_position]], turned[0, target[has_rotation]] = True, True
    errors = np.full((1, count), TRACKER_ACCURACY)
    errors[0, target[has_position]] = accuracy[has_position]
    return Observation(door.points, places, turns, known, turned, errors, moment)


class _Told(NamedTuple):
    """Values that frames with equal points share; K of the points are used."""

    use: np.ndarray | None  # (N,) bool; None where all are
    target: np.ndarray  # (K,) place among the points of the waist
    turn: np.ndarray  # (K, 4, 4): q @ turn is how our point is turned, of a device that is turned by q
    shift: np.ndarray  # (K, 16, 3): (q qᵀ) @ shift is our point from the device, m, for how our point is turned
    turned: np.ndarray  # (K,) bool
    accuracy: np.ndarray  # (K,) m, shared by frames: not to be written to
    is_whole: bool  # they are all points of the waist, in order, and say how all are turned
    everything: bytes  # of `has`, where all have position and rotation
    all: np.ndarray  # (K,) True, shared by frames: not to be written to


@lru_cache(maxsize=1024)
def _told(door: Door, point: bytes, shown: bytes) -> _Told:
    rows = np.frombuffer(point, dtype=np.uint8)
    use = (door.target[rows] >= 0) & np.frombuffer(shown, dtype=bool)[rows]
    rows = rows[use]
    target, turned, every = door.target[rows], door.turned[rows], np.ones(len(rows), dtype=bool)
    accuracy = door.accuracy[rows]
    every.setflags(write=False)
    accuracy.setflags(write=False)
    return _Told(
        None if use.all() else use,
        target,
        (door.turn[rows] @ _RIGHT).reshape(-1, 4, 4),
        np.einsum("cij,kj->kci", MATRIX.reshape(16, 3, 3), door.shift[rows]),
        turned,
        accuracy,
        bool(turned.all()) and target.tolist() == list(range(len(door.points))),
        bytes([HAS_POSITION | HAS_ROTATION] * len(rows)),
        every,
    )


def _ours(name: str, skeleton: Skeleton) -> tuple[str, np.ndarray, np.ndarray, bool] | None:
    """Our point, device ← our point, our point from the device in its own frame, whether it gives a rotation."""
    size = skeleton.height / default_skeleton().height
    if name == "headset":
        return "head", _inverse(_LOOKING), -size * _landmark("between_eyes"), True
    side, _, rest = name.partition("_")
    if rest == "controller" and side in _GRIP:
        return f"{side}_wrist", _inverse(_GRIP[side]), -size * _landmark(f"{side}_palm"), True
    if name in TRACKERS:
        return TRACKERS[name], IDENTITY, STILL, True
    if name in IMUS:
        return name, IDENTITY, STILL, True
    if glove_marker(name) is not None:
        return name, IDENTITY, STILL, False
    side, colon, rest = name.partition(":")
    if colon:
        return _joint_of_hand(name, side, rest)
    if name not in skeleton.points:
        raise ProtocolError(f"the point {name!r} is unknown; see docs/protocol.md for the names")
    return name, IDENTITY, STILL, name in skeleton.joints


def _joint_of_hand(name: str, side: str, rest: str) -> tuple[str, np.ndarray, np.ndarray, bool] | None:
    """A joint of WebXR's hand. Of fingers only positions are used: their axes differ from bone to bone."""
    if side not in _HAND:
        raise ProtocolError(f"the point {name!r} is of no hand; begin it with 'left:' or 'right:'")
    if rest == "wrist":
        return f"{side}_wrist", _inverse(_HAND[side]), STILL, True
    finger, _, segment = rest.partition("-")
    segment = segment.removeprefix("finger-") if finger != "thumb" else segment
    table = _THUMB if finger == "thumb" else _SEGMENTS
    known = finger == "thumb" or (
        finger in ("index", "middle", "ring", "pinky") and rest == f"{finger}-finger-{segment}"
    )
    if known and segment == "metacarpal" and finger != "thumb":
        return None
    if not known or segment not in table:
        raise ProtocolError(f"the point {name!r} is no joint of WebXR's hands; see docs/protocol.md for the names")
    return f"{side}_{finger}{table[segment]}", IDENTITY, STILL, False


def _accuracy(name: str) -> float:
    """m: the usual accuracy of a device; WebXR's joints of hands are seen by cameras."""
    return CAMERA_ACCURACY if ":" in name else float(usual_accuracy([name])[0])


def _inverse(axes: Sequence[Sequence[float]] | np.ndarray) -> np.ndarray:
    """(4,) device ← our point, from the device's axes (columns) in the T-pose."""
    return matrix_to_quaternion(np.array(axes, dtype=float)) * CONJUGATE


def between_eyes(skeleton: Skeleton) -> np.ndarray:
    """(3,) m from the head's joint, in its axes."""
    return skeleton.height / default_skeleton().height * _landmark("between_eyes")


@lru_cache(maxsize=8)
def _landmark(name: str) -> np.ndarray:
    """(3,) m from the joint that carries it, on the default body."""
    return next(np.array(row["offset"]) for row in default_body()["landmarks"] if row["name"] == name)


def recentred(placement: Placement, raw: Observation) -> Placement:
    """The placement in which the head of a frame, in the signal's world, is in the middle and faces +Z."""
    head = raw.points.index("head")
    ahead = rotate(raw.rotation[0, [head]], np.array([[0.0, 0, 1]]))[0]
    turned = raw.has_rotation[0, head] and math.hypot(ahead[0], ahead[2]) > 0.1
    heading = -math.atan2(ahead[0], ahead[2]) if turned else 0.0
    moved = Placement(heading).place(raw.position[:, head])[0]
    return Placement(heading, (-float(moved[0]), placement.offset[1], -float(moved[2])))


def raised(placement: Placement, raw: Observation, standing: float | None) -> Placement:
    """Return the placement in which the head of a frame is at a standing height (m), or not raised if None."""
    up = 0.0 if standing is None else standing - float(raw.position[0, raw.points.index("head"), 1])
    x, _, z = placement.offset
    return replace(placement, offset=(x, up, z))
