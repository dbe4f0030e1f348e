"""Reliability of the predictor: expected against true errors of hidden points.

Frames and points are put in order of the expected error and cut into bins of equal count. A point of the body is
measured in the world, one of a finger from its wrist, as the expected error is meant.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.headset_camera import observe
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.scoring import RATE, group_of, part_errors
from bodysense_lab.chart import BarPanel, plain_bars
from bodysense_lab.datasets import Census, DataSet, census_of, describe
from bodysense_lab.spread import spread
from bodysense_lab.table import Report, cell, finite
from bodysense_lab.unoc.learned import Learned, load_model

BINS = 10
PARTS = {"body": "body", "finger": "fingers"}


@dataclass(frozen=True, eq=False)
class ErrorPairs:
    """Expected and true errors of hidden points."""

    expected: np.ndarray  # (N,) cm
    error: np.ndarray  # (N,) cm


@dataclass(frozen=True)
class Bin:
    """Points whose expected errors are neighbours."""

    count: int
    expected: float  # mean, cm
    error: float  # mean, cm


@dataclass(frozen=True)
class Reliability:
    """Bins in order of the expected error, and how the two go together."""

    bins: tuple[Bin, ...]
    correlation: float  # Pearson's, over points and frames
    rank_correlation: float  # Spearman's
    bias: float  # cm, mean of expected less true


def pairs_of_clip(clip: Clip, model: Path | None) -> dict[tuple[str, str], ErrorPairs]:
    """By group of categories and part: expected and true errors of what a headset does not see of a clip."""
    clip = resample(clip, RATE)
    skeleton = clip.pose.skeleton
    observation = observe(clip.pose, clip.time)
    estimator = Learned(load_model(model), skeleton)
    estimate, _ = estimator.step(observation, estimator.start())
    truth = np.asarray(forward_kinematics(clip.pose)[0])
    hidden = ~observation.has_position
    result = {}
    for part, (error, points) in part_errors(estimate.position, truth, skeleton, clip.has_fingers).items():
        if part in PARTS:
            mask = hidden[:, points]
            result[group_of(clip), part] = ErrorPairs(100 * estimate.confidence[:, points][mask], error[mask])
    return result


def measure_reliability(
    data: DataSet, model: Path | None, jobs: int, advance: Callable[[Clip], None]
) -> tuple[dict[tuple[str, str], ErrorPairs], Census]:
    """Return all pairs of a data set, by group of categories and part. `advance` is called after every clip."""
    found: dict[tuple[str, str], list[ErrorPairs]] = {}
    census = Census()
    for clip, one in spread(partial(pairs_of_clip, model=model), data.clips(), jobs):
        census += census_of(clip)
        for key, pairs in one.items():
            found.setdefault(key, []).append(pairs)
        advance(clip)
    return {key: _joined(pairs) for key, pairs in found.items()}, census


def reliability_of(pairs: ErrorPairs, bins: int = BINS) -> Reliability:
    """Bins of equal count (the first ones are larger by one where it does not divide) and correlations."""
    order = np.argsort(pairs.expected, kind="stable")
    expected, error = pairs.expected[order], pairs.error[order]
    pieces = zip(np.array_split(expected, bins), np.array_split(error, bins), strict=True)
    return Reliability(
        bins=tuple(Bin(len(one), float(one.mean()), float(true.mean())) for one, true in pieces if len(one)),
        correlation=_correlation(expected, error),
        rank_correlation=_correlation(_ranks(expected), _ranks(error)),
        bias=float((expected - error).mean()) if len(error) else math.nan,
    )


def reliability_report(pairs: dict[tuple[str, str], ErrorPairs], census: Census, data: DataSet) -> Report:
    """The table of the main categories, and correlations of the others."""
    rows, numbers, remarks, panels = [], {}, [], []
    for (group, part), some in sorted(pairs.items()):
        if not len(some.error):
            continue
        one, suffix = reliability_of(some), "" if group == "main" else f"_{group}"
        numbers[f"{part}_correlation{suffix}"] = one.correlation
        numbers[f"{part}_rank_correlation{suffix}"] = one.rank_correlation
        numbers[f"{part}_bias_cm{suffix}"] = one.bias
        where = PARTS[part] + ("" if group == "main" else f" ({group})")
        remarks.append(
            f"{where}: correlation {one.correlation:.2f}, of ranks {one.rank_correlation:.2f}; the mean expected error "
            f"is {abs(one.bias):.2f} cm too {'large' if one.bias > 0 else 'small'}."
        )
        if group != "main":
            continue
        for number, piece in enumerate(one.bins, start=1):
            rows.append((PARTS[part], number, piece.count, piece.expected, piece.error, piece.expected - piece.error))
            numbers[f"{part}_bin{number}_expected_cm"] = piece.expected
            numbers[f"{part}_bin{number}_error_cm"] = piece.error
        bars = (
            plain_bars("expected", [cell(piece.expected) for piece in one.bins]),
            plain_bars("true", [cell(piece.error) for piece in one.bins]),
        )
        names = tuple(str(number) for number in range(1, len(one.bins) + 1))
        panels.append(
            BarPanel(f"{PARTS[part]}, bins of {one.bins[0].count:,} hidden points", names, bars, "mean error, cm")
        )
    return Report(
        name="reliability",
        title="Expected and true error of hidden points (shipped predictor, before IK)",
        columns=("joints", "bin", "points", "expected, cm", "true, cm", "difference"),
        rows=tuple(rows),
        numbers=finite(numbers) | census.numbers(),
        data=(describe(data, census),),
        remarks=tuple(remarks),
        remarks_title="How well they agree",
        caption="Bins of equal count in order of the expected error; means.",
        digits=2,
        panels=tuple(panels),
    )


def _joined(pairs: Iterable[ErrorPairs]) -> ErrorPairs:
    pairs = list(pairs)
    return ErrorPairs(np.concatenate([one.expected for one in pairs]), np.concatenate([one.error for one in pairs]))


def _ranks(values: np.ndarray) -> np.ndarray:
    """Places in order; equal values share the mean of theirs."""
    _, which, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - (count - 1) / 2)[which]


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Pearson's; NaN where there is nothing to correlate."""
    a, b = a - a.mean() if len(a) else a, b - b.mean() if len(b) else b
    scale = math.sqrt(float((a * a).sum() * (b * b).sum()))
    return float((a * b).sum()) / scale if scale else math.nan
