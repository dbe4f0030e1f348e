"""Scoring of scripted scenes by the tracker: each scene with each set of sensors, and heads of real headsets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from bodysense.body.person import Person
from bodysense.devices.simulated.sensors import SENSOR_SETS, WRISTS
from bodysense.observing.observation import Observation
from bodysense_lab.completion.score.scenes import TrackedScene
from bodysense_lab.completion.score.scores import RunningScores
from bodysense_lab.completion.score.scripted.scene_measures import calm_frames, gliding_feet, measure_scene
from bodysense_lab.completion.score.sight.sight import FLOATING
from bodysense_lab.completion.score.sight.wearers import HEIGHT, PALMS, head_paths, known_body, rest_heights, with_hands
from bodysense_lab.completion.score.tracking import PeopleTracker, TrackedMotion
from bodysense_lab.core.scoring import RATE
from bodysense_lab.synthesis.scenes import KINDS, ScriptedScene, sequence

Split = Literal["val", "test"]
SPLITS: tuple[Split, ...] = ("val", "test")
SECONDS = 12.0  # s of each scene
LOST_FOR = 3.0  # s for which each hand is lost, once in a scene
STANDS = 0.85  # of its standing height; a higher head is that of a standing wearer


@dataclass(frozen=True)
class SceneSet:
    """Sensors of a column of the table, and what the tracker knows of the body."""

    title: str
    sensors: str  # of `SENSOR_SETS`
    hands: Literal["always", "in_view", "lost"] = "always"
    known: bool = True  # the proportions of the body


SETS = {
    "head": SceneSet("head", "head"),
    "three_point": SceneSet("three points", "three_point"),
    "hands_in_view": SceneSet("hands in view", "three_point", "in_view"),
    "lost_hands": SceneSet("lost hands", "three_point", "lost"),
    "headset_camera": SceneSet("cameras", "headset_camera"),
    "six_point": SceneSet("six points", "six_point"),
    "head_unknown": SceneSet("head, unknown body", "head", known=False),
    "three_point_unknown": SceneSet("three points, unknown body", "three_point", known=False),
}


@dataclass(frozen=True)
class SceneJob:
    """One scene to score."""

    split: Split
    kind: str
    index: int

    @property
    def generator(self) -> np.random.Generator:
        """The source of the scene's random choices; those of different splits are independent."""
        key = (1 + SPLITS.index(self.split), list(KINDS).index(self.kind), self.index)
        return np.random.default_rng(np.random.SeedSequence(46, spawn_key=key))

    def draw(self) -> tuple[ScriptedScene, TrackedScene, np.ndarray]:
        """Return the scene, its motion as ground truth, and frames (T, 2), bool, in which a hand is lost if any is."""
        rng = self.generator
        scripted = sequence(rng, round(SECONDS * RATE), RATE, kind=self.kind, margin=0.0)
        return (
            scripted,
            TrackedScene(f"{self.kind} {self.index}", "main", scripted.pose),
            _lost_hands(len(scripted), rng),
        )


@dataclass(frozen=True)
class SceneWork:
    """Scores of a scene by set."""

    track: PeopleTracker
    sets: tuple[str, ...]

    def __call__(self, job: SceneJob) -> dict[str, RunningScores]:
        """Track a scene with every set and return the measures."""
        scripted, scene, lost = job.draw()
        observed = [observe_scene(scene, SETS[name], lost) for name in self.sets]
        people = [Person(scene.skeleton) if SETS[name].known else Person() for name in self.sets]
        tracked = self.track(people, [seen for seen, _ in observed])
        return {
            name: measure_scene(scripted, scene, seen, one, missing)
            for name, (seen, missing), one in zip(self.sets, observed, tracked, strict=True)
        }


def observe_scene(scene: TrackedScene, chosen: SceneSet, lost: np.ndarray) -> tuple[Observation, np.ndarray]:
    """Return the observation of a scene by a set, and frames (T, 2), bool, in which its hands are lost."""
    seen = scene.observe(SENSOR_SETS[chosen.sensors])
    wrists = scene.skeleton.indices(WRISTS)
    hidden = np.zeros((len(scene), 2), dtype=bool)
    if chosen.hands == "in_view":
        hidden = ~scene.visible[:, wrists]
    elif chosen.hands == "lost":
        hidden = lost
    if not hidden.any():
        return seen, hidden
    has_position, has_rotation = seen.has_position.copy(), seen.has_rotation.copy()
    for side, name in enumerate(WRISTS):
        column = seen.points.index(name)
        has_position[hidden[:, side], column] = False
        has_rotation[hidden[:, side], column] = False
    position = np.where(has_position[..., None], seen.position, np.nan)
    rotation = np.where(has_rotation[..., None], seen.rotation, np.nan)
    return replace(seen, position=position, rotation=rotation, has_position=has_position,
                   has_rotation=has_rotation), hidden  # fmt: skip


def scene_jobs(split: Split, kinds: Sequence[str], scenes: int) -> list[SceneJob]:
    """Return the scenes of a split: `scenes` of each kind."""
    return [SceneJob(split, kind, index) for kind in kinds for index in range(scenes)]


def score_headsets(folder: Path, track: PeopleTracker) -> Iterator[tuple[str, RunningScores]]:
    """Yield scores of recorded heads of people who stand and play, of unknown bodies, by how the palms are held.

    `gliding_share` is of frames with a calm head, `float_share` of frames in which the wearer stands.
    """
    skeleton = known_body(HEIGHT)
    heights, paths = rest_heights(skeleton), list(head_paths(folder, skeleton))
    head, balls = skeleton.index("head"), skeleton.indices(["left_foot", "right_foot"])
    for palms in PALMS:
        scores = RunningScores()
        tracked: list[TrackedMotion] = track(
            [Person()] * len(paths), [with_hands(one, palms, skeleton) for one in paths]
        )
        for path, one in zip(paths, tracked, strict=True):
            feet, rest = one.position[:, balls], float(heights[balls[0]])
            scores.add_share("gliding_share", gliding_feet(feet, rest)[calm_frames(path.position)].max(axis=1))
            stands = path.position[:, 1] > STANDS * heights[head]
            scores.add_share("float_share", np.asarray(feet[stands][..., 1].min(axis=-1) > rest + FLOATING))
        yield palms, scores


def _lost_hands(frames: int, rng: np.random.Generator) -> np.ndarray:
    """Draw frames (T, 2), bool, in which each hand is lost, once for `LOST_FOR` s."""
    lost, lasts = np.zeros((frames, 2), dtype=bool), round(LOST_FOR * RATE)
    for side in range(2):
        begin = int(rng.integers(round(RATE), max(frames - lasts, round(RATE) + 1)))
        lost[begin : begin + lasts, side] = True
    return lost
