"""The guard of live input: what the first frames of a state show of a wrong world.

`Tracker.step` asks once for each state, so that a step costs nothing more. Doubts are notices of the estimate, since a
person may bend over, and a hand may be lost.
"""

from __future__ import annotations

import numpy as np

from bodysense.geometry.rotation import quaternion_rotate
from bodysense.observing.observation import Observation

_REACH = 1.6  # m from head to wrist of the tallest person, with an outstretched arm
_ANKLE = 2.2  # m from head to ankle of the tallest person
_TALL = 2.6  # m: a higher head is in another unit
_LOW = 0.35  # m: a lower head that is over the other points is counted from another origin
_UPRIGHT = 0.25  # m by which the head is over the other points along the axis of a body that stands
_ASIDE = 0.1  # m by which both wrists must be on the other side
LONGEST_STEP = 5.0  # s between frames; longer steps are times in milliseconds


def world_notices(observation: Observation, floor: float) -> tuple[str, ...]:
    """Return notices about the first frames of a state: axis, unit, floor, sides and places of its points.

    `observation` is of one person, (T, P). Each notice names the value and the fix.
    """
    place = _usual_places(observation)
    head = place.get("head")
    found: list[str] = []
    if len(observation) > 1 and (step := float(np.median(np.diff(observation.time)))) > LONGEST_STEP:
        found.append(interval_notice(step))
    if head is None:
        return tuple(found)
    others = [at for name, at in place.items() if name != "head" and not name.endswith("_top")]
    rise = head - np.mean(others, axis=0) if others else np.zeros(3)
    if rise[2] > _UPRIGHT and rise[2] > 2 * abs(rise[1]):
        found.append("the body stands along +Z: give positions with +Y up, or say the axis, up='z'")
    elif abs(head[1] - floor) < _LOW and (not others or rise[1] > _UPRIGHT):
        found.append(
            f"the head is {head[1] - floor:.2f} m over the floor, and the other points are below it: give heights over "
            "the floor, or the floor's height, TrackerSettings(floor=-1.6)"
        )
    elif head[1] - floor > _TALL:
        found.append(f"the head is {head[1] - floor:.1f} m over the floor: give metres, or say the unit, unit='ft'")
    for name, at in place.items():
        part = name.rpartition("_")[2]
        limit = _REACH if part == "wrist" else _ANKLE if part in ("ankle", "foot") else np.inf
        far = float(np.linalg.norm(at - head))
        if far > limit:
            found.append(f"{name} is {far:.1f} m from the head: see that it is of this person, in metres")
    if (swap := _swapped(observation, place)) is not None:
        found.append(swap)
    return tuple(found)


def _usual_places(observation: Observation) -> dict[str, np.ndarray]:
    """Return the median position (3,) m of each point that is tracked, by name."""
    seen = observation.has_position
    always = np.asarray(seen.all(axis=0))
    medians = iter(np.median(observation.position[:, always], axis=0))  # at once, since a call costs more than a point
    return {
        name: next(medians) if always[k] else np.median(observation.position[seen[:, k], k], axis=0)
        for k, name in enumerate(observation.points)
        if seen[:, k].any()
    }


def interval_notice(step: float) -> str:
    """Return the notice about frames that are `step` s apart."""
    return f"frames are {step:.3g} s apart: give times in seconds, not in milliseconds"


def _swapped(observation: Observation, place: dict[str, np.ndarray]) -> str | None:
    """Return a notice if both wrists are on the other side of the head's direction."""
    k = observation.points.index("head")
    turned = observation.has_rotation[:, k]
    if not turned.any() or not {"left_wrist", "right_wrist"} <= place.keys():
        return None
    left = quaternion_rotate(observation.rotation[:, k][turned], np.array([1.0, 0.0, 0.0])).mean(axis=0)
    sides = [float((place[f"{side}_wrist"] - place["head"]) @ left) for side in ("left", "right")]
    if sides[0] > -_ASIDE or sides[1] < _ASIDE:
        return None
    return "left_wrist is on the right of the head, and right_wrist on its left: exchange them, or mirror the world"
