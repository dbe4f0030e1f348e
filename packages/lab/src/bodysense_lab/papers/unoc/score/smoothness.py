"""How smooth the motion is (UNOC, section 4.2): the share of joints and frames with an acceleration above 9 m/s².

It is measured for the truth, for a network that predicts the mask, for one that is given it, and for the shipped
predictor, each before and after inverse kinematics and smoothing, with the errors of joints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.io.clip import Clip
from bodysense.observing.observation import Observation
from bodysense.quality.metrics import acceleration
from bodysense_lab.core.score_table import (
    Published,
    ScoreColumn,
    ScoreRow,
    ScoreTable,
    claim,
    score_report,
)
from bodysense_lab.core.scoring import RATE, Tally, group_of, part_errors, scored_points
from bodysense_lab.core.table import Report
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet, describe_data, missing_data_remarks
from bodysense_lab.papers.unoc.ik_tracker import IkTracker, IkTrackerSettings
from bodysense_lab.papers.unoc.learned import track_clip

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


TABLE = ScoreTable(
    name="unoc-smoothness",
    title="UNOC, section 4.2: strong accelerations",
    axes=("joints", "motion"),
    places={"body": ScoreRow("body"), "body_and_finger": ScoreRow("body & fingers", ending="_both")},
    methods=METHODS,
    figures=(
        ScoreColumn("above 9 m/s², %", "strong", key="{method}_strong_acceleration_percent{place.ending}"),
        ScoreColumn("beyond the truth, %", "added", key="{method}_added_strong_acceleration_percent{place.ending}"),
        ScoreColumn("occluded RMSJPE", "occluded", "rmsjpe", "{method}_occluded_rmsjpe_cm{place.ending}"),
        ScoreColumn("all RMSJPE", "all", "rmsjpe", "{method}_all_rmsjpe_cm{place.ending}"),
    ),
    caption="Share of joints and frames at 30 Hz; beyond the truth: those where the truth's is not above 9 m/s². "
    "Errors in cm.",
    published=(
        Published(
            ("UNOC's, %",),
            {
                (part, method): (percent,)
                for part in ("body", "body_and_finger")
                for method, percent in PUBLISHED.items()
            },
        ),
    ),
    claims=tuple(
        claim(text, METHODS, "body", lower, *higher)
        for text, lower, *higher in (
            ("A network that predicts the mask is smoother than one that is given it", "gru", "mask_given"),
            ("The truth is smoother than either network", "truth", "gru", "mask_given"),
            ("IK and smoothing make the network's motion smoother", "gru_tracker", "gru"),
            ("Not in the paper: the shipped predictor is smoother than the paper's network", "tracker", "gru"),
        )
    ),
    of_groups=(0, "{}, %"),
    unit="%",
    digits=2,
)


@dataclass(frozen=True, eq=False)
class CompletedClip:
    """An estimator that is asked once, for the positions that a network has already given all frames of a clip."""

    skeleton: Skeleton
    position: np.ndarray  # (T, P, 3) m

    def start(self) -> None:
        """Return no state."""

    def step(self, observation: Observation, state: None) -> tuple[PointEstimate, None]:
        """Return all positions."""
        shape = self.position.shape[:-1]
        return PointEstimate(self.skeleton, self.position, np.zeros(shape), np.full(shape, _GUESS)), None


def after_tracker(
    position: np.ndarray, observation: Observation, skeleton: Skeleton, settings: IkTrackerSettings
) -> np.ndarray:
    """Positions (T, P, 3) m of a network after inverse kinematics and smoothing."""
    tracker = IkTracker(CompletedClip(skeleton, position), settings)
    pose, _, _ = tracker.step(observation, tracker.start())
    return np.asarray(forward_kinematics(pose)[0])


def smoothness_of_clip(
    clip: Clip, networks: Mapping[str, Path], model: Path | None, settings: IkTrackerSettings
) -> Tallies:
    """All methods of `METHODS` on one clip, every frame."""
    from bodysense_lab.papers.unoc.score.variant_scores import positions_of

    tracked = track_clip(clip, model, settings)
    skeleton, observation = tracked.clip.pose.skeleton, tracked.observation
    truth = np.asarray(forward_kinematics(tracked.clip.pose)[0])
    position = {"truth": truth, "best": tracked.position["network"], "tracker": tracked.position["bodysense"]}
    for name, values in positions_of(networks, observation, skeleton, np.arange(len(truth))).items():
        position[name] = values
        position[f"{name}_tracker"] = after_tracker(values, observation, skeleton, settings)
    return smoothness_of(position, truth, ~observation.has_position, tracked.clip)


def smoothness_of(position: Mapping[str, np.ndarray], truth: np.ndarray, hidden: np.ndarray, clip: Clip) -> Tallies:
    """Return percentages and errors (cm) of methods with positions (T, P, 3) m at 30 Hz; hidden (T, P)."""
    skeleton, group = clip.pose.skeleton, group_of(clip)
    points = {"body": scored_points(skeleton)}
    if clip.has_fingers:
        points["body_and_finger"] = points["body"] + np.flatnonzero(skeleton.wrist_of >= 0).tolist()
    true = acceleration(truth, RATE) > LIMIT
    sums = Tallies()  # by group of categories, part of the body, method and measure
    for method, values in position.items():
        strong = acceleration(values, RATE) > LIMIT
        errors = part_errors(values, truth, skeleton, clip.has_fingers)
        for part, chosen in points.items():
            error, places = errors[part]
            for measure, counted in (
                ("strong", 100.0 * strong[:, chosen]),
                ("added", 100.0 * (strong & ~true)[:, chosen]),
                ("occluded", error[hidden[:, places]]),
                ("all", error),
            ):
                sums.add((group, part, method, measure), counted)
    return sums


def smoothness_report(sums: Mapping[tuple, Tally], census: Census, data: DataSet) -> Report:
    """Return the table of the methods, of the body and, if there are fingers, of both."""
    errors = {
        (method, share): sums.get(("main", "body", method, share), Tally()).rmsjpe
        for method in ("gru", "gru_tracker")
        for share in ("occluded", "all")
    }
    changes = [errors["gru_tracker", share] - errors["gru", share] for share in ("occluded", "all")]
    remarks = []
    if all(map(math.isfinite, changes)):
        remarks.append(
            f"IK and smoothing change the paper's network's RMSJPE by {changes[0]:+.2f} cm at hidden joints of the "
            f"body and {changes[1]:+.2f} cm over all of them; the paper's by -0.04 and +1.5 cm (section 5.1)."
        )
    return score_report(
        TABLE, sums, census, (describe_data(data, census), *missing_data_remarks(("UNOC",), [data])), remarks
    )
