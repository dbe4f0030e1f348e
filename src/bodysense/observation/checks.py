"""Checks of observations: shapes, values, order of frames, unit and upward axis."""

from __future__ import annotations

from math import isfinite, isnan
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.hand import glove_marker
from bodysense.errors import BodysenseError

if TYPE_CHECKING:
    from bodysense.observation.observation import Observation

UNIT_TOLERANCE = 0.01  # largest difference of the length of a quaternion from 1
LARGEST_ACCELERATION = 1000.0  # m/s²; no sensor on a body measures more
FARTHEST = 1000.0  # m from the origin; farther away, single precision is too coarse for a body

# Limits of `check_world`.
_HEADS = ("head", "headset")
_HIGHEST_HEAD = 20.0  # m above the floor; a higher head without other points is in another unit
_WIDEST = 4.0  # m from the head to the mean of the other points; no body is as large
_LOW = 0.7  # m; a lower head is not that of a standing body
_STANDING = (0.8, 2.3)  # m; usual heights of a head
_UPRIGHT = 0.2  # m; smallest height of the head above the other points of an upright body


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
        likely = "cm" if size < 100 * _WIDEST else "mm"
        where = "above the floor" if rise is None else "from the other points"
        raise BodysenseError(
            f"{name}: the head is {size:.4g} m {where}; give metres, or say the unit: unit='{likely}' (--unit "
            f"{likely}); unit='m' (--unit m) if it is really there"
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
    for field, wanted in expected.items():
        shape = getattr(observation, field).shape
        if shape != wanted:
            raise BodysenseError(f"{name}: {field} has shape {shape}; {frames} frames of {count} points need {wanted}")


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
    for mask, field in (("has_position", "position"), ("has_rotation", "rotation")):
        present = getattr(observation, mask)
        broken = present & ~np.isfinite(getattr(observation, field)).all(axis=-1)
        if broken.any():
            *_, frame, point = np.argwhere(broken)[0]
            raise BodysenseError(
                f"{name}: {mask} says that {observation.points[point]!r} is tracked at frame {frame}, "
                f"but its {field} is not finite; clear the mask there"
            )
    with np.errstate(invalid="ignore"):
        far = observation.has_position & ~(np.abs(observation.position).max(axis=-1, initial=0.0) <= farthest)
        vague = observation.has_position & ~((observation.accuracy > 0) & (observation.accuracy < np.inf))
    if far.any():
        *_, frame, point = place = tuple(np.argwhere(far)[0])
        raise BodysenseError(
            f"{name}: {observation.points[point]!r} is {np.abs(observation.position[place]).max():.4g} m from the "
            f"origin at frame {frame}, but at most {farthest:g} m is possible; give metres, or move the origin nearer"
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
