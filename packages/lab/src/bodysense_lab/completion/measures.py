"""The measures of one tracked clip (docs: metrics): errors, motion, feet and jumps, as running averages over frames.

Positions are of the 22 joints of `BODY`, from the head; rotations are local ones, parent ← joint, of the same.
Velocities, jitter, skate, depth under the floor and jumps are of the world. Everything is at `RATE`.

Whether expected errors are true: running histograms of expected against true errors, and what they come to.

Points that are tracked do not count. Points and frames are put into bins of the expected error, each `_STEP` times as
wide as the one before. The *calibration error* (ECE) is the mean over points of the difference, in their bin, between
mean expected and mean true error, in shares of the overall mean error. *Coverage* is the share of points whose true
error is within the 90 % bound that the tracker gives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from bodysense.body.skeleton import BODY, LOWER_BODY, Skeleton
from bodysense.metrics import (
    floor_penetration,
    foot_skate,
    jitter,
    joint_error,
    mpjpe,
    on_floor,
    rotation_error,
    velocity_error,
)
from bodysense.observation import Observation, observed_points
from bodysense_lab.completion.scenes import TrackedScene
from bodysense_lab.completion.sight import jump_frames
from bodysense_lab.completion.tracking import Tracked
from bodysense_lab.scoring import RATE, scored_points

_SHORTEST, _LONGEST, _BINS = 1e-4, 10.0, 100  # m; beyond, the first and last bin
_STEP = (_LONGEST / _SHORTEST) ** (1 / _BINS)


@dataclass
class Calibration:
    """Running histograms over points and frames."""

    pairs: np.ndarray = field(default_factory=lambda: np.zeros((_BINS, _BINS)))  # by expected and true error
    expected: np.ndarray = field(default_factory=lambda: np.zeros(_BINS))  # sums by expected error, m
    error: np.ndarray = field(default_factory=lambda: np.zeros(_BINS))  # the same of true errors
    within: float = 0.0  # points within their interval

    def add(self, expected: np.ndarray, error: np.ndarray, bound: np.ndarray) -> None:
        """Count expected errors, true errors and 90 % bounds (N,), m, of points."""
        rows, columns = _bin(expected), _bin(error)
        self.pairs += np.bincount(rows * _BINS + columns, minlength=_BINS**2).reshape(_BINS, _BINS)
        self.expected += np.bincount(rows, expected, _BINS)
        self.error += np.bincount(rows, error, _BINS)
        self.within += float((error <= bound).sum())

    def merge(self, other: Calibration) -> None:
        """Count what another has counted."""
        self.pairs += other.pairs
        self.expected += other.expected
        self.error += other.error
        self.within += other.within

    @property
    def count(self) -> float:
        """Points and frames."""
        return float(self.pairs.sum())

    @property
    def ece(self) -> float:
        """Calibration error, in shares of the mean error; NaN where nothing was counted."""
        total = float(self.error.sum())
        return float(np.abs(self.error - self.expected).sum()) / total if total else math.nan

    @property
    def coverage(self) -> float:
        """Share of points within their 90 % bound; NaN where nothing was counted."""
        return self.within / self.count if self.count else math.nan

    @property
    def rank_correlation(self) -> float:
        """Spearman's correlation of expected and true error, up to the width of the bins."""
        if not self.count:
            return math.nan
        rows, columns = self.pairs.sum(axis=1), self.pairs.sum(axis=0)
        a, b = _centred_ranks(rows), _centred_ranks(columns)
        scale = math.sqrt(float(rows @ a**2) * float(columns @ b**2))
        return float(a @ self.pairs @ b) / scale if scale else math.nan

    def curve(self, fewest: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
        """Mean expected and mean true error (N,), m, of the bins with at least this share of the points."""
        count = self.pairs.sum(axis=1)
        chosen = count > fewest * count.sum()
        return self.expected[chosen] / count[chosen], self.error[chosen] / count[chosen]


def _bin(values: np.ndarray) -> np.ndarray:
    """The bin (N,) of errors, m."""
    place = np.log(np.maximum(values, 1e-12) / _SHORTEST) / math.log(_STEP)
    return place.clip(0, _BINS - 1).astype(int)


def _centred_ranks(count: np.ndarray) -> np.ndarray:
    """Mean rank of each bin's points, from the mean of all."""
    return np.cumsum(count) - (count - 1) / 2 - (count.sum() + 1) / 2


JUMP = 5.0  # cm in a frame, beyond the way of the truth
REGIONS = {"lower": LOWER_BODY, "upper": tuple(name for name in BODY if name not in LOWER_BODY)}
_BALLS = ("left_foot", "right_foot")
_FEET = (*_BALLS, "left_ankle", "right_ankle", "left_toe", "right_toe")


@dataclass
class Averages:
    """Running weighted means by name."""

    total: dict[str, float] = field(default_factory=dict)
    weight: dict[str, float] = field(default_factory=dict)

    def add(self, name: str, value: float, weight: float) -> None:
        """Add a mean with its weight in frames, joints or minutes; a weight of 0 adds nothing."""
        if weight:
            self.total[name] = self.total.get(name, 0.0) + value * weight
            self.weight[name] = self.weight.get(name, 0.0) + weight

    def merge(self, other: Averages) -> None:
        """Count what another has counted."""
        for name, weight in other.weight.items():
            self.add(name, other.total[name] / weight, weight)

    def get(self, name: str) -> float:
        """One mean; NaN where nothing was counted."""
        return self.total[name] / self.weight[name] if name in self.weight else math.nan

    def root(self, name: str) -> float:
        """The root of a mean of squares."""
        return math.sqrt(self.get(name))


def measure(scene: TrackedScene, tracked: Tracked) -> Averages:
    """Every measure of a scene's frames but those of hidden joints."""
    averages, skeleton, frames = Averages(), scene.skeleton, len(scene)
    body = skeleton.indices(BODY)
    truth, position = scene.placed[0], tracked.position
    error = scene.error_from_head(position)
    averages.add("mpjpe_cm", mpjpe(error), frames)
    for region, names in REGIONS.items():
        averages.add(f"{region}_mpjpe_cm", mpjpe(error[:, [BODY.index(name) for name in names]]), frames)
    turned = rotation_error(tracked.rotation[:, body], scene.pose.rotation[:, body])
    averages.add("rotation_deg", turned, frames)
    if frames > 1:
        moved = velocity_error(position[:, body], truth[:, body], RATE)
        averages.add("velocity_cm_s", moved, frames - 1)
        minutes = (frames - 1) / RATE / 60
        averages.add("jumps_per_minute", count_jumps(position[:, body], truth[:, body]) / minutes, minutes)
        averages.add("breaks_per_minute", count_jumps(position[:, body], truth[:, body], 2) / minutes, minutes)
    averages.merge(motion_measures(position, truth, skeleton))
    return averages


def motion_measures(position: np.ndarray, truth: np.ndarray, skeleton: Skeleton) -> Averages:
    """Jitter, skate and depth under the floor of positions (T, P, 3) m, or of the truth itself."""
    averages, frames = Averages(), len(position)
    if frames > 1:
        balls = skeleton.indices(_BALLS)
        standing = float(on_floor(truth[:, balls], RATE).sum())
        averages.add("skate_cm_s", foot_skate(position[:, balls], truth[:, balls], RATE), standing)
    if frames > 3:
        averages.add("jitter", jitter(position[:, skeleton.indices(BODY)], RATE), frames - 3)
    averages.add("depth_cm", floor_penetration(position[:, skeleton.indices(_FEET)]), frames)
    return averages


def count_jumps(position: np.ndarray, truth: np.ndarray, order: int = 1) -> int:
    """Frames in which some point of (T, P, 3) m goes more than `JUMP` farther than its truth goes.

    With `order` 2: farther from where its velocity leads.
    """
    return int(jump_frames(position, truth, JUMP / 100, order).sum())


def measure_hidden(position: np.ndarray, scene: TrackedScene) -> Averages:
    """Errors, in the world, of positions (T, P, 3) m of the joints that UNOC tests, where cameras do not see them."""
    averages, tested = Averages(), scored_points(scene.skeleton)
    hidden = ~scene.visible[:, tested]
    error = joint_error(position[:, tested], scene.placed[0][:, tested])[hidden]
    if error.size:
        averages.add("occluded_mpjpe_cm", float(error.mean()), error.size)
        averages.add("occluded_square", float((error**2).mean()), error.size)
    return averages


def measure_confidence(scene: TrackedScene, seen: Observation, tracked: Tracked) -> dict[str, Calibration]:
    """By region: expected and true errors, in the world, of joints that are not tracked; `seen` is (T, P)."""
    known = observed_points(seen, scene.skeleton)[2]
    error = joint_error(tracked.position, scene.placed[0]) / 100
    regions = {}
    for region, names in REGIONS.items():
        places = scene.skeleton.indices(names)
        counted = ~known[:, places]
        regions[region] = Calibration()
        expected, true, bound = (values[:, places][counted] for values in (tracked.confidence, error, tracked.bound))
        regions[region].add(expected, true, bound)
    return regions
