"""Subject: the output of a tracker as it was given, which the checks judge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Literal

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_multiply
from bodysense.body.skeleton import default_skeleton

SHORTEST_INTERVAL = 0.004  # s: speeds over less say more of the clock than of the body
FOOT_POINTS = ("left_ankle", "right_ankle", "left_foot", "right_foot", "left_toe", "right_toe")
CALM = 1.0  # s: length of the calmest window

Kind = Literal["motion", "stream", "recording"]


@dataclass(frozen=True)
class Step:
    """One step of a script: from `start` to `end` the performer does what `label` says."""

    label: str
    start: float  # s, of the subject's clock
    end: float  # s


@dataclass(frozen=True, eq=False)
class Transport:
    """What only a container or stream says of its messages; None where it does not."""

    messages: int = 0  # that came
    malformed: int = 0  # of these could not be read
    lost: int = 0  # that the sequence numbers miss
    log_time: np.ndarray | None = None  # (T,) s, when each was written
    available: np.ndarray | None = None  # (T,) s, when each became available, on the clock of the samples
    device_time: np.ndarray | None = None  # (T,) s, of the device's own clock
    all_tracked: np.ndarray | None = None  # (T,) bool, the device's own summary of its joints


@dataclass(frozen=True, eq=False)
class Subject:
    """T frames of P points, named as the default skeleton's; world: +Y up, metres; rotations: the T-pose is identity.

    Nothing is mended: values may be NaN, quaternions of any length, times in any order.
    """

    name: str
    format: str  # "BVH", "MCAP" …
    points: tuple[str, ...]  # in the order of the default skeleton
    time: np.ndarray  # (T,) s
    position: np.ndarray  # (T, P, 3) m
    rotation: np.ndarray  # (T, P, 4) wxyz, world ← joint
    rotated: np.ndarray  # (P,) bool: the format gives this point a rotation
    valid: np.ndarray  # (T, P) bool: the device says that it has this point
    measured: np.ndarray | None = None  # (T, P) bool: measured, not completed; None where the device does not say
    floor: float | None = None  # m; None: not known, estimated from the feet
    steps: tuple[Step, ...] = ()
    transport: Transport = field(default_factory=Transport)
    sha256: str = ""

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def _place(self) -> dict[str, int]:
        return {name: k for k, name in enumerate(self.points)}

    def has(self, *names: str) -> bool:
        """Whether all these points are there, in at least one frame each."""
        return all(name in self._present for name in names)

    @cached_property
    def _present(self) -> frozenset[str]:
        return frozenset(np.array(self.points)[self.known.any(axis=0)].tolist())

    def at(self, name: str) -> np.ndarray:
        """(T, 3) m, NaN where it is not known."""
        return self.places[:, self._place[name]]

    def turn(self, name: str) -> np.ndarray:
        """(T, 4) world ← joint, of unit length, NaN where it is not known."""
        return self.turns[:, self._place[name]]

    @cached_property
    def known(self) -> np.ndarray:
        """(T, P) bool: the device says that it has the point, and its position is finite."""
        return self.valid & np.isfinite(self.position).all(axis=-1)

    @cached_property
    def places(self) -> np.ndarray:
        """(T, P, 3) m, NaN where not known."""
        return np.where(self.known[..., None], self.position, np.nan)

    @cached_property
    def turns(self) -> np.ndarray:
        """(T, P, 4) of unit length, NaN where not known."""
        length = np.linalg.norm(self.rotation, axis=-1, keepdims=True)
        good = self.valid[..., None] & np.isfinite(length) & (length > 1e-6)
        return np.where(good, self.rotation / np.where(good, length, 1), np.nan)

    @cached_property
    def step(self) -> np.ndarray:
        """(T - 1,) s between frames."""
        return np.diff(self.time)

    @cached_property
    def interval(self) -> float:
        """Median time between frames, s; NaN of one frame."""
        steps = self.step[np.isfinite(self.step)]
        return float(np.median(steps)) if len(steps) else float("nan")

    @cached_property
    def seconds(self) -> float:
        """From the first frame to the last."""
        return float(self.time[-1] - self.time[0]) if len(self) else 0.0

    @cached_property
    def velocity(self) -> np.ndarray:
        """(T - 1, P, 3) m/s; NaN over intervals that are too short, or go back."""
        step = np.where(self.step >= SHORTEST_INTERVAL, self.step, np.nan)
        return np.diff(self.places, axis=0) / step[:, None, None]

    @cached_property
    def speed(self) -> np.ndarray:
        """(T - 1, P) m/s."""
        return np.linalg.norm(self.velocity, axis=-1)

    @cached_property
    def bones(self) -> tuple[tuple[str, str], ...]:
        """Parent and child of every bone: a point and the nearest one above it that is there too."""
        ours = default_skeleton()
        pairs = []
        for name in self.points:
            above = ours.parents[ours.index(name)]
            while above >= 0 and not self.has(ours.points[above]):
                above = ours.parents[above]
            if above >= 0 and self.has(name):
                pairs.append((ours.points[above], name))
        return tuple(pairs)

    def length(self, parent: str, child: str) -> np.ndarray:
        """(T,) m from one point to another."""
        return np.linalg.norm(self.at(child) - self.at(parent), axis=-1)

    def local(self, parent: str, child: str) -> np.ndarray:
        """(T, 4) parent ← child."""
        return quaternion_multiply(quaternion_conjugate(self.turn(parent)), self.turn(child))

    @cached_property
    def height(self) -> float:
        """Ankle to head along the bones, m: the median over time of the sum; NaN where the chain is broken."""
        chain = [name for name in ("pelvis", "spine1", "spine2", "spine3", "neck", "head") if self.has(name)]
        if not self.has("head", "pelvis"):
            return float("nan")
        up = sum(float(np.nanmedian(self.length(a, b))) for a, b in pairwise(chain))
        legs = []
        for side in ("left", "right"):
            leg = [f"{side}_{part}" for part in ("hip", "knee", "ankle")]
            if self.has(*leg):
                legs.append(sum(float(np.nanmedian(self.length(a, b))) for a, b in pairwise(leg)))
        return up + float(np.mean(legs)) if legs else float("nan")

    @cached_property
    def feet(self) -> tuple[str, ...]:
        """Points of the feet that are there."""
        return tuple(name for name in FOOT_POINTS if self.has(name))

    @cached_property
    def ground(self) -> float:
        """Height of the floor, m: told, or where the lowest points of the feet mostly are."""
        if self.floor is not None:
            return self.floor
        if not self.feet:
            return float("nan")
        lowest = nan_min(np.stack([self.at(name)[:, 1] for name in self.feet]), axis=0)
        return float(np.nanpercentile(lowest, 5)) if np.isfinite(lowest).any() else float("nan")

    @cached_property
    def calm(self) -> slice | None:
        """The second in which the points of the body move least; None where no second is whole."""
        frames = round(CALM / self.interval) if self.interval > 0 else 0
        body = [k for k, name in enumerate(self.points) if not is_finger(name)]
        if frames < 8 or len(self) <= frames or not body:
            return None
        speed = self.speed[:, body]
        whole = np.asarray(np.isfinite(speed).all(axis=1))
        moving = np.where(whole, np.where(whole[:, None], speed, 0).mean(axis=1), np.inf)
        moving = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(moving), moving, 1e6))])
        total = moving[frames - 1 :] - moving[: len(moving) - frames + 1]
        start = int(np.argmin(total))
        return slice(start, start + frames) if total[start] < 1e6 else None

    def during(self, step: Step, share: float = 1.0) -> np.ndarray:
        """(T,) bool: the last `share` of a step."""
        start = step.end - share * (step.end - step.start)
        return (self.time >= start) & (self.time <= step.end)

    def labelled(self, *labels: str) -> list[Step]:
        """The steps of these labels, in their order."""
        return [step for step in self.steps if step.label in labels]


def is_finger(name: str) -> bool:
    """Whether a point is a joint or tip of a finger."""
    return name.partition("_")[2].startswith(("thumb", "index", "middle", "ring", "pinky"))


def ordered(names: Sequence[str]) -> tuple[str, ...]:
    """Those names that the default skeleton has, in its order."""
    return tuple(name for name in default_skeleton().points if name in set(names))


def nan_min(values: np.ndarray, axis: int) -> np.ndarray:
    """The least of what is no NaN; NaN where nothing is (without NumPy's warning)."""
    found = np.where(np.isnan(values), np.inf, values).min(axis=axis)
    return np.where(np.isinf(found), np.nan, found)
