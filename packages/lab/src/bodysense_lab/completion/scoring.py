"""How `bodysense evaluate completion` scores: the tracker runs over the clips of a split, set of sensors by set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import TypeVar

from bodysense.devices.simulated.sensors import SENSOR_SETS, Edge, random_edges
from bodysense.io.clip import Clip
from bodysense.observation import Observation
from bodysense.scoring import last_known
from bodysense_lab.completion.baselines import MeanBody
from bodysense_lab.completion.measures import (
    Averages,
    Calibration,
    measure,
    measure_confidence,
    measure_hidden,
    motion_measures,
)
from bodysense_lab.completion.scenes import TRUTH_OF, TrackedScene, Truth, batches, person_of, scene_of, stacked
from bodysense_lab.completion.tables import CompletionSettings, CompletionTable
from bodysense_lab.completion.tracking import (
    EdgeScore,
    StepTimes,
    TrackBatch,
    choose_scenes,
    score_lattice,
    step_times,
    track_batch,
)

TIMED_FRAMES = 330  # of one wearer, to tell how long a step takes
_EDGES = 10  # of the lattice that one process scores at a time
Item = TypeVar("Item")
Result = TypeVar("Result")
# Runs work on items, results in order: here, or in other processes, to which the work must pickle.
Spread = Callable[[Callable[[Item], Result], Iterable[Item]], Iterator[tuple[Item, Result]]]


def one_by_one(work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[tuple[Item, Result]]:
    """Every item with what `work` makes of it, in this process."""
    for item in items:
        yield item, work(item)


def evaluate_completion(
    clips: Iterable[Clip],
    settings: CompletionSettings = CompletionSettings(),
    *,
    mean_body: MeanBody | None = None,
    track: TrackBatch = track_batch,
    times: StepTimes | None = step_times,
    spread: Spread = one_by_one,
    advance: Callable[[int, str], None] = lambda count, what: None,
) -> CompletionTable:
    """Score the tracker on clips.

    Args:
        clips: the motion, canonical.
        settings: what is scored.
        mean_body: a baseline of hidden joints; None leaves it out.
        track: tracks a batch of people.
        times: times the steps of one wearer; None leaves this out.
        spread: where the work is done.
        advance: is told how many clips of a cell, or edges of the lattice, are done, and what they were.
    """
    table = CompletionTable(settings)
    groups = list(batches(clips))
    truths: tuple[Truth, ...] = tuple(dict.fromkeys(TRUTH_OF[body] for body in settings.bodies))
    work = partial(_score_batch, settings=settings, mean_body=mean_body, track=track)
    for (batch, truth), part in spread(work, [(batch, truth) for batch in groups for truth in truths]):
        table.merge(part)
        told = sum(TRUTH_OF[body] == truth for body in settings.bodies)
        advance(len(batch) * len(settings.sets) * told, f"{len(batch)} clips, {truth} bodies")
    if times is not None and groups:
        _time_steps(table, groups[0][0], times)  # the longest clip
    if settings.edges:
        judged = [scene_of(clip, "stranger", settings.split) for batch in groups for clip in batch]
        edges = random_edges(settings.edges)
        some = [edges[first : first + _EDGES] for first in range(0, len(edges), _EDGES)]
        for of, scores in spread(partial(_score_edges, scenes=choose_scenes(judged), track=track), some):
            table.lattice.extend(scores)
            advance(len(of), "edges")
    return table


def _score_batch(
    batch: tuple[Sequence[Clip], Truth],
    settings: CompletionSettings,
    mean_body: MeanBody | None,
    track: TrackBatch,
) -> CompletionTable:
    """The table of some clips of one truth."""
    clips, truth = batch
    table = CompletionTable(settings)
    scenes = [scene_of(clip, truth, settings.split) for clip in clips]
    _score_truth(table, scenes, truth)
    for sensors in settings.sets:
        _score_set(table, scenes, truth, sensors, mean_body, track)
    return table


def _score_edges(edges: Sequence[Edge], scenes: Sequence[TrackedScene], track: TrackBatch) -> list[EdgeScore]:
    return score_lattice(scenes, edges, track)


def work_of(count: int, settings: CompletionSettings) -> int:
    """How much `advance` is told in all of `count` clips."""
    return count * len(settings.sets) * len(settings.bodies) + settings.edges


def _score_truth(table: CompletionTable, scenes: Sequence[TrackedScene], truth: Truth) -> None:
    for scene in scenes:
        position = scene.placed[0]
        averages = table.truths.setdefault((truth, scene.group), Averages())
        averages.merge(motion_measures(position, position, scene.skeleton))


def _score_set(
    table: CompletionTable,
    scenes: Sequence[TrackedScene],
    truth: Truth,
    sensors: str,
    mean_body: MeanBody | None,
    track: TrackBatch,
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


def _score_baselines(
    table: CompletionTable, scene: TrackedScene, seen: Observation, truth: Truth, mean_body: MeanBody | None
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
