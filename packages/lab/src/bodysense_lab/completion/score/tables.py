"""Tables of `bodysense evaluate completion`: sensor sets × bodies, all measures, confidence, visible faults."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from bodysense.io.datasets.splits import Split
from bodysense.takes.last_known import KNOWN
from bodysense_lab.completion.score.measures import REGIONS
from bodysense_lab.completion.score.scenes import TRUTH_OF, Truth
from bodysense_lab.completion.score.scores import Calibration, RunningScores
from bodysense_lab.completion.score.sight.sight_scores import CellScores
from bodysense_lab.completion.training.options import BODIES, BODY_TITLES, TABLE_SETS, Body, Fault
from bodysense_lab.core.intervals import Interval, interval
from bodysense_lab.core.scoring import GROUPS, suffix_of
from bodysense_lab.core.table import Cell, Report, cell, finite
from bodysense_lab.data.datasets import Census, DataSet, describe_data


@dataclass(frozen=True)
class CompletionSettings:
    """Settings of the tables."""

    split: Split | Literal["all"] = "test"
    sets: tuple[str, ...] = TABLE_SETS
    bodies: tuple[Body, ...] = BODIES
    takes: bool = False  # also score takes, completed with past and future


@dataclass(frozen=True)
class WorstFrame:
    """The frame of a clip with the largest fault of a kind."""

    sensors: str
    body: Body
    clip: str  # the scene's name
    frame: int
    fault: Fault
    size: float  # cm: mean error of 22 joints from the head, or the farthest leap of one beyond the truth


@dataclass(frozen=True)
class CompletionTable:
    """Scores of all cells (sensor set, body) by category group, and baselines, calibrations and times."""

    settings: CompletionSettings
    cells: dict[tuple[str, Body, str], CellScores] = field(default_factory=dict, repr=False)
    calibrations: dict[tuple[str, Body, str], Calibration] = field(default_factory=dict, repr=False)  # by region
    worst: list[WorstFrame] = field(default_factory=list, repr=False)  # of each fault, clip and cell, main group
    truths: dict[tuple[Truth, str], RunningScores] = field(default_factory=dict, repr=False)
    baselines: dict[tuple[str, Truth, str], RunningScores] = field(default_factory=dict, repr=False)
    people: dict[tuple[str, Body, str], RunningScores] = field(default_factory=dict, repr=False)  # headline, main group
    times: dict[tuple[str, Body], np.ndarray] = field(default_factory=dict, repr=False)  # (N,) s a step

    def merge(self, other: CompletionTable) -> None:
        """Add the scores of another table with the same settings."""
        for name in ("cells", "calibrations", "truths", "baselines", "people"):
            ours = getattr(self, name)
            for key, scores in getattr(other, name).items():
                ours.setdefault(key, type(scores)()).merge(scores)
        self.worst.extend(other.worst)

    def calibration(self, sensors: str, body: Body | None = None, region: str | None = None) -> Calibration:
        """Return the calibration of a sensor set, over all bodies and regions if these are omitted."""
        whole = Calibration()
        for (of_sensors, of_body, of_region), one in self.calibrations.items():
            if of_sensors == sensors and body in (None, of_body) and region in (None, of_region):
                whole.merge(one)
        return whole

    def interval(self, sensors: str, body: Body, minus: Body | None = None) -> Interval:
        """Return the main measure of a cell, or its difference to another body's, with its 95 % interval."""
        scores, other = (self._by_person(sensors, one) for one in (body, minus))
        return interval(scores, None if minus is None else other)

    def _by_person(self, sensors: str, body: Body | None) -> dict[str, tuple[float, float]]:
        name = headline(sensors)
        found = {key[2]: one for key, one in self.people.items() if key[:2] == (sensors, body)}
        return {person: (one.get(name), one.weight[name]) for person, one in found.items() if name in one.weight}

    def last_known(self, truth: Truth, group: str = "main") -> RunningScores:
        """Return the best of the last-known baselines, by mean square error."""
        known = [self.baselines.get((frame, truth, group), RunningScores()) for frame in KNOWN]
        return min(known, key=lambda one: one.get("occluded_square"))

    def ratio(self, body: Body, group: str = "main") -> float:
        """Return the RMSJPE of hidden joints divided by that of the best last-known baseline."""
        cell = self.cells.get(("headset_camera", body, group), RunningScores())
        return cell.root("occluded_square") / self.last_known(TRUTH_OF[body], group).root("occluded_square")

    def numbers(self) -> dict[str, float]:
        """Return all figures by flat keys; keys without a group at their end are of the main categories."""
        result = {
            f"{cell}_{name}{suffix_of(group)}": value
            for cell, group, one in self._by_cell()
            for name, value in one.numbers().items()
        }
        for sensors, body, group in self.cells:
            if sensors == "headset_camera":
                result[f"{sensors}_{body}_ratio{suffix_of(group)}"] = self.ratio(body, group)
        for sensors, body in self.scored_cells():
            one = self.interval(sensors, body)
            result |= {f"{sensors}_{body}_low_cm": one.low, f"{sensors}_{body}_high_cm": one.high}
            if body != "own" and (sensors, "own") in self.scored_cells():
                difference = self.interval(sensors, body, "own")
                parts = zip(("", "_low", "_high"), (difference.value, difference.low, difference.high), strict=True)
                result |= {f"{sensors}_{body}_minus_own{part}_cm": value for part, value in parts}
        for (sensors, body), times in self.times.items():
            for percent in (50, 99):
                result[f"{sensors}_{body}_p{percent}_ms"] = 1000 * float(np.percentile(times, percent))
        result |= self._confidence_numbers()
        return result

    def _by_cell(self) -> Iterator[tuple[str, str, RunningScores]]:
        """Yield the beginning of the keys of scores, their group, and the scores."""
        for (sensors, body, group), one in self.cells.items():
            yield f"{sensors}_{body}", group, one
        for (truth, group), one in self.truths.items():
            yield f"truth_{truth}", group, one
        for (method, truth, group), one in self.baselines.items():
            yield f"{'last_known_' if method in KNOWN else ''}{method}_{truth}", group, one

    def scored_cells(self) -> list[tuple[str, Body]]:
        """Return sensor sets and bodies with people of the main group."""
        return list(dict.fromkeys((sensors, body) for sensors, body, _ in self.people))

    def _confidence_numbers(self) -> dict[str, float]:
        result: dict[str, float] = {}
        for sensors in self.settings.sets:
            parts = {"": self.calibration(sensors)}
            parts |= {f"_{region}": self.calibration(sensors, region=region) for region in REGIONS}
            parts |= {f"_{body}": self.calibration(sensors, body) for body in self.settings.bodies}
            for part, one in parts.items():
                result[f"{sensors}{part}_ece"] = one.ece
                result[f"{sensors}{part}_cover90"] = one.coverage
                result[f"{sensors}{part}_spearman"] = one.rank_correlation
        return result


def headline(sensors: str) -> str:
    """Return the main measure of a sensor set."""
    return "occluded_mpjpe_cm" if sensors == "headset_camera" else "mpjpe_cm"


def groups_of(table: CompletionTable) -> tuple[str, ...]:
    """Return the category groups with motion."""
    return tuple(group for group in GROUPS if any(key[-1] == group for key in table.cells))


# Measures of takes, which are completed with past and future; their names in a cell begin with "take_".
TAKE_MEASURES = ("mpjpe_cm", "occluded_mpjpe_cm", "rotation_deg", "jumps_per_minute")
TAKE_SIGHTS = ("float_share", "false_steps_per_minute", "wrong_foot_share", "elbow_deg")
# Measures of a cell by title of their column, in the order of the columns.
MEASURES = {
    "MPJPE": "mpjpe_cm",
    "lower": "lower_mpjpe_cm",
    "upper": "upper_mpjpe_cm",
    "hidden": "occluded_mpjpe_cm",
    "rotation": "rotation_deg",
    "velocity": "velocity_cm_s",
    "jitter": "jitter",
    "skate": "skate_cm_s",
    "under floor": "depth_cm",
    "jumps/min": "jumps_per_minute",
    "breaks/min": "breaks_per_minute",
    "take": "take_mpjpe_cm",
    "take hidden": "take_occluded_mpjpe_cm",
    "take rotation": "take_rotation_deg",
    "take jumps/min": "take_jumps_per_minute",
}
SIGHT = {
    "frozen %": "frozen_share",
    "jumps at change": "jumps_at_change_per_minute",
    "other jumps": "jumps_elsewhere_per_minute",
    "by a blink": "extra_jumps_per_minute",
    "float %": "float_share",
    "low float %": "low_float_share",
    "knee °": "standing_knee_deg",
    "knee over °": "knee_excess_deg",
    "knee back %": "backward_knee_share",
    "false steps": "false_steps_per_minute",
    "missed %": "missed_steps_share",
    "wrong %": "wrong_foot_share",
    "walking %": "wrong_foot_walking_share",
    "astride %": "wrong_foot_astride_share",
    "re-entry": "reentry_speed_m_s",
    "PJ": "pj_ratio",
    "AUJ": "auj",
    "elbow °": "elbow_deg",
    "seen p95": "measured_p95_cm",
    "seen °": "measured_rotation_deg",
    "bound %": "measured_covered",
}
_SHARES = ("_share", "_covered")  # endings of keys of shares, whose columns are in percent


def completion_reports(table: CompletionTable, census: Census, data: DataSet, total: int) -> tuple[Report, ...]:
    """Return the short table, all measures, visible faults, intervals and confidence. The first has all numbers.

    `census` counts the scored clips, and `total` is the number of clips of the split.
    """
    bodies, numbers = table.settings.bodies, finite(table.numbers())
    data_lines = [describe_data(data, census)]
    if census.clips < total:
        sensors, body = table.settings.sets[0], bodies[0]
        cell = f"{sensors.replace('_', ' ')}, {BODY_TITLES[body]}"
        data_lines.append(sample_remark(census.clips, total, cell, table.interval(sensors, body)))
    short = Report(
        name="completion",
        title="Completion: sensor sets × bodies (main categories, MPJPE in cm)",
        columns=("sensors", *(BODY_TITLES[body] for body in bodies)),
        rows=tuple(
            (name.replace("_", " "), *(numbers.get(f"{name}_{body}_{headline(name)}") for body in bodies))
            for name in table.settings.sets
        ),
        numbers=numbers | census.numbers() | {"clips_in_split": total},
        data=tuple(data_lines),
        remarks=tuple(_remarks(table)),
        remarks_title="For comparison",
        caption="22 joints from the head; headset camera: hidden joints, in the world. Own body: the recording's, "
        "known; unseen body: known, not used in training; the other columns: unseen bodies.",
        digits=2,
    )
    whole = Report(
        name="completion-measures",
        title="Completion: all measures",
        columns=("motion", "sensors", "body", *MEASURES, "ratio", "p50", "p99"),
        rows=tuple(_rows(table, numbers)),
        numbers={},
        caption="cm; local rotations, °; cm/s; jitter 10² m/s³; skate of feet that truly stand; depth of foot points; "
        "jumps: frames a minute in which a joint goes 5 cm farther than the truth; breaks: 5 cm farther from where its "
        "velocity led; ratio: RMSJPE of hidden joints divided by that of the best last known; "
        "take: with past and future; ms of one wearer's step. Averages over "
        "frames at 30 Hz.",
        digits=2,
    )
    return short, whole, _sight_report(table, numbers), _interval_report(table), _confidence_report(table)


def sample_remark(clips: int, total: int, figure: str, one: Interval) -> str:
    """Return how many of all clips are in a sample, and the interval of a figure, cm, if it is known."""
    text = f"A sample: {clips} of {total} clips."
    if math.isfinite(one.low):
        text += f" {figure}: between {one.low:.2f} and {one.high:.2f} cm (95 %)."
    return text


def _rows(table: CompletionTable, numbers: dict[str, float]) -> Iterator[tuple[Cell, ...]]:
    every = (*MEASURES.values(), "ratio", "p50_ms", "p99_ms")
    for group in groups_of(table):
        for name in table.settings.sets:
            for body in table.settings.bodies:
                yield (group, name, BODY_TITLES[body], *_found(numbers, f"{name}_{body}", every, group))
        for truth, of_group in table.truths:
            if of_group == group:
                yield (group, "the motion itself", BODY_TITLES[truth], *_found(numbers, f"truth_{truth}", every, group))
        for method, truth, of_group in table.baselines:
            if of_group == group:
                known = method in KNOWN
                key, name = (f"last_known_{method}", f"last known ({method})") if known else (method, "mean body")
                yield (group, name, BODY_TITLES[truth], *_found(numbers, f"{key}_{truth}", every, group))


def _found(numbers: dict[str, float], cell: str, names: Iterable[str], group: str) -> list[Cell]:
    """Return figures of a cell, such as 'head_own', from flat keys; None for those that are missing."""
    return [numbers.get(f"{cell}_{name}{suffix_of(group)}") for name in names]


def _sight_report(table: CompletionTable, numbers: dict[str, float]) -> Report:
    """Return the table of faults that a wearer sees, by group, sensor set and body."""
    rows: list[tuple[Cell, ...]] = []
    for group in groups_of(table):
        for name in table.settings.sets:
            for body in table.settings.bodies:
                found = _found(numbers, f"{name}_{body}", SIGHT.values(), group)
                if any(one is not None for one in found):
                    factors = [100 if key.endswith(_SHARES) else 1 for key in SIGHT.values()]
                    scaled = (one and factor * one for one, factor in zip(found, factors, strict=True))
                    rows.append((group, name.replace("_", " "), BODY_TITLES[body], *scaled))
    return Report(
        name="completion-sight",
        title="Completion: faults that the wearer sees",
        columns=("motion", "sensors", "body", *SIGHT),
        rows=tuple(rows),
        numbers={},
        caption="docs/evaluation.md defines the columns. Frozen: hidden points that truly move; jumps and steps a "
        "minute; float: the lower foot too high while the truth stands; knee: median where the true knees are under "
        "10°; re-entry: m/s, 99th percentile; PJ (ratio), AUJ (m/s³): hands lost for measured durations; seen: p95.",
        digits=2,
    )


def _interval_report(table: CompletionTable) -> Report:
    """Return the table of intervals of the short table's figures, and of differences between bodies."""
    rows: list[tuple[Cell, ...]] = []
    for name in table.settings.sets:
        for body in table.settings.bodies:
            one = table.interval(name, body)
            difference: tuple[Cell, ...] = (None,) * 4
            if body != "own" and (name, "own") in table.scored_cells():
                more = table.interval(name, body, "own")
                difference = (cell(more.value), cell(more.low), cell(more.high), more.verdict)
            rows.append(
                (name.replace("_", " "), BODY_TITLES[body], cell(one.value), cell(one.low), cell(one.high), *difference)
            )
    people = max(Counter(key[:2] for key in table.people).values(), default=0)
    return Report(
        name="completion-intervals",
        title="Completion: 95 % intervals (main categories, cm)",
        columns=("sensors", "body", "error", "low", "high", "more than own", "low", "high", "difference"),
        rows=tuple(rows),
        numbers={},
        caption=f"95 % intervals by bootstrap over {people} people; a difference is none if its interval contains 0.",
        digits=2,
    )


def _confidence_report(table: CompletionTable) -> Report:
    """Return the table of calibrations by sensor set and region, over all bodies."""
    rows: list[tuple[Cell, ...]] = []
    for name in table.settings.sets:
        for region in (None, *REGIONS):
            one = table.calibration(name, region=region)
            figures = (one.ece, 100 * one.coverage, one.rank_correlation)
            if one.count:
                rows.append((name.replace("_", " "), region or "all", int(one.count), *map(cell, figures)))
    return Report(
        name="completion-confidence",
        title="Completion: expected and true errors of joints that are not tracked (main categories, all bodies)",
        columns=("sensors", "region", "joints × frames", "ECE", "within 90 %, %", "Spearman"),
        rows=tuple(rows),
        numbers={},
        caption="ECE: mean difference of expected and true error in bins of expected error, divided by the mean error.",
        digits=3,
    )


def _remarks(table: CompletionTable) -> Iterator[str]:
    truths: tuple[Truth, ...] = ("own", "stranger")
    for truth in truths:
        averages = table.truths.get((truth, "main"))
        if averages is not None:
            yield (
                f"The motion itself ({BODY_TITLES[truth]}): jitter {averages.get('jitter'):.2f}, "
                f"skate {averages.get('skate_cm_s'):.2f} cm/s, {averages.get('depth_cm'):.2f} cm under the floor."
            )
        mean_body = table.baselines.get(("mean_body", truth, "main"), RunningScores())
        known = [
            f"{name} {one.get('occluded_mpjpe_cm'):.1f} cm ({one.root('occluded_square'):.1f} RMSJPE)"
            for name, one in (("last known", table.last_known(truth)), ("mean body", mean_body))
            if one.weight
        ]
        if known:
            yield f"Hidden joints ({BODY_TITLES[truth]}): {', '.join(known)}."
