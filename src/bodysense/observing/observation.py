"""The observation: named points over time, and its construction. Every input becomes one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import inf, isfinite, nan
from reprlib import repr as brief
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.hands.hand import glove_marker
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError, did_you_mean
from bodysense.observing.checks import FARTHEST, UNIT_TOLERANCE, check_observation, time_text
from bodysense.observing.world_axes import COMPACT, HIGHEST_HEAD, check_world, convert_world

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

# Expected error (m) of a measured position by kind of device, for devices that do not report their own.
EXACT_ACCURACY = 0.001  # the true motion, simulated devices without noise
HEADSET_ACCURACY = 0.001  # headsets and controllers
OPTICAL_ACCURACY = 0.001  # markers of optical motion capture
TRACKER_ACCURACY = 0.01  # trackers on the body: clothes and skin move under the strap
CAMERA_ACCURACY = 0.01  # hands and joints seen by the cameras of a headset
LANDMARK_ACCURACY = 0.05  # landmarks of a video
RAW_POINTS = frozenset(("headset", "left_controller", "right_controller"))  # poses of devices, not of joints
_HEADSET_POINTS = {"head", "left_wrist", "right_wrist", *RAW_POINTS}

_NO_POSITION, _NO_ROTATION = (nan, nan, nan), (nan, nan, nan, nan)


@dataclass(frozen=True, eq=False)
class Observation:
    """Tracked points by name over time, in the world (+Y up, metres). Hidden values are NaN."""

    points: tuple[str, ...]  # names of joints, end sites, markers or headset devices
    position: np.ndarray  # (..., T, P, 3) m, world
    rotation: np.ndarray  # (..., T, P, 4) wxyz, world ← point
    has_position: np.ndarray  # (..., T, P) bool
    has_rotation: np.ndarray  # (..., T, P) bool
    accuracy: np.ndarray  # (..., T, P) m, expected error of a measured position
    time: np.ndarray  # (T,) s, increasing; from any origin
    # (..., T, P, 3) m/s², world, without gravity: inertial sensors on the bones that begin at their points. NaN:
    # missing. None: no point has a sensor.
    acceleration: np.ndarray | None = None
    # Memory of a frame that `observe` made: position, rotation, accuracy and time, and both masks, one after the other.
    block: tuple[np.ndarray, bytearray] | None = field(default=None, init=False, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields without `block`: a copy's arrays are no longer parts of it."""
        return {**self.__dict__, "block": None}

    def __getitem__(self, key: slice | np.ndarray) -> Observation:
        """Return the frames `key` (a slice or indices) of all people."""
        return replace(
            self,
            position=self.position[..., key, :, :],
            rotation=self.rotation[..., key, :, :],
            has_position=self.has_position[..., key, :],
            has_rotation=self.has_rotation[..., key, :],
            accuracy=self.accuracy[..., key, :],
            time=self.time[key],
            acceleration=None if self.acceleration is None else self.acceleration[..., key, :, :],
        )

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        people = "".join(f"{count} people, " for count in self.position.shape[:-3])
        frames = "1 frame" if len(self) == 1 else f"{len(self)} frames"
        rate = f" at {1 / np.median(np.diff(self.time)):.4g} Hz" if len(self) > 1 else f" at {time_text(self.time[0])}"
        tracked = (self.has_position | self.has_rotation).mean() if self.has_position.size else 0.0
        names = ", ".join(self.points[:6]) + (f" and {len(self.points) - 6} more" if len(self.points) > 6 else "")
        return f"Observation({people}{frames}{rate if len(self) else ''}, {tracked:.0%} tracked: {names})"

    @classmethod
    def from_arrays(
        cls,
        position: Mapping[str, ArrayLike],
        rotation: Mapping[str, ArrayLike] | None = None,
        rate: float = 30.0,
        *,
        time: ArrayLike | None = None,
        accuracy: float | None = None,
        unit: str | None = None,
        up: str | None = None,
    ) -> Observation:
        """Make an observation of whole arrays of named points. NaN values are not tracked.

        Args:
            position: (..., T, 3) by name ('head', 'left_wrist' …), world. A point may have only a position or only a
                rotation.
            rotation: (..., T, 4) wxyz, world ← point, by name.
            rate: frames a second, from 0 s; not used if `time` is given.
            time: (T,) s, increasing.
            accuracy: m, expected error of the positions; the usual one of each point if omitted.
            unit: of the positions, 'm', 'cm', 'mm', 'in', 'ft' or metres as '0.0254'; metres if omitted.
            up: upward axis of the world, such as 'z'; 'y' if omitted.

        Raises BodysenseError for arrays of inconsistent shapes, and, unless `unit` or `up` is given, for a body that
        appears to be in another unit or upright along another axis.
        """
        if not rate > 0:
            raise BodysenseError(f"from_arrays: rate {rate:g}; give frames a second, such as 30")
        made = _from_named_points(position, rotation or {}, time, rate, accuracy, "from_arrays")
        made = check_observation(convert_world(made, unit, up), "from_arrays")
        check_world(made, "from_arrays", unit=unit, up=up)
        return made


def observe(
    time: float,
    poses: Mapping[str, tuple[ArrayLike | None, ArrayLike | None]],
    accuracy: float | None = None,
    *,
    unit: str | None = None,
    up: str | None = None,
) -> Observation:
    """Make one frame of named points, of one person or of several.

    Args:
        time: s, from any origin.
        poses: position (..., 3) m and rotation (..., 4) wxyz, both in the world, by the point's name, such as
            'left_wrist'. None: not tracked; NaN: not tracked for one of several people. 'headset', 'left_controller'
            and 'right_controller' are poses of the devices themselves, as WebXR and OpenXR report them.
        accuracy: m, expected error of the positions; the usual one of each point if omitted.
        unit: of the positions, 'm', 'cm', 'mm', 'in', 'ft' or metres as '0.0254'; metres if omitted.
        up: upward axis of the world, such as 'z'; 'y' if omitted.

    Raises BodysenseError for unknown points, invalid positions and rotations, and, unless `unit` is given, for a body
    that appears to be in another unit.
    """
    _check_points(tuple(poses))
    plain = None if unit is not None or up is not None else _plain_frame(time, poses, accuracy)
    if plain is not None:
        return plain

    def frames(kind: int) -> dict[str, np.ndarray]:
        given = {name: pose[kind] for name, pose in poses.items()}
        return {name: np.asarray(value, float)[..., None, :] for name, value in given.items() if value is not None}

    for name, pose in poses.items():
        if not isinstance(pose, (tuple, list)) or len(pose) != 2:
            raise BodysenseError(f"observe: {name} is {brief(pose)}; give a pair (position, rotation), each or None")
        for value, kind, size in zip(pose, ("position", "rotation"), (3, 4), strict=True):
            if value is not None and (np.ndim(value) == 0 or np.shape(value)[-1] != size):
                raise BodysenseError(f"{name}: its {kind} has shape {np.shape(value)}; give {size} numbers, or None")
    made = _from_named_points(frames(0), frames(1), [time], 1.0, accuracy, "observe", tuple(poses))
    made = check_observation(convert_world(made, unit, up), "observe")
    check_world(made, "observe", unit=unit, up="y")  # in a single frame the person may be lying
    return made


def _plain_frame(time: float, poses: Mapping[str, Any], accuracy: float | None) -> Observation | None:
    """Return the observation of a frame of one person without anything to convert, to hide or to refuse; else None.

    Arithmetic on a dozen numbers is much faster in Python than in arrays, and a live loop has a frame each 14 ms.
    """
    points = tuple(poses)
    numbers: list[Any] = []
    rotations: list[Any] = []
    across, upward, along = [], [], []
    masks = bytearray()
    try:
        for position, _ in poses.values():
            masks.append(position is not None)
            if position is None:
                numbers += _NO_POSITION
                continue
            x, y, z = position.tolist() if isinstance(position, np.ndarray) else position
            if not (abs(x) <= FARTHEST and abs(y) <= HIGHEST_HEAD and abs(z) <= FARTHEST):
                return None
            across.append(x)
            upward.append(y)
            along.append(z)
            numbers += (x, y, z)
        for _, rotation in poses.values():
            masks.append(rotation is not None)
            if rotation is None:
                rotations += _NO_ROTATION
                continue
            w, i, j, k = rotation.tolist() if isinstance(rotation, np.ndarray) else rotation
            if not abs(w * w + i * i + j * j + k * k - 1) < UNIT_TOLERANCE:
                return None
            rotations += (w, i, j, k)
        if not (points and isfinite(time) and (accuracy is None or 0 < accuracy < inf)):
            return None
        if across and not (
            max(across) - min(across) <= COMPACT
            and max(upward) - min(upward) <= COMPACT
            and max(along) - min(along) <= COMPACT
        ):
            return None
        usual = _usual_accuracies(points) if accuracy is None else (accuracy,) * len(points)
        count = len(points)
        whole = np.array((*numbers, *rotations, *usual, time), dtype=np.float64)
    except (TypeError, ValueError):  # several people, or values that are explained with their names
        return None
    if whole.ndim != 1:
        return None
    made = Observation(
        points,
        np.ndarray((1, count, 3), np.float64, whole),
        np.ndarray((1, count, 4), np.float64, whole, 24 * count),
        np.ndarray((1, count), np.bool_, masks),
        np.ndarray((1, count), np.bool_, masks, count),
        np.ndarray((1, count), np.float64, whole, 56 * count),
        np.ndarray((1,), np.float64, whole, 64 * count),
    )
    object.__setattr__(made, "block", (whole, masks))
    return made


@lru_cache(maxsize=64)
def _check_points(points: tuple[str, ...]) -> None:
    """Raise BodysenseError for a name that is no point of a body, no device's and no marker of a glove."""
    valid = (*default_skeleton().points, *RAW_POINTS)
    for name in points:
        if name not in valid and not (isinstance(name, str) and glove_marker(name)):
            known = "points are those of bs.default_skeleton().points, headset, left_controller and right_controller"
            raise BodysenseError(f"observe: unknown point {name!r}; {did_you_mean(str(name), valid) or known}")


@lru_cache(maxsize=64)
def _usual_accuracies(points: tuple[str, ...]) -> tuple[float, ...]:
    return tuple(map(_usual_accuracy, points))


def _from_named_points(
    position: Mapping[str, ArrayLike],
    rotation: Mapping[str, ArrayLike],
    time: ArrayLike | None,
    rate: float,
    accuracy: float | None,
    name: str,
    points: tuple[str, ...] = (),
) -> Observation:
    """Return an observation of arrays (..., T, 3) and (..., T, 4) by name; values are not checked."""
    points = points or tuple(dict.fromkeys((*position, *rotation)))
    given = [
        (point, np.asarray(values[point], dtype=float), size)
        for values, size in ((position, 3), (rotation, 4))
        for point in values
    ]
    lead = given[0][1].shape[:-1] if given else np.shape([] if time is None else time)
    for point, values, size in given:
        if values.shape != (*lead, size) or not lead:
            first, shape = given[0][0], given[0][1].shape
            other = "" if values.shape[:-1] == lead else f", but {first} has {shape}"
            raise BodysenseError(
                f"{name}: {point} has shape {values.shape}{other}; "
                f"give (..., T, {size}), with equally many frames and people"
            )
    columns = {size: np.full((*lead, len(points), size), np.nan) for size in (3, 4)}
    for point, values, size in given:
        columns[size][..., points.index(point), :] = values
    has_position, has_rotation = (np.asarray(~np.isnan(columns[size]).all(axis=-1)) for size in (3, 4))
    usual = usual_accuracy(points) if accuracy is None else accuracy
    return Observation(
        points,
        columns[3],
        columns[4],
        has_position,
        has_rotation,
        accuracy_like(has_position, usual),
        np.arange(lead[-1]) / rate if time is None else np.asarray(time, dtype=float),
    )


def accuracy_like(has_position: np.ndarray, metres: float | np.ndarray) -> np.ndarray:
    """Return an accuracy array (..., T, P) for a mask `has_position`; `metres` is one value or one per point (P,)."""
    return np.broadcast_to(np.asarray(metres, dtype=float), np.shape(has_position)).copy()


def usual_accuracy(points: Sequence[str]) -> np.ndarray:
    """Return the accuracy (P,) m of points by their names alone.

    Head and wrists: `HEADSET_ACCURACY`. Markers of gloves: `OPTICAL_ACCURACY`. All others: `TRACKER_ACCURACY`.
    """
    return np.array([_usual_accuracy(name) for name in points], dtype=float)


def _usual_accuracy(name: str) -> float:
    if name in _HEADSET_POINTS:
        return HEADSET_ACCURACY
    return OPTICAL_ACCURACY if glove_marker(name) else TRACKER_ACCURACY
