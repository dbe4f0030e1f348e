"""How smooth the motion is (UNOC, section 4.2): the share of joints and frames with an acceleration above 9 m/s².

It is measured for the truth, for a network that predicts the mask, for one that is given it, and for the shipped
predictor, each before and after inverse kinematics and smoothing, with the errors of joints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.intervals import Named
from bodysense.io.clip import Clip
from bodysense.metrics import acceleration
from bodysense.observation import Observation
from bodysense.papers.ik_tracker import IkTracker, IkTrackerSettings
from bodysense.scoring import GROUPS, RATE, Tally, group_of, part_errors, scored_points
from bodysense_lab.chart import BarPanel, plain_bars
from bodysense_lab.datasets import Census, DataSet, describe, gathered, missing
from bodysense_lab.table import Report, cell, finite, ordering
from bodysense_lab.unoc.learned import track_clip

NETWORKS = ("gru", "mask_given")
METHODS = {
    "truth": "truth",
    "gru": "mask predicted",
    "gru_tracker": "mask predicted, after IK",
    "mask_given": "mask given",
    "mask_given_tracker": "mask given, after IK",
    "best": "shipped, before IK",
    "tracker": "shipped",
}
PUBLISHED = {"truth": 0.2, "gru": 3.5, "mask_given": 6.1}  # %
LIMIT = 9.0  # m/s²
_GUESS = 0.05  # m: expected error of networks that do not predict it


@dataclass
class Smoothness:
    """Running sums of one method: joints and frames with strong acceleration, and all; errors, cm."""

    counted: float = 0.0
    strong: float = 0.0
    added: float = 0.0  # strong ones that the truth does not have
    occluded: Tally = field(default_factory=Tally)
    all: Tally = field(default_factory=Tally)

    def merge(self, other: Smoothness) -> None:
        """Count what another has counted."""
        self.counted += other.counted
        self.strong += other.strong
        self.added += other.added
        self.occluded.merge(other.occluded)
        self.all.merge(other.all)

    @property
    def percent(self) -> float:
        """Share of joints and frames with strong acceleration."""
        return 100 * self.strong / self.counted if self.counted else math.nan

    @property
    def added_percent(self) -> float:
        """Share of joints and frames with strong acceleration that the truth does not have."""
        return 100 * self.added / self.counted if self.counted else math.nan


Sums = dict[tuple[str, str, str], Smoothness]  # by group of categories, part of the body, method


@dataclass(frozen=True, eq=False)
class RecordedEstimator:
    """An estimator that ran before; the state is the frame that comes next."""

    estimate: PointEstimate

    @property
    def skeleton(self) -> Skeleton:
        """The body that is completed."""
        return self.estimate.skeleton

    def start(self) -> int:
        """The first frame."""
        return 0

    def step(self, observation: Observation, state: int) -> tuple[PointEstimate, int]:
        """Return the estimates of the next T frames."""
        end = state + len(observation)
        frames = slice(state, end)
        said = self.estimate
        return PointEstimate(said.skeleton, said.position[frames], said.occluded[frames], said.confidence[frames]), end


def after_tracker(
    position: np.ndarray, observation: Observation, skeleton: Skeleton, settings: IkTrackerSettings
) -> np.ndarray:
    """Positions (T, P, 3) m of a network after inverse kinematics and smoothing."""
    shape = position.shape[:-1]
    tracker = IkTracker(
        RecordedEstimator(PointEstimate(skeleton, position, np.zeros(shape), np.full(shape, _GUESS))), settings
    )
    pose, _, _ = tracker.step(observation, tracker.start())
    return np.asarray(forward_kinematics(pose)[0])


def smoothness_of_clip(
    clip: Clip, networks: Mapping[str, Path], model: Path | None, settings: IkTrackerSettings
) -> Sums:
    """All methods of `METHODS` on one clip, every frame."""
    from bodysense_lab.unoc.variant_scores import positions_of

    tracked = track_clip(clip, model, settings)
    skeleton, observation = tracked.clip.pose.skeleton, tracked.observation
    truth = np.asarray(forward_kinematics(tracked.clip.pose)[0])
    position = {"truth": truth, "best": tracked.position["network"], "tracker": tracked.position["bodysense"]}
    for name, values in positions_of(networks, observation, skeleton, np.arange(len(truth))).items():
        position[name] = values
        position[f"{name}_tracker"] = after_tracker(values, observation, skeleton, settings)
    return smoothness_of(position, truth, ~observation.has_position, tracked.clip)


def smoothness_of(position: Mapping[str, np.ndarray], truth: np.ndarray, hidden: np.ndarray, clip: Clip) -> Sums:
    """Sums of methods with positions (T, P, 3) m at 30 Hz; hidden (T, P)."""
    skeleton, group = clip.pose.skeleton, group_of(clip)
    points = {"body": scored_points(skeleton)}
    if clip.has_fingers:
        points["body_and_finger"] = points["body"] + np.flatnonzero(skeleton.wrist_of >= 0).tolist()
    true = acceleration(truth, RATE) > LIMIT
    sums: Sums = {}
    for method, values in position.items():
        strong = acceleration(values, RATE) > LIMIT
        errors = part_errors(values, truth, skeleton, clip.has_fingers)
        for part, chosen in points.items():
            one = sums[group, part, method] = Smoothness()
            one.counted, one.strong = strong[:, chosen].size, int(strong[:, chosen].sum())
            one.added = int((strong & ~true)[:, chosen].sum())
            error, places = errors[part]
            one.occluded.add(error[hidden[:, places]])
            one.all.add(error)
    return sums


def measure_smoothness(
    data: DataSet,
    networks: Mapping[str, Path],
    model: Path | None,
    settings: IkTrackerSettings,
    jobs: int,
    advance: Callable[[Clip], None],
) -> tuple[Sums, Census]:
    """Measure all methods on a data set. `advance` is called after every clip."""
    work = partial(smoothness_of_clip, networks=networks, model=model, settings=settings)
    return gathered(work, data.clips(), jobs, advance)


def smoothness_report(sums: Sums, census: Census, data: DataSet) -> Report:
    """The table of the methods, of the body and, where there are fingers, of both."""

    def get(part: str, method: str, group: str = "main") -> Smoothness:
        return sums.get((group, part, method), Smoothness())

    parts = {"body": "body", "body_and_finger": "body & fingers"}
    groups = [group for group in GROUPS[1:] if get("body", "truth", group).counted]
    rows = []
    for part, title in parts.items():
        for method, name in METHODS.items():
            one = get(part, method)
            if one.counted:
                others = [cell(get(part, method, group).percent) for group in groups]
                errors = (cell(one.occluded.rmsjpe), cell(one.all.rmsjpe))
                rows.append((title, name, one.percent, PUBLISHED.get(method), one.added_percent, *errors, *others))
    numbers = {}
    for (group, part, method), one in sums.items():
        key = {"body": "", "body_and_finger": "_both"}[part] + ("" if group == "main" else f"_{group}")
        numbers[f"{method}_strong_acceleration_percent{key}"] = one.percent
        numbers[f"{method}_added_strong_acceleration_percent{key}"] = one.added_percent
        numbers[f"{method}_occluded_rmsjpe_cm{key}"] = one.occluded.rmsjpe
        numbers[f"{method}_all_rmsjpe_cm{key}"] = one.all.rmsjpe

    def named(method: str) -> Named:
        return Named(METHODS[method], get("body", method).percent)

    remarks = [
        ordering("A network that predicts the mask is smoother than one that is given it", named("gru"),
                 [named("mask_given")], "%"),
        ordering("The truth is smoother than either network", named("truth"), [named("gru"), named("mask_given")], "%"),
        ordering("IK and smoothing make the network's motion smoother", named("gru_tracker"), [named("gru")], "%"),
        ordering("Not in the paper: the shipped predictor is smoother than the paper's network", named("tracker"),
                 [named("gru")], "%"),
        *_cost(get("body", "gru"), get("body", "gru_tracker")),
    ]  # fmt: skip
    methods = [method for method in METHODS if get("body", method).counted]
    bars = (
        plain_bars("ours", [get("body", method).percent for method in methods]),
        plain_bars("published (UNOC)", [PUBLISHED.get(method) for method in methods]),
    )
    return Report(
        name="unoc-smoothness",
        title="UNOC, section 4.2: strong accelerations",
        columns=(
            "joints",
            "motion",
            "above 9 m/s², %",
            "UNOC's, %",
            "beyond the truth, %",
            "occluded RMSJPE",
            "all RMSJPE",
            *(f"{group}, %" for group in groups),
        ),
        rows=tuple(rows),
        numbers=finite(numbers) | census.numbers(),
        data=(describe(data, census), *missing(("UNOC",), [data])),
        remarks=tuple(remark for remark in remarks if remark is not None),
        caption="Share of joints and frames at 30 Hz; beyond the truth: those where the truth's is not above 9 m/s². "
        "Errors in cm.",
        digits=2,
        panels=(BarPanel("body", tuple(METHODS[method] for method in methods), bars, "above 9 m/s², %"),),
    )


def _cost(before: Smoothness, after: Smoothness) -> list[str]:
    """Return a line about the change of errors by inverse kinematics and smoothing."""
    changes = [getattr(after, share).rmsjpe - getattr(before, share).rmsjpe for share in ("occluded", "all")]
    if not all(map(math.isfinite, changes)):
        return []
    return [
        f"IK and smoothing change the paper's network's RMSJPE by {changes[0]:+.2f} cm at hidden joints of the body "
        f"and {changes[1]:+.2f} cm over all of them; the paper's by -0.04 and +1.5 cm (section 5.1)."
    ]
