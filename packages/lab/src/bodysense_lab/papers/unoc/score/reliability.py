"""Reliability of the predictor: expected against true errors of hidden points.

Frames and points are put in order of the expected error and cut into bins of equal count. A point of the body is
measured in the world, one of a finger from its wrist, as the expected error is meant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.sensors import HEADSET_CAMERA, observe
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.core.chart import BarPanel, plain_bars
from bodysense_lab.core.scoring import RATE, group_of, part_errors
from bodysense_lab.core.table import Report, cell, finite
from bodysense_lab.data.datasets import Census, DataSet, describe_data
from bodysense_lab.papers.unoc.learned import Learned, load_model

BINS = 10
PARTS = {"body": "body", "finger": "fingers"}


@dataclass(eq=False)
class ErrorPairs:
    """Expected and true errors of hidden points."""

    expected: np.ndarray  # (N,) cm
    error: np.ndarray  # (N,) cm

    def merge(self, other: ErrorPairs) -> None:
        """Add the points of another."""
        self.expected = np.concatenate([self.expected, other.expected])
        self.error = np.concatenate([self.error, other.error])


def pairs_of_clip(clip: Clip, model: Path | None) -> dict[tuple[str, str], ErrorPairs]:
    """By group of categories and part: expected and true errors of what a headset does not see of a clip."""
    clip = resample(clip, RATE)
    skeleton = clip.pose.skeleton
    observation = observe(clip.pose, clip.time, HEADSET_CAMERA)
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


def binned(pairs: ErrorPairs) -> list[tuple[int, float, float]]:
    """Count, mean expected and mean true error (cm) of bins of equal count, in order of the expected error.

    The first bins are larger by one where the points do not divide.
    """
    order = np.array_split(np.argsort(pairs.expected, kind="stable"), BINS)
    return [(len(at), float(pairs.expected[at].mean()), float(pairs.error[at].mean())) for at in order if len(at)]


def correlations(pairs: ErrorPairs) -> tuple[float, float]:
    """Pearson's and Spearman's correlation over points and frames; NaN where either error is constant."""
    if len(pairs.error) < 2 or np.ptp(pairs.expected) == 0 or np.ptp(pairs.error) == 0:
        return math.nan, math.nan
    ranks = stats.rankdata(pairs.expected), stats.rankdata(pairs.error)
    return float(np.corrcoef(pairs.expected, pairs.error)[0, 1]), float(np.corrcoef(*ranks)[0, 1])


def reliability_report(pairs: dict[tuple[str, str], ErrorPairs], census: Census, data: DataSet) -> Report:
    """The table of the main categories, and correlations of the others."""
    rows, numbers, remarks, panels = [], {}, [], []
    for (group, part), some in sorted(pairs.items()):
        if not len(some.error):
            continue
        suffix, label = ("", PARTS[part]) if group == "main" else (f"_{group}", f"{PARTS[part]} ({group})")
        correlation, of_ranks = correlations(some)
        bias = float((some.expected - some.error).mean())
        numbers[f"{part}_correlation{suffix}"], numbers[f"{part}_rank_correlation{suffix}"] = correlation, of_ranks
        numbers[f"{part}_bias_cm{suffix}"] = bias
        remarks.append(
            f"{label}: correlation {correlation:.2f}, of ranks {of_ranks:.2f}; the mean expected error "
            f"is {abs(bias):.2f} cm too {'large' if bias > 0 else 'small'}."
        )
        if group != "main":
            continue
        bins = binned(some)
        for number, (count, expected, true) in enumerate(bins, start=1):
            rows.append((label, number, count, expected, true, expected - true))
            numbers[f"{part}_bin{number}_expected_cm"], numbers[f"{part}_bin{number}_error_cm"] = expected, true
        bars = (
            plain_bars("expected", [cell(expected) for _, expected, _ in bins]),
            plain_bars("true", [cell(true) for _, _, true in bins]),
        )
        names = tuple(str(number) for number in range(1, len(bins) + 1))
        panels.append(BarPanel(f"{label}, bins of {bins[0][0]:,} hidden points", names, bars, "mean error, cm"))
    return Report(
        name="reliability",
        title="Expected and true error of hidden points (shipped predictor, before IK)",
        columns=("joints", "bin", "points", "expected, cm", "true, cm", "difference"),
        rows=tuple(rows),
        numbers=finite(numbers) | census.numbers(),
        data=(describe_data(data, census),),
        remarks=tuple(remarks),
        remarks_title="How well they agree",
        caption="Bins of equal count in order of the expected error; means.",
        digits=2,
        panels=tuple(panels),
    )
