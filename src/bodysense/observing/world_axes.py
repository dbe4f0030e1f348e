"""Units of length and upward axes of other data, and the rotation of each axis to +Y."""

from __future__ import annotations

from math import log
from typing import Literal

import numpy as np

from bodysense.errors import BodysenseError

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
