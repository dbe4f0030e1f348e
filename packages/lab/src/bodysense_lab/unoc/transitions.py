"""Jerk in the second after a joint is lost or seen again.

Jerk is the third difference of a joint's place, at 30 Hz. For each joint that the headset loses or sees again, the
second that begins with that frame has a peak jerk and an area under the jerk. The table has their means over all such
moments. The truth has jerk too: compare the others with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.io.clip import Clip
from bodysense.papers.ik_tracker import IkTrackerSettings
from bodysense.scoring import GROUPS, RATE, Tally, group_of, part_errors, scored_points
from bodysense_lab.chart import BarPanel, plain_bars
from bodysense_lab.datasets import Census, DataSet, census_of, describe
from bodysense_lab.spread import spread
from bodysense_lab.table import Report, cell, finite
from bodysense_lab.unoc.learned import track_clip

SECOND = round(RATE)  # frames
EVENTS = {"regained": "seen again", "lost": "lost"}
METHODS = {
    "truth": "truth",
    "heading": "last known",
    "network": "shipped, before IK",
    "bodysense": "shipped",
}
KEYS = {"truth": "truth", "heading": "last_known", "network": "best", "bodysense": "tracker"}  # in flat objects


@dataclass
class Jerks:
    """Running sums over moments."""

    count: int = 0
    peak: float = 0.0  # m/s³
    area: float = 0.0  # m/s²

    def merge(self, other: Jerks) -> None:
        """Count what another has counted."""
        self.count, self.peak, self.area = self.count + other.count, self.peak + other.peak, self.area + other.area

    @property
    def mean_peak(self) -> float:
        """m/s³."""
        return self.peak / self.count if self.count else math.nan

    @property
    def mean_area(self) -> float:
        """m/s²: the mean jerk of a second."""
        return self.area / self.count if self.count else math.nan


@dataclass(frozen=True)
class Transitions:
    """By group of categories, event and method; and errors of the body by group, share and method."""

    jerks: dict[tuple[str, str, str], Jerks]
    errors: dict[tuple[str, str, str], Tally]

    def merge(self, other: Transitions) -> None:
        """Count what another has counted."""
        for key, jerks in other.jerks.items():
            self.jerks.setdefault(key, Jerks()).merge(jerks)
        for key, tally in other.errors.items():
            self.errors.setdefault(key, Tally()).merge(tally)


def moments(visible: np.ndarray) -> dict[str, np.ndarray]:
    """Places (frame, point) at which points (T, P) are seen again, and lost, and whose second is in the clip.

    Three frames before them are needed as well, for the jerk.
    """
    before, now = visible[:-1], visible[1:]
    found = {"regained": now & ~before, "lost": before & ~now}
    result = {}
    for event, mask in found.items():
        frames, points = np.nonzero(mask)
        frames = frames + 1
        whole = (frames >= 3) & (frames + SECOND <= len(visible))
        result[event] = np.stack([frames[whole], points[whole]], axis=-1)
    return result


def jerks_at(position: np.ndarray, where: np.ndarray) -> Jerks:
    """Sums over moments (N, 2) of what positions (T, P, 3) m do in the second that begins there."""
    if not len(where):
        return Jerks()
    jerk = np.linalg.norm(np.diff(position, 3, axis=0), axis=-1) * RATE**3  # the first is that of frame 3
    seconds = jerk[where[:, :1] - 3 + np.arange(SECOND), where[:, 1:]]
    return Jerks(len(where), float(seconds.max(axis=1).sum()), float(seconds.sum()) / RATE)


def transitions_of_clip(clip: Clip, model: Path | None, settings: IkTrackerSettings) -> Transitions:
    """All methods on one clip."""
    tracked = track_clip(clip, model, settings)
    truth = np.asarray(forward_kinematics(tracked.clip.pose)[0])
    position = {"truth": truth, **{method: tracked.position[method] for method in METHODS if method != "truth"}}
    return transitions_of(position, truth, tracked.observation.has_position, tracked.clip)


def transitions_of(
    position: Mapping[str, np.ndarray], truth: np.ndarray, visible: np.ndarray, clip: Clip
) -> Transitions:
    """Methods with positions (T, P, 3) m at 30 Hz; visible (T, P). Of the joints that UNOC's tables test."""
    group, tested = group_of(clip), scored_points(clip.pose.skeleton)
    where = moments(visible[:, tested])
    result = Transitions({}, {})
    for method, values in position.items():
        for event in EVENTS:
            result.jerks[group, event, method] = jerks_at(values[:, tested], where[event])
        error, points = part_errors(values, truth, clip.pose.skeleton, False)["body"]
        for share, mask in (("occluded", ~visible[:, points]), ("all", np.full(error.shape, True))):
            tally = result.errors[group, share, method] = Tally()
            tally.add(error[mask])
    return result


def measure_transitions(
    data: DataSet, model: Path | None, settings: IkTrackerSettings, jobs: int, advance: Callable[[Clip], None]
) -> tuple[Transitions, Census]:
    """Measure all methods on a data set. `advance` is called after every clip."""
    total, census = Transitions({}, {}), Census()
    for clip, one in spread(partial(transitions_of_clip, model=model, settings=settings), data.clips(), jobs):
        census += census_of(clip)
        total.merge(one)
        advance(clip)
    return total, census


def transitions_report(found: Transitions, census: Census, data: DataSet) -> Report:
    """The table of the methods at both events."""

    def get(event: str, method: str, group: str = "main") -> Jerks:
        return found.jerks.get((group, event, method), Jerks())

    rows, panels, numbers, remarks = [], [], {}, []
    groups = [group for group in GROUPS[1:] if get("regained", "truth", group).count]
    for event, title in EVENTS.items():
        true = get(event, "truth")
        if not true.count:
            continue
        for method, name in METHODS.items():
            one = get(event, method)
            errors = [cell(found.errors["main", share, method].rmsjpe) for share in ("occluded", "all")]
            others = [cell(get(event, method, group).mean_peak) for group in groups]
            rows.append((title, name, one.count, one.mean_peak, one.mean_area, *errors, *others))
        heights = [get(event, method) for method in METHODS]
        for measure, values in (
            ("peak jerk, m/s³", [one.mean_peak for one in heights]),
            ("area under jerk, m/s²", [one.mean_area for one in heights]),
        ):
            panels.append(BarPanel(title, tuple(METHODS.values()), (plain_bars("mean", values),), measure))
        shipped, raw = get(event, "bodysense"), get(event, "network")
        before_peak, after_peak = (_times(one.mean_peak, true.mean_peak) for one in (raw, shipped))
        before_area, after_area = (_times(one.mean_area, true.mean_area) for one in (raw, shipped))
        remarks.append(
            f"When a joint is {title}, the shipped predictor's peak jerk is {before_peak} the truth's before IK and "
            f"smoothing and {after_peak} after; the area under its jerk {before_area} and {after_area}."
        )
    if rows:
        before, after = (found.errors["main", "occluded", method].rmsjpe for method in ("network", "bodysense"))
        remarks.append(f"The error of hidden joints of the body goes from {before:.2f} to {after:.2f} cm (RMSJPE).")
    for (group, event, method), one in found.jerks.items():
        suffix = "" if group == "main" else f"_{group}"
        numbers[f"{KEYS[method]}_{event}_peak_jerk{suffix}"] = one.mean_peak
        numbers[f"{KEYS[method]}_{event}_jerk_area{suffix}"] = one.mean_area
        numbers[f"{event}_moments{suffix}"] = one.count
    for (group, share, method), tally in found.errors.items():
        numbers[f"{KEYS[method]}_{share}_rmsjpe_cm" + ("" if group == "main" else f"_{group}")] = tally.rmsjpe
    return Report(
        name="transitions",
        title="The second after a joint is lost, or seen again",
        columns=(
            "joint is",
            "motion",
            "moments",
            "peak jerk, m/s³",
            "area, m/s²",
            "occluded RMSJPE",
            "all RMSJPE",
            *(f"{group} peak" for group in groups),
        ),
        rows=tuple(rows),
        numbers=finite(numbers) | census.numbers(),
        data=(describe(data, census),),
        remarks=tuple(remarks),
        remarks_title="What smoothing gives and costs",
        caption="Means over moments; errors of the body in cm, over all frames. Last known: turning with the head's "
        "heading.",
        panels=tuple(panels),
    )


def _times(value: float, true: float) -> str:
    return f"{value / true:.1f} times" if true else "many times"
