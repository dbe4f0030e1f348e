"""The lattice of sensor sets: whether one sensor more ever makes the body worse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import Edge, SensorSet
from bodysense.lab.completion.scenes import TrackedScene, person_of, stacked
from bodysense.lab.completion.tracking import TrackBatch
from bodysense.lab.metrics import joint_error

TOLERANCE = 0.01  # by so much of itself a mean error may grow
CLIPS, FRAMES = 24, 300  # strangers on which an edge is judged: so many scenes, their first 10 s


@dataclass(frozen=True)
class EdgeScore:
    """The errors at the two ends of an edge: MPJPE from the head, 22 joints, mean over clips, cm."""

    edge: Edge
    fewer: float
    more: float

    @property
    def violates(self) -> bool:
        """Whether the sensor makes the mean worse by more than `TOLERANCE`."""
        return self.more > (1 + TOLERANCE) * self.fewer


def score_lattice(
    scenes: Sequence[TrackedScene], edges: Sequence[Edge], track: TrackBatch, advance: Callable[[], None] = lambda: None
) -> list[EdgeScore]:
    """Score edges on scenes whose proportions are told; `advance` is called after each edge."""
    known: dict[SensorSet, float] = {}

    def error_of(sensors: SensorSet) -> float:
        if sensors not in known:
            known[sensors] = _mean_error(scenes, sensors, track)
        return known[sensors]

    scores = []
    for edge in edges:
        scores.append(EdgeScore(edge, error_of(edge.fewer), error_of(edge.more)))
        advance()
    return scores


def choose_scenes(scenes: Sequence[TrackedScene]) -> list[TrackedScene]:
    """The beginnings of some main scenes, spread evenly over all that last long enough, or over all if none does."""
    main = [scene for scene in scenes if scene.group == "main"] or list(scenes)
    long = [scene for scene in main if len(scene) >= FRAMES] or main
    places = np.linspace(0, len(long) - 1, min(CLIPS, len(long))).round().astype(int)
    return [long[place].beginning(FRAMES) for place in places]


def _mean_error(scenes: Sequence[TrackedScene], sensors: SensorSet, track: TrackBatch) -> float:
    """MPJPE from the head, cm, mean over the scenes."""
    people = [person_of("stranger", scene.skeleton) for scene in scenes]
    tracked = track(people, stacked([scene.observe(sensors) for scene in scenes]))
    errors = []
    for index, scene in enumerate(scenes):
        body, head = scene.skeleton.indices(BODY), scene.skeleton.index("head")
        truth, position = scene.placed[0], tracked.position[index, : len(scene)]
        error = joint_error(position[:, body] - position[:, [head]], truth[:, body] - truth[:, [head]])
        errors.append(error.mean())
    return float(np.mean(errors))
