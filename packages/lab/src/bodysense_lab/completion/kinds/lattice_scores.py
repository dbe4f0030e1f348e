"""Scores of the lattice of sensor sets: does one sensor more ever make the body worse?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from bodysense.devices.simulated.sensors import SensorSet
from bodysense_lab.completion.data.signal_kinds import observed_set
from bodysense_lab.completion.kinds.lattice import Edge
from bodysense_lab.completion.score.scenes import TrackedScene, person_of
from bodysense_lab.completion.score.tracking import TrackPeople

TOLERANCE = 0.01  # share by which a mean error may grow
CLIPS, FRAMES = 24, 300  # scenes of unseen bodies, and frames of each (10 s), that score an edge


@dataclass(frozen=True)
class EdgeScore:
    """Errors of both sets of an edge: MPJPE of 22 joints relative to the head, mean over clips, cm."""

    edge: Edge
    fewer: float
    more: float

    @property
    def violates(self) -> bool:
        """Whether the added sensor raises the error by more than `TOLERANCE`."""
        return self.more > (1 + TOLERANCE) * self.fewer


def score_lattice(edges: Sequence[Edge], scenes: Sequence[TrackedScene], track: TrackPeople) -> list[EdgeScore]:
    """Score edges on scenes of known proportions."""
    people = [person_of("stranger", scene.skeleton) for scene in scenes]

    @cache
    def error_of(sensors: SensorSet) -> float:
        """Return the MPJPE relative to the head, cm, mean over the scenes."""
        tracked = track(people, [scene.observe(observed_set(sensors)) for scene in scenes])
        errors = [scene.error_from_head(one.position).mean() for scene, one in zip(scenes, tracked, strict=True)]
        return float(np.mean(errors))

    return [EdgeScore(edge, error_of(edge.fewer), error_of(edge.more)) for edge in edges]


def choose_scenes(scenes: Sequence[TrackedScene], count: int = CLIPS) -> list[TrackedScene]:
    """Return the first `FRAMES` frames of up to `count` main scenes, spread evenly over all that are long enough.

    Shorter scenes are used if all are too short.
    """
    main = [scene for scene in scenes if scene.group == "main"] or list(scenes)
    long = [scene for scene in main if len(scene) >= FRAMES] or main
    places = np.linspace(0, len(long) - 1, min(count, len(long))).round().astype(int)
    return [long[place].beginning(FRAMES) for place in places]
