"""PAHMT, Table 1: the errors of networks of arms and hands on filmed windows of a data set. Needs PyTorch.

All networks are scored on equal windows, cameras and errors of the detector.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch

from bodysense.body.keypoints import arms_from_torso
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.core.scoring import GROUPS, group_named, suffix_of
from bodysense_lab.core.table import Cell, Report, bound_cells, cell, finite, ordering
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet, census_of, describe_data
from bodysense_lab.papers.ik.ik import IkSettings, InverseKinematics, solve_sequence
from bodysense_lab.papers.pahmt.errors import EVERY, table_errors
from bodysense_lab.papers.pahmt.features import window_of
from bodysense_lab.papers.pahmt.network import ArmNetwork, read_arms
from bodysense_lab.papers.pahmt.options import TABLE_1, TableRow, VideoSimulation
from bodysense_lab.papers.pahmt.recordings import FRAMES, RATE, film, read_arm_recordings

MEASURES = {
    "hands_m": "hands, m",
    "overall_m": "overall, m",
    "arms": "arms, rad",
    "arms_deg": "arms, °",
    "fingers_deg": "fingers, °",
    "upper_arm_twist_deg": "twist of upper arm, °",
    "forearm_twist_deg": "of forearm, °",
}
_BATCH = 128  # windows that are computed together


@dataclass(frozen=True, eq=False)
class ScoredRow:
    """One row and its figures."""

    name: str
    row: TableRow
    network: ArmNetwork | None = field(repr=False)  # None: inverse kinematics on the true positions of all joints
    tallies: Tallies = field(default_factory=Tallies, repr=False)  # by category group and measure

    def get(self, measure: str, group: str = "main") -> float:
        """A mean over frames and joints; NaN where nothing was counted."""
        return self.tallies.mean(group, measure)


def rows_in(folder: Path, model: Path | None = None) -> list[ScoredRow]:
    """Return the table's networks in a folder, and one more. Raises BodysenseError if there are no networks."""
    shipped = None if model is None else read_arms(model)[0]
    found = []
    for name, row in TABLE_1.items():
        if (folder / f"{name}.pt").is_file():
            found.append(ScoredRow(name, row, read_arms(folder / f"{name}.pt")[0]))
    if not found:
        raise BodysenseError(
            f"{folder}: none of the table's networks in it; train them with `bodysense train arms-table` into it"
        )
    found.append(ScoredRow("ik", TableRow("inverse kinematics, true positions", losses=()), None))
    if model is not None and shipped is not None:
        row = TableRow(f"{shipped.config.kind.upper()}, {model.stem}", shipped.config.kind, shipped.config.input)
        found.append(ScoredRow("shipped", row, shipped))
    return found


def score_arms(
    rows: list[ScoredRow],
    data: DataSet,
    stride: int,
    seed: int,
    advance: Callable[[Clip], None],
    studio: VideoSimulation = VideoSimulation(),
) -> tuple[list[ScoredRow], Census]:
    """Add the figures of clips with fingers to the rows; return these, and how much motion that was.

    `studio` sets cameras and errors. No window is mirrored or at the beginning of a video.
    """
    studio = replace(studio, mirrored=False, begun=0.0)
    census = Census()

    def count(row: ScoredRow, clip: Clip, errors: dict[str, np.ndarray]) -> None:
        for measure, values in errors.items():
            row.tallies.add((group_named(clip.category), measure), values, clip.person)

    for number, clip in enumerate(data.clips()):
        advance(clip)
        if not clip.has_fingers or clip.seconds * RATE < FRAMES:
            continue
        census += census_of(clip)
        recordings, pose = read_arm_recordings([clip]), resample(clip, RATE).pose
        for row in rows:
            if row.network is None:
                count(row, clip, table_errors(solved_from_positions(pose), arms_from_torso(pose), EVERY))
        windows, rng = recordings.windows(stride), np.random.default_rng([seed, number])
        for first in range(0, len(windows), _BATCH):
            which = np.arange(first, min(first + _BATCH, len(windows)))
            keypoints, truth = film(recordings, windows, which, studio, rng)
            window = window_of(keypoints)
            for row in rows:
                if row.network is None:
                    continue
                with torch.no_grad():
                    predicted = row.network.quaternions(row.network(window)).numpy()
                count(row, clip, table_errors(predicted, truth, row.network.config.joints))
    if not census.clips:
        raise BodysenseError(f"{data.path}: no clip with fingers of {FRAMES} frames; give motion with fingers")
    return rows, census


def solved_from_positions(truth: Pose) -> np.ndarray:
    """Return rotations (T, 38, 4), in the form of `arms_from_torso`, by inverse kinematics on the true positions.

    No video gives as much. Twists that positions leave open are those of the relaxed posture (`papers/ik/ik.py`).
    """
    position = np.asarray(forward_kinematics(truth)[0])
    ik = InverseKinematics(truth.skeleton, IkSettings(max_iterations=50))
    return arms_from_torso(solve_sequence(ik, position))


def arm_report(scored: tuple[list[ScoredRow], Census], data: DataSet, perfect: bool = False) -> Report:
    """Return the table; `perfect`: key-points have no errors of a detector."""
    rows, census = scored
    seen = "simulated cameras give them, without a detector's errors" if perfect else "simulated detectors give them"
    return Report(
        name="pahmt-table1",
        title="PAHMT, Table 1: arms and hands from key-points",
        columns=(
            *("motion", "network", "smooth", "fk", *MEASURES.values(), "arms, ° low", "high"),
            *("paper: hands, m", "paper: overall, m", "paper: arms, rad"),
        ),
        rows=tuple(_rows(rows)),
        numbers=finite(_numbers(rows)) | census.numbers(),
        data=(describe_data(data, census),),
        remarks=tuple(_remarks({row.name: row for row in rows})),
        caption=f"Windows of 32 frames as {seen}, averages over all frames. Hands: "
        "finger joints and tips from their wrist, in its axes. Overall: all joints from the chest, on one character. "
        "Arms: mean difference of axis-angle components (the paper's) and geodesic angle of collars, upper arms, "
        "forearms and hands. Low and high: 95 % by bootstrap over people. "
        "The paper's figures are of its own motion, whose sizes and cameras are not published.",
        digits=4,
    )


def _rows(rows: list[ScoredRow]) -> Iterator[tuple[Cell, ...]]:
    for group in GROUPS:
        for row in rows:
            figures = [cell(row.get(measure, group)) for measure in MEASURES]
            if any(value is not None for value in figures):
                marks = ("yes" if loss in row.row.losses else "" for loss in ("smooth", "fk"))
                published = [*row.row.published, None, None, None][:3] if group == "main" else [None] * 3
                sure = bound_cells(row.tallies[group, "arms_deg"].interval())
                yield (group, row.row.title, *marks, *figures, *sure, *published)


def _numbers(rows: list[ScoredRow]) -> dict[str, float]:
    """Keys without a group at their end are over the main categories."""
    numbers: dict[str, float] = {}
    for row in rows:
        for group in GROUPS:
            suffix = suffix_of(group)
            for measure in MEASURES:
                key = f"{row.name.replace('-', '_')}_{measure}{suffix}"
                numbers |= row.tallies.figures(key, group, measure)
                if measure.endswith("_m"):
                    numbers[f"{key[:-2] if not suffix else key[: -len(suffix) - 2]}_cm{suffix}"] = 100 * numbers[key]
    return numbers


def _remarks(rows: Mapping[str, ScoredRow]) -> Iterator[str]:
    claims = (
        ("AHMT is below the CNN overall", "ahmt", "cnn", "overall_m"),
        ("PAHMT is below AHMT overall", "pahmt", "ahmt", "overall_m"),
        ("With the arms, hands are better than alone", "cnn-plain", "cnn-hands", "hands_m"),
        ("The loss of positions helps", "cnn-fk", "cnn-plain", "overall_m"),
        ("With it the loss of smoothness helps", "cnn", "cnn-fk", "overall_m"),
        ("PAHMT has the best arms", "pahmt", "ahmt", "arms"),
    )
    for claim, better, worse, measure in claims:
        if better in rows and worse in rows:
            figures = [rows[name].tallies["main", measure].named(rows[name].row.title) for name in (better, worse)]
            remark = ordering(claim, figures[0], figures[1:], MEASURES[measure].rpartition(", ")[2], 4)
            share = 1 - figures[0].value / figures[1].value
            if remark is not None and math.isfinite(share):
                yield f"{remark} {abs(share):.0%} {'less' if share > 0 else 'more'}."
