"""`bodysense evaluate completion`: sensor sets by bodies, each cell a run of the tracker over the clips of a split."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from bodysense.data.clip import Clip
from bodysense.data.splits import Split
from bodysense.lab.bootstrap import Interval, interval
from bodysense.lab.completion.baselines import MeanBody
from bodysense.lab.completion.calibration import REGIONS, Calibration
from bodysense.lab.completion.lattice import EdgeScore, choose_scenes, score_lattice
from bodysense.lab.completion.measures import (
    Averages,
    measure,
    measure_confidence,
    measure_hidden,
    motion_measures,
)
from bodysense.lab.completion.scenes import BODIES, TRUTH_OF, Body, Scene, Truth, batches, person_of, scene_of, stacked
from bodysense.lab.completion.tracking import StepTimes, TrackBatch, step_times, track_batch
from bodysense.lab.unoc.headset import GROUPS, KNOWN, last_known
from bodysense.observation import Observation
from bodysense.occlusion.sensors import SENSOR_SETS, TABLE_SETS, random_edges

TIMED_FRAMES = 330  # of one wearer, to tell how long a step takes
BASELINES = (*KNOWN, "mean_body")  # what hidden joints are compared with: last known, in three ways, and a mean body


@dataclass(frozen=True)
class CompletionSettings:
    """What is scored."""

    split: Split | Literal["all"] = "test"
    sets: tuple[str, ...] = TABLE_SETS
    bodies: tuple[Body, ...] = BODIES
    edges: int = 200  # of the lattice; 0 leaves it out


@dataclass(frozen=True)
class CompletionTable:
    """Averages of every cell by category group, calibrations of the main group, and what stands beside them."""

    settings: CompletionSettings
    cells: dict[tuple[str, Body, str], Averages] = field(default_factory=dict, repr=False)
    calibrations: dict[tuple[str, Body, str], Calibration] = field(default_factory=dict, repr=False)  # by region
    truths: dict[tuple[Truth, str], Averages] = field(default_factory=dict, repr=False)
    baselines: dict[tuple[str, Truth, str], Averages] = field(default_factory=dict, repr=False)
    people: dict[tuple[str, Body], dict[str, Averages]] = field(default_factory=dict, repr=False)  # of the main group
    times: dict[tuple[str, Body], np.ndarray] = field(default_factory=dict, repr=False)  # (N,) s a step
    lattice: list[EdgeScore] = field(default_factory=list, repr=False)

    def get(self, sensors: str, body: Body, name: str, group: str = "main") -> float:
        """One figure of one cell; NaN where nothing was counted."""
        return self.cells.get((sensors, body, group), Averages()).get(name)

    def calibration(self, sensors: str, body: Body | None = None, region: str | None = None) -> Calibration:
        """The calibration of a set, over all bodies and regions that are not named."""
        whole = Calibration()
        for (of_sensors, of_body, of_region), one in self.calibrations.items():
            if of_sensors == sensors and body in (None, of_body) and region in (None, of_region):
                whole.merge(one)
        return whole

    def interval(self, sensors: str, body: Body, minus: Body | None = None) -> Interval:
        """The headline of a cell, or what it has more than another body's, and between what it lies: main group."""
        of, other = (self._by_person(sensors, one) for one in (body, minus))
        return interval(of, None if minus is None else other)

    def _by_person(self, sensors: str, body: Body | None) -> dict[str, tuple[float, float]]:
        name = headline(sensors)
        people = {} if body is None else self.people.get((sensors, body), {})
        return {person: (one.get(name), one.weight[name]) for person, one in people.items() if name in one.weight}

    def last_known(self, truth: Truth, group: str = "main") -> Averages:
        """The best of the last-known baselines, by the root of its mean square."""
        known = [self.baselines.get((frame, truth, group), Averages()) for frame in KNOWN]
        return min(known, key=lambda one: one.get("occluded_square"))

    def ratio(self, body: Body, group: str = "main") -> float:
        """RMSJPE of hidden joints by that of the best last-known baseline."""
        cell = self.cells.get(("headset_camera", body, group), Averages())
        return cell.root("occluded_square") / self.last_known(TRUTH_OF[body], group).root("occluded_square")

    def numbers(self) -> dict[str, float]:
        """One flat object; keys without a group at their end are over the main categories."""
        result: dict[str, float] = {}
        for (sensors, body, group), cell in self.cells.items():
            suffix = "" if group == "main" else f"_{group}"
            key = f"{sensors}_{body}"
            result |= {f"{key}_{name}{suffix}": cell.get(name) for name in cell.weight if name != "occluded_square"}
            if sensors == "headset_camera":
                result[f"{key}_occluded_rmsjpe_cm{suffix}"] = cell.root("occluded_square")
                result[f"{key}_ratio{suffix}"] = self.ratio(body, group)
        for (truth, group), averages in self.truths.items():
            suffix = "" if group == "main" else f"_{group}"
            result |= {f"truth_{truth}_{name}{suffix}": averages.get(name) for name in averages.weight}
        for (method, truth, group), averages in self.baselines.items():
            key = f"{'last_known_' if method in KNOWN else ''}{method}_{truth}"
            suffix = "" if group == "main" else f"_{group}"
            result[f"{key}_occluded_mpjpe_cm{suffix}"] = averages.get("occluded_mpjpe_cm")
            result[f"{key}_occluded_rmsjpe_cm{suffix}"] = averages.root("occluded_square")
        for sensors, body in self.people:
            one = self.interval(sensors, body)
            result |= {f"{sensors}_{body}_low_cm": one.low, f"{sensors}_{body}_high_cm": one.high}
            if body != "own" and (sensors, "own") in self.people:
                beside = self.interval(sensors, body, "own")
                parts = zip(("", "_low", "_high"), (beside.value, beside.low, beside.high), strict=True)
                result |= {f"{sensors}_{body}_minus_own{part}_cm": value for part, value in parts}
        for (sensors, body), times in self.times.items():
            for percent in (50, 99):
                result[f"{sensors}_{body}_p{percent}_ms"] = 1000 * float(np.percentile(times, percent))
        result |= self._confidence_numbers()
        if self.lattice:
            result |= {
                "lattice_violations": sum(score.violates for score in self.lattice),
                "lattice_edges": len(self.lattice),
            }
        return result

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


def evaluate_completion(
    clips: Iterable[Clip],
    settings: CompletionSettings = CompletionSettings(),
    *,
    mean_body: MeanBody | None = None,
    track: TrackBatch = track_batch,
    times: StepTimes | None = step_times,
    advance: Callable[[int, str], None] = lambda count, what: None,
) -> CompletionTable:
    """Score the tracker on clips.

    Args:
        clips: the motion, canonical.
        settings: what is scored.
        mean_body: a baseline of hidden joints; None leaves it out.
        track: tracks a batch of people.
        times: times the steps of one wearer; None leaves this out.
        advance: is told how many clips of a cell, or edges of the lattice, are done, and what they were.
    """
    table, judged = CompletionTable(settings), []
    truths: tuple[Truth, ...] = tuple(dict.fromkeys(TRUTH_OF[body] for body in settings.bodies))
    for batch in batches(clips):
        for truth in truths:
            scenes = [scene_of(clip, truth, settings.split) for clip in batch]
            _score_truth(table, scenes, truth)
            for sensors in settings.sets:
                _score_set(table, scenes, truth, sensors, mean_body, track, advance)
        if settings.edges:
            judged += [scene_of(clip, "stranger", settings.split) for clip in batch]
        if times is not None and not table.times:  # the longest clips come first
            _time_steps(table, batch[0], times)
    if settings.edges:
        table.lattice.extend(
            score_lattice(choose_scenes(judged), random_edges(settings.edges), track, lambda: advance(1, "edges"))
        )
    return table


def work_of(count: int, settings: CompletionSettings) -> int:
    """How much `advance` is told in all of `count` clips."""
    return count * len(settings.sets) * len(settings.bodies) + settings.edges


def _score_truth(table: CompletionTable, scenes: Sequence[Scene], truth: Truth) -> None:
    for scene in scenes:
        position = scene.placed[0]
        averages = table.truths.setdefault((truth, scene.group), Averages())
        averages.merge(motion_measures(position, position, scene.skeleton))


def _score_set(
    table: CompletionTable,
    scenes: Sequence[Scene],
    truth: Truth,
    sensors: str,
    mean_body: MeanBody | None,
    track: TrackBatch,
    advance: Callable[[int, str], None],
) -> None:
    """Score one set of sensors on scenes of one truth, for all that the tracker may be told."""
    observations = [scene.observe(SENSOR_SETS[sensors]) for scene in scenes]
    if sensors == "headset_camera":
        for scene, seen in zip(scenes, observations, strict=True):
            _score_baselines(table, scene, seen, truth, mean_body)
    observation = stacked(observations)
    for body in table.settings.bodies:
        if TRUTH_OF[body] != truth:
            continue
        batch = track([person_of(body, scene.skeleton) for scene in scenes], observation)
        for index, (scene, seen) in enumerate(zip(scenes, observations, strict=True)):
            tracked = batch.of_person(index, len(scene))
            cell = table.cells.setdefault((sensors, body, scene.group), Averages())
            scores = measure(scene, tracked)
            if sensors == "headset_camera":
                scores.merge(measure_hidden(tracked.position, scene))
            cell.merge(scores)
            if scene.group == "main":
                table.people.setdefault((sensors, body), {}).setdefault(scene.person, Averages()).merge(scores)
                for region, one in measure_confidence(scene, seen, tracked).items():
                    table.calibrations.setdefault((sensors, body, region), Calibration()).merge(one)
        advance(len(scenes), f"{sensors}, {body}")


def _score_baselines(
    table: CompletionTable, scene: Scene, seen: Observation, truth: Truth, mean_body: MeanBody | None
) -> None:
    """Errors of hidden joints of what knows nothing of this wearer's motion."""
    methods = last_known(seen, scene.skeleton)
    if mean_body is not None:
        head = scene.skeleton.index("head")
        position, rotation = scene.placed
        methods["mean_body"] = mean_body.positions(position[:, head], rotation[:, head], scene.skeleton)
    for method, position in methods.items():
        averages = table.baselines.setdefault((method, truth, scene.group), Averages())
        averages.merge(measure_hidden(position, scene))


def _time_steps(table: CompletionTable, clip: Clip, times: StepTimes) -> None:
    """Time the steps of one wearer in every cell."""
    for body in table.settings.bodies:
        scene = scene_of(clip, TRUTH_OF[body], table.settings.split).beginning(TIMED_FRAMES)
        for sensors in table.settings.sets:
            seen = scene.observe(SENSOR_SETS[sensors])
            table.times[sensors, body] = times(person_of(body, scene.skeleton), seen)


def headline(sensors: str) -> str:
    """The measure by which a set is told first."""
    return "occluded_mpjpe_cm" if sensors == "headset_camera" else "mpjpe_cm"


def groups_of(table: CompletionTable) -> tuple[str, ...]:
    """The category groups of which there was motion."""
    return tuple(group for group in GROUPS if any(key[-1] == group for key in table.cells))
