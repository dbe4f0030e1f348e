"""The observation: named points over time, its construction and the checks of its values. Every input becomes one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import inf, isfinite, isnan, nan
from reprlib import repr as brief
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.hands.hand import glove_marker
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError, did_you_mean

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

# Points with an inertial sensor whose acceleration the tracker uses, and the end of the bone that carries the sensor.
# None: the sensor is at the joint itself.
INERTIAL_BONES: dict[str, str | None] = {
    "pelvis": None,
    "spine3": None,
    **{
        f"{side}_{joint}": f"{side}_{end}"
        for joint, end in (
            ("hip", "knee"),
            ("knee", "ankle"),
            ("ankle", "foot"),
            ("shoulder", "elbow"),
            ("elbow", "wrist"),
        )
        for side in ("left", "right")
    },
}
INERTIAL_POINTS = tuple(INERTIAL_BONES)
UNIT_TOLERANCE = 0.01  # largest difference of the length of a quaternion from 1
LARGEST_ACCELERATION = 1000.0  # m/s²; no sensor on a body measures more
FARTHEST = 1000.0  # m from the origin; farther away, single precision is too coarse for a body

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

# Limits of `check_world`.
_HEADS = ("head", "headset")
_HIGHEST_HEAD = 20.0  # m above the floor; a higher head without other points is in another unit
_WIDEST = 4.0  # m from the head to the mean of the other points; no body is as large
_USUAL_RISE, _USUAL_HEAD = 0.55, 1.55  # m from the mean of a standing body's points to its head, and from the floor
_LOW = 0.7  # m; a lower head is not that of a standing body
_STANDING = (0.8, 2.3)  # m; usual heights of a head
_COMPACT = 2.0  # m along each axis; points that are as near pass `check_world` in any case
_UPRIGHT = 0.2  # m; smallest height of the head above the other points of an upright body


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
            if not (abs(x) <= FARTHEST and abs(y) <= _HIGHEST_HEAD and abs(z) <= FARTHEST):
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
            max(across) - min(across) <= _COMPACT
            and max(upward) - min(upward) <= _COMPACT
            and max(along) - min(along) <= _COMPACT
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


def convert_world(observation: Observation, unit: str | None, up: str | None) -> Observation:
    """Convert an observation from its unit and upward axis to metres and +Y up. None: no conversion.

    Raises BodysenseError for unknown units and axes.
    """
    if unit is None and up is None:
        return observation
    from bodysense.geometry.rotation import quaternion_multiply, quaternion_rotate
    from bodysense.observing.world_axes import metres_of, turn_of

    metres, turn = metres_of(unit or "m", "unit"), turn_of(up or "y", "up")
    acceleration = observation.acceleration
    return replace(
        observation,
        position=quaternion_rotate(np.broadcast_to(turn, observation.rotation.shape), metres * observation.position),
        rotation=quaternion_multiply(np.broadcast_to(turn, observation.rotation.shape), observation.rotation),
        acceleration=None
        if acceleration is None
        else quaternion_rotate(np.broadcast_to(turn, observation.rotation.shape), metres * acceleration),
    )


def check_world(
    observation: Observation, name: str, *, unit: str | None = None, up: str | None = None, floor: float = 0.0
) -> None:
    """Raise BodysenseError, naming the fix, for a body that appears to be in another unit or upright along +Z.

    Args:
        observation: a valid observation; it passes if no head is tracked.
        name: beginning of the message.
        unit: unit that the user gave; it is not checked then.
        up: upward axis that the user gave; it is not checked then.
        floor: height of the floor, m.
    """
    head = next((k for k, point in enumerate(observation.points) if point in _HEADS), None)
    if head is None or not (seen := observation.has_position[..., head]).any():
        return
    top = observation.position[..., head, :][seen]  # (N, 3)
    height, depth = float(np.median(top[:, 1])) - floor, float(np.median(top[:, 2]))
    rise = _head_above_points(observation, head)
    size = abs(height) if rise is None else float(np.linalg.norm(rise))
    if unit is None and size > (_HIGHEST_HEAD if rise is None else _WIDEST):
        from bodysense.observing.world_axes import UNITS, likely_unit

        tall = float(np.median(np.abs(top).max(axis=-1))) / _USUAL_HEAD
        likely = likely_unit(None if rise is None else size / _USUAL_RISE, tall)
        where = "above the floor" if rise is None else "from the other points"
        raise BodysenseError(
            f"{name}: the head is {size:.4g} m {where}; give metres, or say the unit: unit='{likely}' (--unit "
            f"{likely}); unit='m' (--unit m) if it is really there; units are {', '.join(UNITS)}"
        )
    stands_along_z = rise[2] > max(_UPRIGHT, 2 * abs(rise[1])) if rise is not None else _keeps_height(top[:, 2])
    if up is None and abs(height) < _LOW and _STANDING[0] < depth < _STANDING[1] and stands_along_z:
        raise BodysenseError(
            f"{name}: the head is {height:.2f} m high and {depth:.2f} m along z, as of a body that stands along +Z; "
            "give data with +Y up, or say the axis: up='z' (--up z); up='y' (--up y) if the body lies"
        )


def _head_above_points(observation: Observation, head: int) -> np.ndarray | None:
    """Return the median vector (3,) m from the mean of the body's other points to its head; None without any."""
    others = [k for k, point in enumerate(observation.points) if k != head and glove_marker(point) is None]
    known = observation.has_position[..., others] & observation.has_position[..., [head]]
    where = known.any(axis=-1)
    if not where.any():
        return None
    total = np.where(known[..., None], observation.position[..., others, :], 0.0).sum(axis=-2)[where]
    middle = total / known.sum(axis=-1)[where][:, None]
    return np.median(observation.position[..., head, :][where] - middle, axis=0)


def _keeps_height(heights: np.ndarray) -> bool:
    """Whether (N,) m could be heights of a head: at least a second, within half a metre."""
    return len(heights) >= 30 and float(np.ptp(heights)) < 0.5


def check_shapes(observation: Observation, name: str = "observation") -> None:
    """Raise BodysenseError, naming the fix, for arrays of inconsistent shapes. Values are not checked."""
    if observation.block is not None:
        return
    frames, count = len(observation.time), len(observation.points)
    if len(set(observation.points)) != count:
        raise BodysenseError(f"{name}: a point is named twice; names must differ")
    if observation.time.ndim != 1:
        raise BodysenseError(f"{name}: time has shape {observation.time.shape}; give one number a frame, in seconds")
    lead = (*observation.position.shape[:-3], frames, count)
    expected = {
        "position": (*lead, 3),
        "rotation": (*lead, 4),
        "has_position": lead,
        "has_rotation": lead,
        "accuracy": lead,
    }
    if observation.acceleration is not None:
        expected["acceleration"] = (*lead, 3)
    for member, wanted in expected.items():
        shape = getattr(observation, member).shape
        if shape != wanted:
            raise BodysenseError(f"{name}: {member} has shape {shape}; {frames} frames of {count} points need {wanted}")


def check_observation(observation: Observation, name: str = "observation", farthest: float = FARTHEST) -> Observation:
    """Return the observation if it is valid; raise BodysenseError, naming the fix, if not.

    Valid: shapes agree and times increase. Tracked positions are finite, at most `farthest` m from the origin and of
    positive accuracy. Tracked rotations are unit quaternions.
    """
    check_shapes(observation, name)
    if not np.isfinite(observation.time).all():
        bad = int(np.argmin(np.isfinite(observation.time)))
        raise BodysenseError(f"{name}: the time of frame {bad} is not a number; give seconds, increasing")
    backwards = np.flatnonzero(np.diff(observation.time) <= 0)
    if backwards.size:
        k = int(backwards[0]) + 1
        before, after = (time_text(time) for time in observation.time[k - 1 : k + 1])
        raise BodysenseError(
            f"{name}: time goes from {before} to {after} at frame {k}; "
            "times must increase: sort the frames and drop repeats"
        )
    if not _is_valid(observation, farthest):
        _raise_invalid(observation, name, farthest)
    if observation.acceleration is not None:
        _check_acceleration(observation, observation.acceleration, name)
    return observation


def _check_acceleration(observation: Observation, acceleration: np.ndarray, name: str) -> None:
    """Raise BodysenseError for an acceleration above `LARGEST_ACCELERATION`."""
    with np.errstate(invalid="ignore"):
        present = ~np.isnan(acceleration).any(axis=-1)
        broken = present & ~(np.abs(acceleration) <= LARGEST_ACCELERATION).all(axis=-1)
    if broken.any():
        *_, frame, point = place = tuple(np.argwhere(broken)[0])
        raise BodysenseError(
            f"{name}: the acceleration of {observation.points[point]!r} at frame {frame} is "
            f"{np.abs(acceleration[place]).max():.4g} m/s², but at most {LARGEST_ACCELERATION:g} is possible; give "
            "m/s² in the world without gravity, or NaN where there is none"
        )


def _is_valid(observation: Observation, farthest: float) -> bool:
    """Whether all tracked values are valid (`check_observation`)."""
    accuracy, rotation = observation.accuracy, observation.rotation
    with np.errstate(all="ignore"):  # NaN compares false
        position_ok = (np.abs(observation.position) <= farthest).all(axis=-1) & (accuracy > 0) & (accuracy < np.inf)
        rotation_ok = np.abs(np.sqrt(np.einsum("...i,...i->...", rotation, rotation)) - 1) < UNIT_TOLERANCE
    return bool((position_ok | ~observation.has_position).all() and (rotation_ok | ~observation.has_rotation).all())


def _raise_invalid(observation: Observation, name: str, farthest: float) -> None:
    """Raise BodysenseError for the first invalid tracked value."""
    for mask, member in (("has_position", "position"), ("has_rotation", "rotation")):
        present = getattr(observation, mask)
        broken = present & ~np.isfinite(getattr(observation, member)).all(axis=-1)
        if broken.any():
            *_, frame, point = np.argwhere(broken)[0]
            raise BodysenseError(
                f"{name}: {mask} says that {observation.points[point]!r} is tracked at frame {frame}, "
                f"but its {member} is not finite; clear the mask there"
            )
    with np.errstate(invalid="ignore"):
        far = observation.has_position & ~(np.abs(observation.position).max(axis=-1, initial=0.0) <= farthest)
        vague = observation.has_position & ~((observation.accuracy > 0) & (observation.accuracy < np.inf))
    if far.any():
        from bodysense.observing.world_axes import UNITS

        *_, frame, point = place = tuple(np.argwhere(far)[0])
        raise BodysenseError(
            f"{name}: {observation.points[point]!r} is {np.abs(observation.position[place]).max():.4g} m from the "
            f"origin at frame {frame}, but at most {farthest:g} m is possible; give metres, say the unit, unit='mm' "
            f"(one of {', '.join(UNITS)}), or move the origin nearer"
        )
    if vague.any():
        *_, frame, point = place = tuple(np.argwhere(vague)[0])
        raise BodysenseError(
            f"{name}: the accuracy of {observation.points[point]!r} at frame {frame} is "
            f"{observation.accuracy[place]:g}; give the expected error of its position in metres, above 0, such as 0.01"
        )
    with np.errstate(over="ignore"):
        length = np.linalg.norm(observation.rotation, axis=-1)
    broken = observation.has_rotation & ~(np.abs(length - 1) < UNIT_TOLERANCE)
    if broken.any():
        *_, frame, point = place = tuple(np.argwhere(broken)[0])
        raise BodysenseError(
            f"{name}: the rotation of {observation.points[point]!r} at frame {frame} has length {length[place]:g}; "
            "give unit quaternions w, x, y, z, or clear the mask there"
        )


def check_order(time: float, before: float | None, name: str) -> None:
    """Raise BodysenseError, beginning with `name`, unless a frame at `time` s may follow one at `before` s.

    `before` is None or NaN for the first frame.
    """
    if before is not None and isnan(before):
        before = None
    if isfinite(time) and (before is None or time > before):
        return
    after = "" if before is None else f" came after one at {time_text(before)}"
    raise BodysenseError(f"{name}: a frame at {time_text(time)}{after}; give frames in order of time, in seconds")


def time_text(time: float) -> str:
    """Return a time for messages, to the microsecond; also for Unix times."""
    return f"{round(float(time), 6):.15g} s"


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
