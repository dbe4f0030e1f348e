"""Units of length and upward axes of other data: their names, conversion to ours, and refusal of unconverted data."""

from __future__ import annotations

from dataclasses import replace
from math import log
from typing import TYPE_CHECKING, Literal

import numpy as np

from bodysense.body.hands.hand import glove_marker
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_multiply, quaternion_rotate

if TYPE_CHECKING:
    from bodysense.observing.observation import Observation

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]
_HALF = float(np.sqrt(0.5))
TURNS: dict[str, np.ndarray] = {  # quaternions wxyz, our world ← data whose upward axis is this
    "y": np.array([1.0, 0.0, 0.0, 0.0]),
    "z": np.array([_HALF, -_HALF, 0.0, 0.0]),  # -90° about X: (x, y, z) becomes (x, z, -y)
    "-z": np.array([_HALF, _HALF, 0.0, 0.0]),
    "-y": np.array([0.0, 1.0, 0.0, 0.0]),  # 180° about X
    "x": np.array([_HALF, 0.0, 0.0, _HALF]),
    "-x": np.array([_HALF, 0.0, 0.0, -_HALF]),
}

# Limits of `check_world`.
_HEADS = ("head", "headset")
HIGHEST_HEAD = 20.0  # m above the floor; a higher head without other points is in another unit
_WIDEST = 4.0  # m from the head to the mean of the other points; no body is as large
_USUAL_RISE, _USUAL_HEAD = 0.55, 1.55  # m from the mean of a standing body's points to its head, and from the floor
_LOW = 0.7  # m; a lower head is not that of a standing body
_STANDING = (0.8, 2.3)  # m; usual heights of a head
COMPACT = 2.0  # m along each axis; points that are as near pass `check_world` in any case
_UPRIGHT = 0.2  # m; smallest height of the head above the other points of an upright body


def metres_of(unit: str, option: str) -> float:
    """Return the length of a unit in metres: a name of `UNITS`, or a number. Errors name the option.

    Raises BodysenseError for an unknown unit.
    """
    try:
        metres = UNITS.get(unit) or float(unit)
    except ValueError:
        metres = 0.0
    if not 1e-6 < metres < 1e4:
        raise BodysenseError(f"{option} {unit}: give {', '.join(UNITS)}, or the metres of one unit, as 0.056444")
    return metres


def turn_of(up: str, option: str) -> np.ndarray:
    """Return the quaternion (4,) wxyz, our world ← data with this upward axis. Errors name the option.

    Raises BodysenseError for an unknown axis.
    """
    if up not in TURNS:
        raise BodysenseError(f"{option} {up}: give the upward axis, {', '.join(TURNS)}")
    return TURNS[up]


def likely_unit(size: float | None, height: float | None) -> str:
    """Return the unit of `UNITS`, other than metres, in which a body is likeliest.

    Args:
        size: of the body, relative to the usual one in metres; None if it is unknown.
        height: of its head or trunk over the floor, relative to that of a standing adult; None if it is unknown.
    """

    def unlikely(metres: float) -> float:
        return sum(abs(log(max(value, 1e-9) * metres)) for value in (size, height, height) if value is not None)

    return min((name for name in UNITS if name != "m"), key=lambda name: unlikely(UNITS[name]))


def convert_world(observation: Observation, unit: str | None, up: str | None) -> Observation:
    """Convert an observation from its unit and upward axis to metres and +Y up. None: no conversion.

    Raises BodysenseError for unknown units and axes.
    """
    if unit is None and up is None:
        return observation
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
    if unit is None and size > (HIGHEST_HEAD if rise is None else _WIDEST):
        tall = float(np.median(np.abs(top).max(axis=-1))) / _USUAL_HEAD
        likely = likely_unit(None if rise is None else size / _USUAL_RISE, tall)
        where = "above the floor" if rise is None else "from the other points"
        raise BodysenseError(
            f"{name}: the head is {size:.4g} m {where}; give metres, or say the unit: unit='{likely}' (--unit "
            f"{likely}); unit='m' (--unit m) if it is really there; units are {', '.join(UNITS)}"
        )
    if rise is not None:
        stands_along_z = rise[2] > max(_UPRIGHT, 2 * abs(rise[1]))
    else:  # heights of a head: at least a second, within half a metre
        stands_along_z = len(top) >= 30 and float(np.ptp(top[:, 2])) < 0.5
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
