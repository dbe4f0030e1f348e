"""Scores of kinds of signals: named sets, random sets, each without its head, its rotations or its positions.

Errors are those of 22 joints relative to the pelvis, because many sets have no position at all. Expected errors are
compared with errors relative to the head, as the tracker states them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.noise import hide
from bodysense.devices.simulated.sensors import INERTIAL_SETS, SENSOR_SETS, SensorSet
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.quality.metrics import joint_error
from bodysense_lab.completion.data.signal_kinds import FAMILIES, TEST_SIGNALS, draw_signal, observed_set
from bodysense_lab.completion.kinds.lattice_scores import TOLERANCE, EdgeScore
from bodysense_lab.completion.score.scenes import TrackedScene, person_of
from bodysense_lab.completion.score.tracking import TrackedMotion, TrackPeople
from bodysense_lab.core.scoring import RATE
from bodysense_lab.core.table import Cell, Report, cell

# Named rows: sets of the tables, inertial sets, and a head of which only the position is known.
ROWS = {
    **{name: SENSOR_SETS[name] for name in ("head", "three_point", "six_point", "ten_point", *INERTIAL_SETS)},
    "head_position": SensorSet(("head",), ()),
    "ten_positions": SensorSet(SENSOR_SETS["ten_point"].position, ()),
}
VARIANTS: Mapping[str, Callable[[SensorSet], SensorSet]] = {
    "": lambda sensors: sensors,
    "no_head": lambda sensors: _filtered(sensors, lambda name: name != "head"),
    "rotations": lambda sensors: replace(sensors, position=()),
    "positions": lambda sensors: replace(sensors, rotation=()),
}
_LOST, _EVERY = 1.0, 4.0  # s, duration of a loss of the head, and time between the beginnings of losses
LOSSES = {"position": (True, False), "rotation": (False, True), "pose": (True, True)}  # what a head loses
_SEED = 46


@dataclass(frozen=True)
class KindScore:
    """Scores of a sensor set: means over joints, frames and scenes."""

    error: float  # cm, 22 joints relative to the pelvis
    expected: float  # cm, expected error of untracked joints
    true: float  # cm, true error of untracked joints relative to the head
    covered: float  # share of untracked joints within the 90 % bound


@dataclass(frozen=True)
class KindJob:
    """A cell of the table: sensor sets whose scores are averaged."""

    row: str
    variant: str
    sets: tuple[SensorSet, ...]
    loses: str = ""  # of `LOSSES`: what the head loses for a second at a time


def kind_jobs(members: int) -> list[KindJob]:
    """Return the cells of the table: named sets, `members` random sets of each family, and a head that is lost."""
    rng = np.random.default_rng(_SEED)
    rows: dict[str, tuple[SensorSet, ...]] = {name: (sensors,) for name, sensors in ROWS.items()}
    for family in FAMILIES if members else ():
        ranges = replace(TEST_SIGNALS, shares={family: 1.0})
        rows[f"random_{family}"] = tuple(draw_signal(rng, ranges) for _ in range(members))
    jobs = [KindJob(f"three_point_loses_{lost}", "", (SENSOR_SETS["three_point"],), lost) for lost in LOSSES]
    for row, sets in rows.items():
        before: set[tuple[SensorSet, ...]] = set()
        for variant, change in VARIANTS.items():
            changed = tuple(one for one in map(change, sets) if one.points)
            if changed and changed not in before:
                jobs.append(KindJob(row, variant, changed))
            before.add(changed)
    return jobs


def score_kind(job: KindJob, scenes: Sequence[TrackedScene], track: TrackPeople) -> KindScore:
    """Score a cell on scenes of known proportions."""
    people = [person_of("stranger", scene.skeleton) for scene in scenes]
    found: list[KindScore] = []
    for sensors in job.sets:
        seen = [scene.observe(observed_set(sensors)) for scene in scenes]
        counted = [np.ones(len(scene), dtype=bool) for scene in scenes]
        if job.loses:
            # the head is lost for a second at a time, after three seconds
            counted = [np.arange(len(scene)) / RATE % _EVERY >= _EVERY - _LOST for scene in scenes]
            seen = [_without_head(one, frames, job.loses) for one, frames in zip(seen, counted, strict=True)]
        tracked = track(people, seen)
        found += [_score(*one) for one in zip(scenes, seen, tracked, counted, strict=True)]
    return KindScore(*(float(np.nanmean([getattr(one, name) for one in found])) for name in KindScore.__annotations__))


def _score(scene: TrackedScene, seen: Observation, tracked: TrackedMotion, counted: np.ndarray) -> KindScore:
    places, truth = scene.skeleton.indices(BODY), scene.world_pose[0]
    position, true_position = tracked.position[counted][:, places], truth[counted][:, places]
    error = joint_error(position - position[:, :1], true_position - true_position[:, :1])
    head = BODY.index("head")
    from_head = joint_error(position - position[:, [head]], true_position - true_position[:, [head]])
    hidden = ~observed_points(seen, scene.skeleton)[2][counted][:, places]
    expected, bound = (100 * values[counted][:, places][hidden] for values in (tracked.confidence, tracked.bound))
    if not hidden.any():
        return KindScore(float(error.mean()), np.nan, np.nan, np.nan)
    missed = from_head[hidden]
    return KindScore(float(error.mean()), float(expected.mean()), float(missed.mean()), float((missed <= bound).mean()))


def _filtered(sensors: SensorSet, keep: Callable[[str], bool]) -> SensorSet:
    position, rotation = (tuple(filter(keep, names)) for names in (sensors.position, sensors.rotation))
    return replace(sensors, position=position, rotation=rotation)


def _without_head(seen: Observation, frames: np.ndarray, loses: str) -> Observation:
    """Return the observation without the head's position, rotation or both in some frames (T,)."""
    place, turn = LOSSES[loses]
    hidden = np.zeros(seen.has_position.shape, dtype=bool)
    hidden[:, seen.points.index("head")] = frames
    if place and turn:
        return hide(seen, hidden)
    if place:
        position = np.where(hidden[..., None], np.nan, seen.position)
        return replace(seen, position=position, has_position=seen.has_position & ~hidden)
    rotation = np.where(hidden[..., None], np.nan, seen.rotation)
    return replace(seen, rotation=rotation, has_rotation=seen.has_rotation & ~hidden)


def kind_numbers(scores: Mapping[tuple[str, str], KindScore], edges: Sequence[EdgeScore]) -> dict[str, float]:
    """Return all figures by flat keys: ROW_cm, ROW_VARIANT_cm, ROW_expected_ratio, ROW_cover90, pairs."""
    numbers: dict[str, float] = {}
    for (row, variant), one in scores.items():
        numbers[f"{row}_{variant}_cm" if variant else f"{row}_cm"] = one.error
        if not variant and np.isfinite(one.true):
            numbers |= {f"{row}_expected_ratio": one.expected / one.true, f"{row}_cover90": one.covered}
    if edges:
        numbers |= {
            "pairs": float(len(edges)),
            "pairs_worse": float(sum(edge.violates for edge in edges)),
            "pairs_worst_share": max(edge.more / edge.fewer - 1 for edge in edges),
        }
    return numbers


def kind_report(
    scores: Mapping[tuple[str, str], KindScore], edges: Sequence[EdgeScore], data: str, clips: int
) -> Report:
    """Return the table of kinds. `data` names the motion, `clips` is the number of scenes."""
    numbers = kind_numbers(scores, edges) | {"clips": float(clips)}
    rows = []
    for row in dict.fromkeys(row for row, _ in scores):
        values: list[Cell] = []
        for variant in VARIANTS:
            key = f"{row}_{variant}_cm" if variant else f"{row}_cm"
            values.append(cell(numbers.get(key, np.nan)))
        ratio, covered = numbers.get(f"{row}_expected_ratio", np.nan), numbers.get(f"{row}_cover90", np.nan)
        rows.append((row.replace("_", " "), *values, cell(ratio), cell(100 * covered)))
    remarks = list(_edge_remarks(edges))
    return Report(
        name="kinds",
        title="Kinds of signals",
        columns=("sensors", "cm", "no head", "rotations alone", "positions alone", "expected / true", "bound %"),
        rows=tuple(rows),
        numbers=numbers,
        data=(f"{data}: {clips} scenes of unseen bodies, proportions known.",),
        remarks=tuple(remarks),
        remarks_title="One sensor more",
        caption="Mean error of 22 joints relative to the pelvis, cm. Expected errors and bounds: untracked joints.",
        digits=2,
    )


def _edge_remarks(edges: Sequence[EdgeScore]) -> Iterator[str]:
    if not edges:
        return
    worse = sorted((edge for edge in edges if edge.violates), key=lambda edge: -edge.more / edge.fewer)
    yield f"One sensor more is worse by over {TOLERANCE:.0%} in {len(worse)} of {len(edges)} random pairs."
    for one in worse[:8]:
        names = ", ".join(
            f"{name} ({'p' * (name in one.edge.fewer.position)}{'r' * (name in one.edge.fewer.rotation)})"
            for name in one.edge.fewer.points
        )
        yield f"{one.fewer:.1f} → {one.more:.1f} cm with {one.edge.kind} of {one.edge.sensor}, added to {names}"


def score_all(
    jobs: Sequence[KindJob],
    scenes: Sequence[TrackedScene],
    track: TrackPeople,
    parallel_map: Callable[..., Any],
    advance: Callable[[str], None],
) -> dict[tuple[str, str], KindScore]:
    """Score cells in parallel; `advance` is called with the name of each."""
    scores: dict[tuple[str, str], KindScore] = {}
    for job, score in parallel_map(partial(score_kind, scenes=scenes, track=track), jobs):
        scores[job.row, job.variant] = score
        advance(job.row)
    return scores
