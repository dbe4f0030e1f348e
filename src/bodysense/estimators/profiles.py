"""Which profile a signal is of: told by what arrives, with some patience."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, get_args

import numpy as np

from bodysense.body.glove import glove_marker
from bodysense.body.skeleton import BODY
from bodysense.errors import BodysenseError
from bodysense.estimators.pulled import TRACKERS
from bodysense.observation import Observation
from bodysense.occlusion.three_point import POINTS

Profile = Literal["head", "three-point", "hands", "trackers", "headset-camera", "gloves"]
PROFILES: tuple[Profile, ...] = get_args(Profile)  # from the least to the most that is tracked
Kind = Literal["hands", "fingers", "trackers", "cameras", "gloves"]
_KINDS: tuple[Kind, ...] = get_args(Kind)
_PROFILE_OF: dict[Kind, Profile] = {
    **{"gloves": "gloves", "cameras": "headset-camera", "trackers": "trackers", "fingers": "hands"},
    "hands": "three-point",
}  # the first that arrives counts


@dataclass(frozen=True)
class ProfileSettings:
    """How soon a profile follows what arrives."""

    appears: float = 0.1  # s for which something arrives before it counts; at the very beginning it counts at once
    holds: float = 0.5  # s for which it counts after it was last there

    def __post_init__(self) -> None:
        for name in ("appears", "holds"):
            if not getattr(self, name) >= 0:
                raise BodysenseError(f"profile settings: {name} is {getattr(self, name):g}; it must be 0 or more")


@dataclass(frozen=True, eq=False)
class Arrivals:
    """What arrived, and when."""

    time: float | None = None  # s, of the last frame
    since: Mapping[Kind, float] = field(default_factory=dict)  # s, when it began, of all that may still count
    last: Mapping[Kind, float] = field(default_factory=dict)  # s, when it was there last


@lru_cache(maxsize=64)
def kinds_of(points: tuple[str, ...]) -> dict[Kind, np.ndarray]:
    """The places of the points of each kind among those of an observation, of the kinds that it may have at all.

    A joint that no tracker is worn at, such as a shoulder, is seen by cameras; then so are all others.
    """
    where: dict[Kind, list[int]] = {kind: [] for kind in _KINDS}
    for place, name in enumerate(points):
        side, _, part = name.partition("_")
        if glove_marker(name) is not None:
            where["gloves"].append(place)
        elif name in POINTS[1:]:
            where["hands"].append(place)
        elif name in TRACKERS:
            where["trackers"].append(place)
        elif name in BODY and name != "head":
            where["cameras"].append(place)
        elif side in ("left", "right") and part.startswith(("thumb", "index", "middle", "ring", "pinky")):
            where["fingers"].append(place)
    if where["cameras"]:
        for kind in ("hands", "trackers", "fingers"):
            where["cameras"] += where[kind]
            where[kind] = where[kind] if kind == "hands" else []
    return {kind: np.array(places) for kind, places in where.items() if places}


def arrived(observation: Observation, before: Arrivals, settings: ProfileSettings) -> Arrivals:
    """What arrived, with one more frame."""
    now, known = float(observation.time[0]), observation.has_position[0]
    since, last = dict(before.since), dict(before.last)
    for kind, places in kinds_of(observation.points).items():
        if known[places].any():
            if kind not in last or now - last[kind] > settings.holds:
                since[kind] = now if before.time is not None else -np.inf
            last[kind] = now
    return Arrivals(now, since, last)


def profile_of(arrivals: Arrivals, settings: ProfileSettings) -> Profile:
    """The profile that is in force after a frame."""
    now = arrivals.time
    if now is not None:
        for kind, profile in _PROFILE_OF.items():
            there = kind in arrivals.last and now - arrivals.last[kind] <= settings.holds
            if there and now - arrivals.since[kind] >= settings.appears:
                return profile
    return "head"
