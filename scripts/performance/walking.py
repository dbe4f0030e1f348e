"""Walks: a route on the floor, times and places of footfalls, and the sway of the body over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

STEP = 0.58  # s from one landing to the next
SUPPORT = 0.06  # s of double support between two steps
AHEAD = 0.25  # s from a landing until the pelvis is over the foot
SPEEDING = 0.8  # s until a walk has its speed, and in which it loses it
APART = 0.085  # m from the middle of the route to an ankle
OUTWARD = 6.0  # degrees that a foot is turned outward


@dataclass(frozen=True)
class Footfall:
    """A footfall: a foot that stands for some time."""

    side: str
    start: float  # s: the sole comes down
    end: float  # s: the heel goes up
    x: float  # m, place of the ankle
    z: float
    heading: float  # degrees, of the foot


@dataclass(frozen=True)
class Walk:
    """A walk along straight lines and bends, right foot first, at a steady speed between start and stop."""

    begin: float  # s
    x: float  # m, where the walker stands before
    z: float
    heading: float  # degrees; 0 faces +Z, 90 faces +X
    parts: Sequence[tuple[float, float]]  # metres, and degrees that they turn to the left
    steps: int

    @property
    def end(self) -> float:
        """Time at which the walker stands again, s."""
        return self.begin + (self.steps + 1) * STEP

    @cached_property
    def _route(self) -> np.ndarray:
        """(N, 3) x, z, degrees, every centimetre."""
        rows = [np.array([self.x, self.z, self.heading])]
        for length, turn in self.parts:
            count = max(1, round(100 * length))
            for _ in range(count):
                x, z, heading = rows[-1]
                middle = np.deg2rad(heading + turn / count / 2)
                step = length / count
                rows.append(np.array([x + step * np.sin(middle), z + step * np.cos(middle), heading + turn / count]))
        return np.stack(rows)

    def at(self, time: np.ndarray) -> np.ndarray:
        """(T, 3) x, z (m) and heading (degrees) of the pelvis' way."""
        fine = np.linspace(self.begin, self.end, 400)
        speed = _ease((fine - self.begin) / SPEEDING) * _ease((self.end - fine) / SPEEDING)
        share = np.concatenate([[0], np.cumsum(speed[1:] + speed[:-1])])
        place = np.interp(time, fine, share / share[-1]) * (len(self._route) - 1)
        return np.stack([np.interp(place, np.arange(len(self._route)), column) for column in self._route.T], axis=-1)

    def landings(self) -> list[Footfall]:
        """Return every footfall, with the duration of its stance; the last two have no end."""
        falls = []
        for k in range(1, self.steps + 2):
            land = self.begin + k * STEP
            last = k > self.steps - 1
            over = self.at(np.array([self.end if k > self.steps else land + AHEAD]))[0]
            side = "right" if k % 2 else "left"
            falls.append(_footfall(side, land, np.inf if last else land + STEP + SUPPORT - 0.02, over))
        return falls

    def phase(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Stride (T,), from −1 with the left foot ahead to 1 with the right, and how much of a walk it is, 0 to 1."""
        stride = -np.cos(np.pi * (time - self.begin) / STEP)
        moving = _ease((time - self.begin) / SPEEDING) * _ease((self.end - time) / SPEEDING)
        return stride * moving, moving


def footfalls(walks: Sequence[Walk], seconds: float) -> list[Footfall]:
    """Return every footfall, from before the first walk to after the last."""
    start = np.array([walks[0].x, walks[0].z, walks[0].heading])
    standing = {side: _footfall(side, -1.0, np.inf, start) for side in ("left", "right")}
    found = []
    for walk in walks:
        for fall in walk.landings():
            before = standing[fall.side]
            lifted = min(before.end, fall.start - STEP + 0.10)
            found.append(Footfall(before.side, before.start, lifted, before.x, before.z, before.heading))
            standing[fall.side] = fall
    for fall in standing.values():
        found.append(Footfall(fall.side, fall.start, seconds + 1, fall.x, fall.z, fall.heading))
    return sorted(found, key=lambda fall: fall.start)


def sway(walks: Sequence[Walk], time: np.ndarray) -> dict[str, np.ndarray]:
    """Return what walks add to the body, by degree of freedom, in metres and radians: (T,) each."""
    names = ("x", "y", "z", "heading", "roll", "side", "turn", "bend", "left_arm_forward", "right_arm_forward")
    added = {name: np.zeros(len(time)) for name in (*names, "left_elbow", "right_elbow")}
    for walk in walks:
        stride, moving = walk.phase(time)
        # Over the standing foot between two landings: to the right after a landing of the right foot.
        over = np.cos(np.pi * (time - walk.begin - AHEAD) / STEP) * moving
        way = np.deg2rad(walk.at(time)[:, 2])
        added["x"] += 0.03 * over * np.cos(way)
        added["z"] -= 0.03 * over * np.sin(way)
        added["y"] += moving * (-0.044 - 0.014 * np.cos(2 * np.pi * (time - walk.begin) / STEP))
        added["heading"] += 0.07 * stride
        added["roll"] += 0.035 * over  # the swinging leg's side of the pelvis drops
        added["side"] -= 0.1 * over  # the trunk leans over the standing leg
        added["turn"] -= 0.15 * stride
        added["bend"] += 0.03 * moving
        for side, sign in (("left", 1.0), ("right", -1.0)):
            added[f"{side}_arm_forward"] += 0.34 * sign * stride
            added[f"{side}_elbow"] += 0.20 * sign * stride + 0.14 * moving
    return added


def _footfall(side: str, start: float, end: float, place: np.ndarray) -> Footfall:
    x, z, heading = place
    sign, way = (1.0 if side == "left" else -1.0), np.deg2rad(heading)
    ankle = (float(x + sign * APART * np.cos(way)), float(z - sign * APART * np.sin(way)))
    return Footfall(side, start, end, *ankle, float(heading + sign * OUTWARD))


def _ease(s: np.ndarray) -> np.ndarray:
    """Minimum jerk from 0 at s ≤ 0 to 1 at s ≥ 1. Flash and Hogan 1985."""
    s = np.clip(s, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)
