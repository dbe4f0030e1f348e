"""How `bodysense evaluate completion` scores: the tracker runs over the clips of a split, set of sensors by set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.io.clip import Clip
from bodysense.last_known import last_known
from bodysense.observation import Observation
from bodysense_lab.completion import sight
from bodysense_lab.completion.baselines import MeanBody
from bodysense_lab.completion.blinks import BLINKING, FINGER, lose_hands, rng_of, with_finger
from bodysense_lab.completion.kept import KeptClips
from bodysense_lab.completion.lattice import random_edges
from bodysense_lab.completion.lattice_scores import choose_scenes, score_lattice
from bodysense_lab.completion.measures import (
    count_jumps,
    measure,
    measure_confidence,
    measure_hidden,
    motion_measures,
)
from bodysense_lab.completion.options import Body, Fault
from bodysense_lab.completion.scenes import TRUTH_OF, TrackedScene, Truth, batches, person_of, scene_of
from bodysense_lab.completion.scores import RunningScores
from bodysense_lab.completion.sight_scores import TAKE, measure_sight, measure_transitions
from bodysense_lab.completion.tables import (
    TAKE_MEASURES,
    TAKE_SIGHTS,
    CompletionSettings,
    CompletionTable,
    WorstFrame,
    headline,
)
from bodysense_lab.completion.tracking import StepTimes, Tracked, TrackPeople, TrackTake, step_times, track_people
from bodysense_lab.parallel import parallel_map
from bodysense_lab.scoring import RATE

TIMED_FRAMES = 330  # of one wearer, to tell how long a step takes
_EDGES = 10  # of the lattice that one process scores at a time
Item = TypeVar("Item")
Result = TypeVar("Result")
# Runs work on items, results in order: here, or in other processes, to which the work must pickle.
Spread = Callable[[Callable[[Item], Result], Iterable[Item]], Iterator[tuple[Item, Result]]]
Scored = Sequence[tuple[CompletionTable, TrackedScene]]  # scenes of one truth, and the table of each


def evaluate_completion(
    clips: Iterable[Clip],
    settings: CompletionSettings = CompletionSettings(),
    *,
    mean_body: MeanBody | None = None,
    track: TrackPeople = track_people,
    takes: TrackTake | None = None,
    times: StepTimes | None = step_times,
    parallel_map: Spread = partial(parallel_map, jobs=1),
    kept: KeptClips | None = None,
    advance: Callable[[int, str], None] = lambda count, what: None,
) -> CompletionTable:
    """Score the tracker on clips.

    Args:
        clips: the motion, canonical.
        settings: what is scored.
        mean_body: a baseline of hidden joints; None leaves it out.
        track: tracks people side by side.
        takes: completes whole takes with past and future; None leaves them out.
        times: times the steps of one wearer; None leaves this out.
        parallel_map: where the work is done.
        kept: results of clips that are scored already, and where those of others are kept.
        advance: called with the number of clips of a cell, or edges of the lattice, that are done, and their kind.
    """
    table = CompletionTable(settings)
    clips = list(clips)
    truths: tuple[Truth, ...] = tuple(dict.fromkeys(TRUTH_OF[body] for body in settings.bodies))
    jobs: list[tuple[list[Clip], Truth]] = []
    for truth in truths:
        missing: list[Clip] = []
        for clip in clips:
            part = None if kept is None else kept.find(clip, truth, settings)
            if part is None:
                missing.append(clip)
            else:
                table.merge(part)
        for batch in batches(missing):
            jobs.append((batch, truth))
        advance(_work_done(len(clips) - len(missing), settings, truth), "clips kept from before")
    for (batch, truth), parts in parallel_map(_Scorer(settings, mean_body, track, takes), jobs):
        for clip, part in zip(batch, parts, strict=True):
            table.merge(part)
            if kept is not None:
                kept.keep(clip, truth, part)
        advance(_work_done(len(batch), settings, truth), f"{len(batch)} clips, {truth} bodies")
    groups = list(batches(clips))
    if times is not None and groups:
        _time_steps(table, groups[0][0], times)  # the longest clip
    if settings.edges:
        judged = [scene_of(clip, "stranger", settings.split) for batch in groups for clip in batch]
        edges = random_edges(settings.edges)
        some = [edges[first : first + _EDGES] for first in range(0, len(edges), _EDGES)]
        for of, scores in parallel_map(partial(score_lattice, scenes=choose_scenes(judged), track=track), some):
            table.lattice.extend(scores)
            advance(len(of), "edges")
    return table


def _work_done(count: int, settings: CompletionSettings, truth: Truth) -> int:
    """Return the work that `advance` counts for clips of one truth."""
    return count * len(settings.sets) * sum(TRUTH_OF[body] == truth for body in settings.bodies)


def work_of(count: int, settings: CompletionSettings) -> int:
    """Return the work that `advance` counts in all for `count` clips."""
    return count * len(settings.sets) * len(settings.bodies) + settings.edges


@dataclass(frozen=True)
class _Scorer:
    """Scorer of clips of one truth, side by side; other processes get it pickled."""

    settings: CompletionSettings
    mean_body: MeanBody | None
    track: TrackPeople
    takes: TrackTake | None

    def __call__(self, batch: tuple[Sequence[Clip], Truth]) -> list[CompletionTable]:
        """The tables of some clips, one of each clip."""
        clips, truth = batch
        scenes = [scene_of(clip, truth, self.settings.split) for clip in clips]
        scored = [(CompletionTable(self.settings), scene) for scene in scenes]
        for table, scene in scored:
            position = scene.placed[0]
            table.truths[truth, scene.group] = motion_measures(position, position, scene.skeleton)
        for sensors in self.settings.sets:
            observations = [scene.observe(SENSOR_SETS[sensors]) for scene in scenes]
            if sensors == "headset_camera":
                for (table, scene), seen in zip(scored, observations, strict=True):
                    self._score_baselines(table, scene, seen, truth)
            for body in self.settings.bodies:
                if TRUTH_OF[body] == truth:
                    self._score_cell(scored, observations, sensors, body)
        return [table for table, _ in scored]

    def _score_cell(self, scored: Scored, observations: Sequence[Observation], sensors: str, body: Body) -> None:
        """Score one set of sensors on scenes, with one amount of knowledge about the body."""
        people = [person_of(body, scene.skeleton) for _, scene in scored]
        tracked = self.track(people, observations)
        for (table, scene), person, seen, one in zip(scored, people, observations, tracked, strict=True):
            cell = (sensors, body, scene.group)
            scores = table.cells[cell] = measure_sight(scene, seen, one)
            scores.merge(measure(scene, one))
            if sensors == "headset_camera":
                scores.merge(measure_hidden(one.position, scene))
            if self.takes is not None:
                scores.merge(_take_scores(scene, sensors, seen, self.takes(person, seen)))
            if scene.group == "main":
                name = headline(sensors)
                own = table.people[sensors, body, scene.person] = RunningScores()
                own.add(name, scores.get(name), scores.weight.get(name, 0.0))
                table.worst.extend(_worst_frames(sensors, body, scene, one))
                for region, calibration in measure_confidence(scene, seen, one).items():
                    table.calibrations[sensors, body, region] = calibration
        if body == "own" and sensors in BLINKING:
            self._score_blinks(scored, observations, sensors, tracked)
            if "left_wrist" in observations[0].points:
                self._score_losses(scored, observations, sensors)

    def _score_losses(self, scored: Scored, observations: Sequence[Observation], sensors: str) -> None:
        """Score the effect of lost hands on bodies of known proportions."""
        people = [person_of("own", scene.skeleton) for _, scene in scored]
        lost = [lose_hands(seen, rng_of(scene.name)) for (_, scene), seen in zip(scored, observations, strict=True)]
        tracked = self.track(people, lost)
        for (table, scene), person, seen, one in zip(scored, people, lost, tracked, strict=True):
            scores = table.cells[sensors, "own", scene.group]
            scores.merge(measure_transitions(scene, seen, one))
            if self.takes is not None:
                scores.merge(measure_transitions(scene, seen, self.takes(person, seen), TAKE))

    def _score_blinks(
        self, scored: Scored, observations: Sequence[Observation], sensors: str, tracked: Sequence[Tracked]
    ) -> None:
        """Score the effect of a blinking finger on bodies of known proportions.

        `tracked` is without it, which a set without fingers need not track again.
        """
        people, jumps = [person_of("own", scene.skeleton) for _, scene in scored], []
        for blinking in (False, True):
            seen = [
                with_finger(one, scene.placed[0][:, scene.skeleton.index(FINGER)], blinking)
                for (_, scene), one in zip(scored, observations, strict=True)
            ]
            unchanged = not blinking and FINGER not in observations[0].points
            each = tracked if unchanged else self.track(people, seen)
            jumps.append([count_jumps(one.position, scene) for (_, scene), one in zip(scored, each, strict=True)])
        for (table, scene), steady, blinked in zip(scored, *jumps, strict=True):
            minutes = (len(scene) - 1) / RATE / 60
            extra = (blinked - steady) / minutes if minutes else 0.0
            table.cells[sensors, "own", scene.group].add("extra_jumps_per_minute", extra, minutes)

    def _score_baselines(self, table: CompletionTable, scene: TrackedScene, seen: Observation, truth: Truth) -> None:
        """Score methods that know nothing of this wearer's motion, on hidden joints."""
        methods = last_known(seen, scene.skeleton)
        if self.mean_body is not None:
            head = scene.skeleton.index("head")
            position, rotation = scene.placed
            methods["mean_body"] = self.mean_body.positions(position[:, head], rotation[:, head], scene.skeleton)
        for method, position in methods.items():
            table.baselines[method, truth, scene.group] = measure_hidden(position, scene)


def _take_scores(scene: TrackedScene, sensors: str, seen: Observation, taken: Tracked) -> RunningScores:
    """The measures of `TAKE_MEASURES` and `TAKE_SIGHTS`, and how true expected errors are, of a whole take."""
    scores, named = measure_sight(scene, seen, taken), RunningScores()
    scores.merge(measure(scene, taken))
    if sensors == "headset_camera":
        scores.merge(measure_hidden(taken.position, scene))
    for name in (*TAKE_SIGHTS, *TAKE_MEASURES):
        if name in scores.weight:
            named.add(f"{TAKE}{name}", scores.get(name), scores.weight[name])
    for one in measure_confidence(scene, seen, taken).values():
        named.add(f"{TAKE}cover90", one.coverage, one.count)
        expected = float(one.expected_and_true[0].sum())
        named.add(f"{TAKE}expected_cm", 100 * expected / max(one.count, 1.0), one.count)
    return named


def _worst_frames(sensors: str, body: Body, scene: TrackedScene, tracked: Tracked) -> Iterator[WorstFrame]:
    """The frames with the largest mean error of 22 joints, from the head, and with the largest leap of one."""
    joints = scene.skeleton.indices(BODY)
    leaps = 100 * sight.leaps(tracked.position[:, joints], scene.placed[0][:, joints])
    faults: dict[Fault, np.ndarray] = {"error": scene.error_from_head(tracked.position).mean(axis=-1)}
    faults["leap"] = np.concatenate([[0.0], leaps])
    for fault, sizes in faults.items():
        frame = int(sizes.argmax())
        yield WorstFrame(sensors, body, scene.name, frame, fault, float(sizes[frame]))


def _time_steps(table: CompletionTable, clip: Clip, times: StepTimes) -> None:
    """Time the steps of one wearer in every cell."""
    for body in table.settings.bodies:
        scene = scene_of(clip, TRUTH_OF[body], table.settings.split).beginning(TIMED_FRAMES)
        for sensors in table.settings.sets:
            seen = scene.observe(SENSOR_SETS[sensors])
            table.times[sensors, body] = times(person_of(body, scene.skeleton), seen)
