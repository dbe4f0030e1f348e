"""Checks of an observation: its shapes, the order of its times, and its tracked values."""

from __future__ import annotations

from math import isfinite, isnan
from typing import TYPE_CHECKING

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.observing.world_axes import UNITS

if TYPE_CHECKING:
    from bodysense.observing.observation import Observation

UNIT_TOLERANCE = 0.01  # largest difference of the length of a quaternion from 1
LARGEST_ACCELERATION = 1000.0  # m/s²; no sensor on a body measures more
FARTHEST = 1000.0  # m from the origin; farther away, single precision is too coarse for a body


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
