"""Vectors (3,) and rotations (3, 3) as matrices a ← b, whose columns are the axes of b in a."""

from math import cos, sin, sqrt

import numpy as np

UP = np.array([0.0, 1.0, 0.0])
STRAIGHT = 0.9995  # of a limb's length: a limb is never quite straight
HALF_TURN = -0.95  # cosine of a turn whose axis is hardly known
UNKNOWN_SIDE = 6.0  # an elbow this many times farther aside than the length of what says where aside is


class Tie(Exception):
    """Where a difference in the last bits of the core and of its twin decides what follows."""


def length(v: np.ndarray) -> float:
    """|v|"""
    return sqrt(v @ v)


def unit(v: np.ndarray) -> np.ndarray:
    """v / |v|; zero stays zero."""
    size = length(v)
    return v / size if size > 1e-12 else np.zeros(3)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a × b"""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def across(v: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The part of v across a unit normal."""
    return v - (v @ normal) * normal


def mix(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """From a (share 0) to b (share 1)."""
    return (1 - share) * a + share * b


def limited(v: np.ndarray, most: float) -> np.ndarray:
    """A vector no longer than `most`."""
    size = length(v)
    return v * (most / size) if size > most else v


def frame_of(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The rotation with x along `first` and y toward `second` (Gram-Schmidt)."""
    x = unit(first)
    y = unit(across(second, x))
    return np.stack([x, y, cross(x, y)], axis=1)


def skew(k: np.ndarray) -> np.ndarray:
    """The matrix of v → k × v."""
    return np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])


def turned_by(rotation: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """A rotation after a further turn by a rotation vector: Rodrigues' R = 1 + sin K + (1 - cos) K²."""
    angle = length(turn)
    if angle < 1e-7:
        return rotation
    k = skew(turn / angle)
    return (np.eye(3) + sin(angle) * k + (1 - cos(angle)) * k @ k) @ rotation


def turn_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rotation vector (rad, in a) of the turn that takes a ← b `start` to `end`."""
    m = end @ start.T
    twice = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])  # 2 sin(angle) axis
    sine, cosine = length(twice) / 2, (np.trace(m) - 1) / 2
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-4:
        return twice * (angle / (2 * sine))
    if cosine > 0:
        return twice / 2
    columns = (m + np.eye(3)).T  # half a turn: each is along its axis
    return angle * unit(max(columns, key=lambda column: float(column @ column)))


def turned_onto(rotation: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The turn that takes direction `before` onto `after` by the shortest way, applied to a rotation."""
    u, w = unit(before), unit(after)
    if not u.any() or not w.any():
        return rotation
    if u @ w < HALF_TURN:
        raise Tie(f"a turn by nearly half a turn, of cosine {u @ w:.4f}")
    k = skew(cross(u, w))
    return (np.eye(3) + k + k @ k / (1 + u @ w)) @ rotation


def heading(rotation: np.ndarray) -> np.ndarray:
    """The turn about +Y nearest to a rotation: its twist; no turn if it has none."""
    return turn_about_up(rotation[0, 0] + rotation[2, 2], rotation[0, 2] - rotation[2, 0], 1e-6)


def turn_about_up(cosine: float, sine: float, least: float) -> np.ndarray:
    """The turn about +Y by an angle whose cosine and sine are in this proportion; none if they are below `least`."""
    size = sqrt(cosine * cosine + sine * sine)
    c, s = (cosine / size, sine / size) if size > least else (1.0, 0.0)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def reach(end: np.ndarray, upper: float, lower: float, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle and end of two bones that reach from the origin to `end`, or point at it if it is too far.

    Law of cosines: the middle is (d + (u² - l²) / d) / 2 along the way to the end, and aside toward `side`.
    """
    far = length(end)
    direction = end / far if far > 1e-6 else -UP
    distance = min(max(far, abs(upper - lower) + 1e-5), STRAIGHT * (upper + lower))
    forward = (distance + (upper**2 - lower**2) / distance) / 2
    aside = sqrt(max(upper**2 - forward**2, 0.0))
    pole = across(side, direction)
    if aside > UNKNOWN_SIDE * length(pole):
        raise Tie(f"a middle {aside:.3f} m aside, where a vector of {length(pole):.1e} m says")
    return forward * direction + aside * unit(pole), distance * direction
