"""Scoring of `bodysense evaluate completion`: run the tracker over the clips of a split, sensor set by sensor set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.io.clip import Clip
from bodysense.observing.observation import Observation
from bodysense.parallel import parallel_map
from bodysense.takes.last_known import last_known
from bodysense_lab.completion.data.blinks import BLINKING, FINGER, clip_rng, lose_hands, with_finger
from bodysense_lab.completion.score.baselines import MeanBody
from bodysense_lab.completion.score.clip_results import ClipResults
from bodysense_lab.completion.score.measures import (
    count_jumps,
    measure,
    measure_confidence,
    measure_hidden,
    motion_measures,
)
from bodysense_lab.completion.score.scenes import TRUTH_OF, TrackedScene, Truth, batches, person_of, scene_of
from bodysense_lab.completion.score.scores import RunningScores
from bodysense_lab.completion.score.sight import sight
from bodysense_lab.completion.score.sight.sight_scores import TAKE, measure_sight, measure_transitions
from bodysense_lab.completion.score.tables import (
    TAKE_MEASURES,
    TAKE_SIGHTS,
    CompletionSettings,
    CompletionTable,
    WorstFrame,
    headline,
)
from bodysense_lab.completion.score.tracking import (
    StepTimes,
    TrackedMotion,
    TrackPeople,
    TrackTake,
    step_times,
    track_people,
)
from bodysense_lab.completion.training.options import BODY_TITLES, Body, Fault
from bodysense_lab.core.scoring import RATE

TIMED_FRAMES = 330  # frames of one wearer whose steps are timed
Item = TypeVar("Item")
Result = TypeVar("Result")
# Applies a function to items and yields results in order, in this or in other processes; the function must pickle.
Spread = Callable[[Callable[[Item], Result], Iterable[Item]], Iterator[tuple[Item, Result]]]
Scored = Sequence[tuple[CompletionTable, TrackedScene]]  # scenes on one kind of body, and the table of each


def evaluate_completion(
    clips: Iterable[Clip],
    settings: CompletionSettings = CompletionSettings(),
    *,
    mean_body: MeanBody | None = None,
    track: TrackPeople = track_people,
    takes: TrackTake | None = None,
    times: StepTimes | None = step_times,
    parallel_map: Spread = partial(parallel_map, jobs=1),
    results: ClipResults | None = None,
    advance: Callable[[int, str], None] = lambda count, what: None,
) -> CompletionTable:
    """Score the tracker on clips.

    Args:
        clips: the motion, canonical.
        settings: sensor sets, bodies and other settings of the table.
        mean_body: a baseline for hidden joints; None: left out.
        track: tracks several people.
        takes: completes whole takes with past and future; None: left out.
        times: times the steps of one wearer; None: left out.
        parallel_map: runs the work, in this or in other processes.
        results: folder with results of clips; new results are added.
        advance: called with the number of finished units of work (see `work_of`) and a text about them.
    """
    table = CompletionTable(settings)
    clips = list(clips)
    truths: tuple[Truth, ...] = tuple(dict.fromkeys(TRUTH_OF[body] for body in settings.bodies))
    jobs: list[tuple[list[Clip], Truth]] = []
    for truth in truths:
        missing: list[Clip] = []
        for clip in clips:
            part = None if results is None else results.load(clip, truth, settings)
            if part is None:
                missing.append(clip)
            else:
                table.merge(part)
        for batch in batches(missing):
            jobs.append((batch, truth))
        advance(_work_done(len(clips) - len(missing), settings, truth), "clips scored before")
    for (batch, truth), parts in parallel_map(_Scorer(settings, mean_body, track, takes), jobs):
        for clip, part in zip(batch, parts, strict=True):
            table.merge(part)
            if results is not None:
                results.save(clip, truth, part)
        advance(_work_done(len(batch), settings, truth), f"{len(batch)} clips, {BODY_TITLES[truth]}")
    if times is not None and clips:
        _time_steps(table, max(clips, key=lambda clip: clip.seconds), times)
    return table


def _work_done(count: int, settings: CompletionSettings, truth: Truth) -> int:
    """Return the units of work for clips on one kind of body."""
    return count * len(settings.sets) * sum(TRUTH_OF[body] == truth for body in settings.bodies)


def work_of(count: int, settings: CompletionSettings) -> int:
    """Return all units of work for `count` clips: one for each clip, sensor set and body."""
    return count * len(settings.sets) * len(settings.bodies)


@dataclass(frozen=True)
class _Scorer:
    """Scorer of a batch of clips on one kind of body; it can be pickled."""

    settings: CompletionSettings
    mean_body: MeanBody | None
    track: TrackPeople
    takes: TrackTake | None

    def __call__(self, batch: tuple[Sequence[Clip], Truth]) -> list[CompletionTable]:
        """Return the table of each clip."""
        clips, truth = batch
        scenes = [scene_of(clip, truth, self.settings.split) for clip in clips]
        scored = [(CompletionTable(self.settings), scene) for scene in scenes]
        for table, scene in scored:
            position = scene.world_pose[0]
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
        """Score a sensor set on scenes, for one kind of knowledge about the body."""
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
                self._score_lost_hands(scored, observations, sensors)

    def _score_lost_hands(self, scored: Scored, observations: Sequence[Observation], sensors: str) -> None:
        """Score the effect of lost hands, for known proportions."""
        people = [person_of("own", scene.skeleton) for _, scene in scored]
        lost = [lose_hands(seen, clip_rng(scene.name)) for (_, scene), seen in zip(scored, observations, strict=True)]
        tracked = self.track(people, lost)
        for (table, scene), person, seen, one in zip(scored, people, lost, tracked, strict=True):
            scores = table.cells[sensors, "own", scene.group]
            scores.merge(measure_transitions(scene, seen, one))
            if self.takes is not None:
                scores.merge(measure_transitions(scene, seen, self.takes(person, seen), TAKE))

    def _score_blinks(
        self, scored: Scored, observations: Sequence[Observation], sensors: str, tracked: Sequence[TrackedMotion]
    ) -> None:
        """Score the effect of a blinking finger, for known proportions.

        `tracked` is the result without that finger; it is reused for sensor sets that have no fingers.
        """
        people, jumps = [person_of("own", scene.skeleton) for _, scene in scored], []
        for blinking in (False, True):
            seen = [
                with_finger(one, scene.world_pose[0][:, scene.skeleton.index(FINGER)], blinking)
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
        """Score baselines on hidden joints: last known positions and the mean body."""
        methods = last_known(seen, scene.skeleton)
        if self.mean_body is not None:
            head = scene.skeleton.index("head")
            position, rotation = scene.world_pose
            methods["mean_body"] = self.mean_body.positions(position[:, head], rotation[:, head], scene.skeleton)
        for method, position in methods.items():
            table.baselines[method, truth, scene.group] = measure_hidden(position, scene)


def _take_scores(scene: TrackedScene, sensors: str, seen: Observation, taken: TrackedMotion) -> RunningScores:
    """Return measures of a whole take: `TAKE_MEASURES`, `TAKE_SIGHTS`, coverage and expected error."""
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


def _worst_frames(sensors: str, body: Body, scene: TrackedScene, tracked: TrackedMotion) -> Iterator[WorstFrame]:
    """Yield the frame with the largest mean error of 22 joints from the head, and that with the largest leap."""
    joints = scene.skeleton.indices(BODY)
    leaps = 100 * sight.leaps(tracked.position[:, joints], scene.world_pose[0][:, joints])
    faults: dict[Fault, np.ndarray] = {"error": scene.error_from_head(tracked.position).mean(axis=-1)}
    faults["leap"] = np.concatenate([[0.0], leaps])
    for fault, sizes in faults.items():
        frame = int(sizes.argmax())
        yield WorstFrame(sensors, body, scene.name, frame, fault, float(sizes[frame]))


def _time_steps(table: CompletionTable, clip: Clip, times: StepTimes) -> None:
    """Time the steps of one wearer for each sensor set and body."""
    for body in table.settings.bodies:
        scene = scene_of(clip, TRUTH_OF[body], table.settings.split).beginning(TIMED_FRAMES)
        for sensors in table.settings.sets:
            seen = scene.observe(SENSOR_SETS[sensors])
            table.times[sensors, body] = times(person_of(body, scene.skeleton), seen)
