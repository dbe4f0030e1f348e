"""The guard of live input: what the frames of a state show of a wrong world.

It looks at a frame twice a second in the first `_WATCHED` seconds of a state, so that steps cost nothing more, and
reports each kind of doubt once. A world is doubted only if no body can be in it: people lie, bow, jump, cross their
arms and stand on their hands, so what a right world can show, too, waits for the next look.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_rotate
from bodysense.observing.world_axes import TURNS, UNITS, UpAxis, likely_unit

if TYPE_CHECKING:
    from bodysense.observing.observation import Observation

_LONGEST_STEP = 5.0  # s between frames; two longer steps in a row are times in another unit, one is a pause
_WATCHED = 20.0  # s from the first frame in which a wrong world is looked for
_LOOK = 0.5  # s between looks
_LONG = 1.35  # times the path along the bones: two points are not farther apart on any adult
_SHORT = 0.06  # times that path: no three points of a body are as near to each other
_NUMBERS = 1e6  # positions beyond it are refused, not doubted
_SLACK = 0.1  # m by which two points may be farther apart in addition: joints are where devices place them
_TALL = 2.7  # m: no head is higher, also of a tall person who jumps
_USUAL_HEAD = 2.1  # m: a standing person's head is lower
_SUNK = 0.2  # m under the floor: a point that is lower is in a world with another floor
_LOW_HEAD = 0.3  # m: an upright head is higher, also of a child that sits on the floor
_FLAT_HEAD = 0.05  # m: the middle of a head is higher, whatever the pose
_UPRIGHT, _ALONG = 0.5, 0.8  # cosine between the body and the upward axis, and another axis
_SPREAD = 0.3  # m of standing height: points that differ less say nothing about the body's direction
_BED = 1.1  # m: a lying body is not higher
_THICK, _LIMB = 0.35, 0.8  # m: a lying trunk is not thicker, and its raised limbs are not longer
_RISE = 0.2  # m by which hands are below a head along the axis of its body
_CROSSED = 0.15  # m by which both wrists must be on the other side
_FAR_CROSSED = 0.3  # m: crossed arms do not reach as far
_HANGING = 0.4  # times the height of the head, by which hanging hands are below it; those of crossed arms are not
_FINGERS = -0.3  # cosine of fingers and view: they point back at the wearer
_ANKLE_HEIGHT = 0.08  # m, of a standing mean adult
_REACHING, _CARRIED = 0.6, 0.65  # times the path along the bones: usual distances of hands, and of trunk and legs
_LENGTHS = 0.7  # times the path along the bones: a trunk and legs that are as long are in metres
_EYES = 1.55  # m over the floor, of a standing mean adult's head
_TRUNK = ("head", "neck", "spine3", "spine2", "spine1", "pelvis")
_AXES: tuple[UpAxis, ...] = ("x", "y", "z", "-x", "-y", "-z")
_WORLD = ("unit", "axis", "floor")  # a doubt of a later kind follows from one of an earlier kind
_UNITS = "one of " + ", ".join(UNITS)


@dataclass(frozen=True)
class Guard:
    """Looks at one state's world, and reported doubts."""

    until: float = inf  # s: no look after it
    due: float = -inf  # s of the next look
    slow: bool = False  # the step to the last frame was longer than `_LONGEST_STEP`
    given: tuple[str, ...] = ()  # kinds of doubts that were reported

    def is_due(self, observation: Observation, before: float) -> bool:
        """Whether the next frames need a look, `before` s being the time of the last frame; NaN at first."""
        time = observation.time
        return (
            self.slow
            or len(time) > 1
            or (len(time) == 1 and not (time[0] < self.due and time[0] - before < _LONGEST_STEP))
        )


LOOKED = Guard(due=inf)  # of a state whose world was looked at by another process


def watch(guard: Guard, observation: Observation, before: float, floor: float) -> tuple[tuple[str, ...], Guard]:
    """Return notices about the next frames of a state, and the guard after them.

    Args:
        guard: after the frames before.
        observation: (T, P) of one person.
        before: s, time of the frame before; NaN at first.
        floor: m, its height.

    Each notice names the value, what is valid and the fix.
    """
    found: list[tuple[str, str]] = []
    with np.errstate(invalid="ignore"):
        steps = np.diff(np.concatenate([[before], observation.time]))
    long = np.concatenate([[guard.slow], steps > _LONGEST_STEP])
    if (long[1:] & long[:-1]).any():
        step = float(np.median(steps[steps > _LONGEST_STEP]))
        found.append(("times", f"frames are {step:.3g} s apart: give times in seconds, not in milliseconds"))
    due, until, frames = guard.due, guard.until, len(observation)
    k = int(np.searchsorted(observation.time, due))
    while k < frames:
        moment = float(observation.time[k])
        until = moment + _WATCHED if until == inf else until
        due = inf if moment > until else moment + _LOOK
        found += _doubts(observation, k, floor) if moment <= until else []
        k = max(k + 1, int(np.searchsorted(observation.time, due)))  # times may be invalid: it must advance
    fresh: dict[str, str] = {}
    for kind, text in found:
        before_it = _WORLD[: _WORLD.index(kind) + 1] if kind in _WORLD else (kind,)
        if not any(given in before_it for given in (*guard.given, *fresh)):
            fresh[kind] = text
    return tuple(fresh.values()), Guard(until, due, bool(long[-1]), (*guard.given, *fresh))


@lru_cache(maxsize=1)
def _paths() -> np.ndarray:
    """Return the lengths (P, P) m of the paths along the bones between the points of the default body."""
    skeleton = default_skeleton()
    count = len(skeleton.points)
    paths = np.zeros((count, count))
    for k in range(1, count):
        parent = skeleton.parents[k]
        paths[k, :k] = paths[parent, :k] + np.linalg.norm(skeleton.rest_offset[k])
        paths[:k, k] = paths[k, :k]
    return paths


@lru_cache(maxsize=1)
def _heights() -> np.ndarray:
    """Return the heights (P,) m of the points of a default body that stands with its arms down."""
    return np.asarray(forward_kinematics(standing_pose(default_skeleton()))[0])[:, 1]


def _standing(name: str) -> float:
    """Return the height (m) of a point of a default body that stands."""
    return float(_heights()[default_skeleton().index(name)])


@dataclass(frozen=True, eq=False)
class PlacedPoints:
    """Placed points of one frame."""

    names: tuple[str, ...]
    places: np.ndarray  # (P, 3) m
    paths: np.ndarray  # (P, P) m along the bones of the default body
    turned: dict[str, np.ndarray]  # rotations (4,) wxyz of turned points

    @cached_property
    def apart(self) -> np.ndarray:
        """Distances (P, P) m between the points."""
        return np.linalg.norm(self.places[:, None] - self.places, axis=-1)

    @cached_property
    def share(self) -> np.ndarray:
        """Distances (P, P) relative to the paths along the bones."""
        return np.maximum(self.apart - _SLACK, 0.0) / np.where(self.paths > 0, self.paths, np.inf)

    @cached_property
    def carried(self) -> list[int]:
        """Points of the trunk and of the legs."""
        arms = ("shoulder", "elbow", "wrist")
        return [k for k, name in enumerate(self.names) if name in BODY and name.rpartition("_")[2] not in arms]

    def place(self, name: str) -> np.ndarray | None:
        """Return the place (3,) of a point, or None."""
        return self.places[self.names.index(name)] if name in self.names else None


def _points(observation: Observation, k: int) -> PlacedPoints:
    """Return the points of the body in frame `k`."""
    skeleton = default_skeleton()
    known = [n for n, name in enumerate(observation.points) if name in skeleton.points]
    near = (np.abs(observation.position[k]) < _NUMBERS).all(axis=-1) & observation.has_position[k]  # NaN compares false
    placed = [n for n in known if near[n]]
    names = tuple(observation.points[n] for n in placed)
    rows = skeleton.indices(names)
    unit = (np.abs(observation.rotation[k]) < 2.0).all(axis=-1) & observation.has_rotation[k]
    turned = {observation.points[n]: observation.rotation[k, n] for n in known if unit[n]}
    return PlacedPoints(names, observation.position[k, placed], _paths()[np.ix_(rows, rows)], turned)


def _doubts(observation: Observation, k: int, floor: float) -> list[tuple[str, str]]:
    """Return kinds and texts of the doubts about frame `k`: the first of unit, axis and floor, and exchanged hands."""
    points = _points(observation, k)
    if not points.names:
        return []
    world = _size(points, floor) or _axis(points, floor) or _floor(points, floor)
    sides = None if world else _sides(points, floor)
    return [*world, *([] if sides is None else [("sides", sides)])]


def _size(points: PlacedPoints, floor: float) -> list[tuple[str, str]]:
    """Return doubts about the unit, or about points that are not of this body."""
    if len(points.names) < 2:
        return []
    apart, share = points.apart, points.share
    if len(points.names) > 2 and (apart < _SHORT * points.paths)[~np.eye(len(apart), dtype=bool)].all():
        text = f"the points are within {apart.max():.2g} m of each other: give metres, or the right unit, {_UNITS}"
        return [("unit", text)]
    if share.max() <= _LONG:
        return []
    stray = int(np.argmax((share > _LONG).sum(axis=1)))
    rest = np.delete(np.delete(share, stray, 0), stray, 1)
    a, b = (int(k) for k in np.unravel_index(int(np.argmax(share)), share.shape))
    if rest.max() <= _LONG and _is_in_metres(points, rest, stray, floor):
        other = points.names[b if a == stray else a]
        text = f"{points.names[stray]} is {apart[a, b]:.1f} m from {other}: see that it is of this person, in metres"
        return [("stray", text)]
    names = f"{points.names[b]} is {apart[a, b]:.1f} m from {points.names[a]}"
    return [("unit", f"{names}: give metres, or say the unit, unit='{_unit_of(points)}' ({_UNITS})")]


def _is_in_metres(points: PlacedPoints, rest: np.ndarray, stray: int, floor: float) -> bool:
    """Whether the points without one are of a body in metres: by its head's height, else by its lengths `rest`."""
    head = points.place("head")
    if head is not None and points.names[stray] != "head":
        return len(points.names) > 2 and head[1] - floor < _USUAL_HEAD
    return bool(rest.max() > _REACHING**2)


def _unit_of(points: PlacedPoints) -> str:
    """Return the likeliest unit of a body by its lengths, and by the height of the upper end of its trunk."""
    mean = np.mean(_directions(points) or [np.array([0.0, 1.0, 0.0])], axis=0)
    axis, _ = _nearest_axis(mean)
    along = points.places @ (
        np.asarray(quaternion_rotate(quaternion_conjugate(TURNS[axis]), np.array([0.0, 1.0, 0.0])))
    )
    trunk = next((name for name in _TRUNK if name in points.names), None)
    height = None if trunk is None else abs(float(along[points.names.index(trunk)])) / _standing(trunk)
    if len(points.names) < 2:
        return likely_unit(None, height)
    length = float(points.share[np.ix_(points.carried, points.carried)].max(initial=0.0))
    if length > _SHORT:
        return likely_unit(length / _CARRIED, None)
    return likely_unit(float(points.share.max()) / _REACHING, height)


def _directions(points: PlacedPoints) -> list[np.ndarray]:
    """Return unit vectors (3,) along which a body stands: its turned trunk, and its placed trunk and legs."""
    up = np.array([0.0, 1.0, 0.0])
    found = [
        np.asarray(quaternion_rotate(points.turned[name], up)) for name in ("head", "spine3", "pelvis")
        if name in points.turned and points.place(name) is not None
    ]  # fmt: skip
    carried = points.carried
    height = _heights()[default_skeleton().indices([points.names[k] for k in carried])]
    if len(carried) > 1 and np.ptp(height) > _SPREAD:
        high = height - height.mean()
        rise = high @ points.places[carried]
        found.append(rise / max(float(np.linalg.norm(rise)), 1e-9))
    return found


def _axis(points: PlacedPoints, floor: float) -> list[tuple[str, str]]:
    """Return a doubt about the upward axis, if the body stands along another one and cannot lie so."""
    directions = _directions(points)
    heights = points.places[:, 1] - floor
    wrists = [place for side in ("left", "right") if (place := points.place(f"{side}_wrist")) is not None]
    top = points.place("head")
    rise = None if top is None or not wrists else top - np.mean(wrists, axis=0)  # from the hands to the head, m
    if not directions:
        # Only the places of the head and of the hands: the axis is doubted only if the floor is wrong, too.
        head = heights[points.names.index("head")] if rise is not None else np.nan
        if rise is None or (heights.min() > -_SUNK and _FLAT_HEAD < head < _TALL):
            return []
        axis, cosine = _nearest_axis(rise)
        return [] if cosine < _ALONG or axis == "y" else [("axis", _axis_text(axis))]
    mean = np.mean(directions, axis=0)
    mean /= max(float(np.linalg.norm(mean)), 1e-9)
    if min(direction[1] for direction in directions) > -_UPRIGHT and mean[1] > _UPRIGHT:
        return []
    axis, cosine = _nearest_axis(mean)
    if axis == "y" or cosine < _ALONG or min(direction @ mean for direction in directions) < _UPRIGHT:
        return []
    if axis == "-y":
        return [("axis", _axis_text(axis))] if heights.min() < -_SUNK else []  # on the hands, else
    if len(directions) == 1:  # a turned head alone: hands below it, or a head in the floor, must confirm the axis
        is_low = not _FLAT_HEAD < heights.min() < _TALL
        if not (is_low if rise is None else rise @ mean > _RISE and rise[1] < _RISE):
            return []
    return [] if _can_lie(points, floor) else [("axis", _axis_text(axis))]


def _can_lie(points: PlacedPoints, floor: float) -> bool:
    """Whether the heights are those of a body that lies on the floor or on a bed."""
    heights = points.places[:, 1] - floor
    trunk = np.array([heights[k] for k, name in enumerate(points.names) if name in _TRUNK] or [heights.min()])
    return bool(
        heights.min() > -_FLAT_HEAD
        and trunk.min() > _FLAT_HEAD
        and trunk.max() < _BED
        and np.ptp(trunk) < _THICK
        and heights.max() < trunk.max() + _LIMB
    )


def _nearest_axis(vector: np.ndarray) -> tuple[UpAxis, float]:
    """Return the axis that is nearest to a vector (3,), and the cosine between them."""
    cosines = np.concatenate([vector, -vector]) / max(float(np.linalg.norm(vector)), 1e-9)
    return _AXES[int(np.argmax(cosines))], float(cosines.max())


def _axis_text(axis: UpAxis) -> str:
    sign = axis.upper() if axis.startswith("-") else f"+{axis.upper()}"
    return f"the body stands along {sign}: give positions with +Y up, or say the axis, up='{axis}'"


def _floor(points: PlacedPoints, floor: float) -> list[tuple[str, str]]:
    """Return a doubt about the height of the floor, or about the unit of a high head."""
    heights = points.places[:, 1] - floor
    head = points.place("head")
    low = int(np.argmin(heights))
    upright = any(direction[1] > _ALONG for direction in _directions(points))
    right = f"floor={_floor_of(points):.1f}"
    for name in _TRUNK:
        place = points.place(name)
        if place is None or place[1] - floor < _TALL - _EYES + _standing(name):
            continue
        value = f"{name} is {place[1] - floor:.1f} m over the floor"
        text = f"{value}: give heights over the floor, or say the floor's height, {right}"
        if points.share[np.ix_(points.carried, points.carried)].max() <= _LENGTHS:
            text += f"; or say the unit, unit='{_unit_of(points)}' ({_UNITS})"
        return [("floor", text)]
    if heights[low] < -_SUNK:
        name, value = points.names[low], f"{-heights[low]:.2f} m under the floor"
    elif head is not None and head[1] - floor < (_LOW_HEAD if upright else _FLAT_HEAD):
        name, value = "head", f"{head[1] - floor:.2f} m over the floor"
    else:
        return []
    return [("floor", f"{name} is {value}: give heights over the floor, or say the floor's height, {right}")]


def _floor_of(points: PlacedPoints) -> float:
    """Return the likely height (m) of the floor, if the body stands."""
    soles = [place[1] for name, place in zip(points.names, points.places, strict=True) if name.endswith("_ankle")]
    if soles:
        return float(min(soles)) - _ANKLE_HEIGHT
    top = max(range(len(points.names)), key=lambda k: points.places[k, 1])
    height = _standing(points.names[top])
    return float(points.places[top, 1] - height)


def _sides(points: PlacedPoints, floor: float) -> str | None:
    """Return a doubt about wrists that are both on the other side of the head's direction, unless arms are crossed."""
    head, turn = points.place("head"), points.turned.get("head")
    wrists = [points.place(f"{side}_wrist") for side in ("left", "right")]
    if head is None or turn is None or wrists[0] is None or wrists[1] is None:
        return None
    left, ahead = (np.asarray(quaternion_rotate(turn, np.array(axis))) for axis in ((1.0, 0, 0), (0, 0, 1.0)))
    across = (-float((wrists[0] - head) @ left), float((wrists[1] - head) @ left))
    drop = float(head[1] - max(wrists[0][1], wrists[1][1]))
    fingers = [
        float(sign * np.asarray(quaternion_rotate(points.turned[f"{side}_wrist"], np.array([1.0, 0, 0]))) @ ahead)
        for side, sign in (("left", 1), ("right", -1))
        if f"{side}_wrist" in points.turned
    ]
    size = min(max((float(head[1]) - floor) / _EYES, 0.5), 1.0)
    if min(across) < _CROSSED * size:
        return None
    hangs = drop > _HANGING * (float(head[1]) - floor)
    if min(across) < _FAR_CROSSED * size and not hangs and not (len(fingers) == 2 and max(fingers) < _FINGERS):
        return None
    return "left_wrist is on the right of the head, and right_wrist on its left: exchange them, or mirror the world"
