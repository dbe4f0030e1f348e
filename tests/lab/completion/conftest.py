"""Motion for tests of the completion tables, and a tracker that returns the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.io.clip import Clip
from bodysense.observing.observation import Observation
from bodysense_lab.completion.score.scenes import TrackedScene, Truth, scene_of
from bodysense_lab.completion.score.tracking import TrackedMotion

# True positions (T, P, 3) m of a scene → output positions.
PositionChange = Callable[[np.ndarray, TrackedScene], np.ndarray]


@dataclass(frozen=True)
class Oracle:
    """Tracker that returns the true body of a known scene, changed by `change`."""

    scenes: Sequence[TrackedScene]
    change: PositionChange = lambda position, scene: position
    confidence: float | None = None  # m; None: the true error

    def __call__(self, people: Sequence[Person], observations: Sequence[Observation]) -> list[TrackedMotion]:
        return [self.of_scene(self.find(one)) for one in observations]

    def of_scene(self, scene: TrackedScene) -> TrackedMotion:
        truth = scene.world_pose[0]
        position = self.change(truth.copy(), scene)
        error = np.linalg.norm(position - truth, axis=-1)
        confidence = error if self.confidence is None else np.full(error.shape, self.confidence)
        contact = np.zeros((len(scene), 4))
        return TrackedMotion(position, scene.pose.rotation, confidence, 1.001 * confidence, contact)

    def find(self, seen: Observation) -> TrackedScene:
        """Return the scene with the motion of an observation's first frame and length."""
        return next(one for one in self.scenes if len(one) == len(seen) and _observes(seen, one))


def _observes(seen: Observation, scene: TrackedScene) -> bool:
    """Return whether the first frame of an observation has the positions and rotations of a scene."""
    places = scene.skeleton.indices(seen.points)
    position, rotation = (values[0] for values in scene.world_pose)
    has_position, has_rotation = seen.has_position[0], seen.has_rotation[0]
    turned = rotation[places[has_rotation]]
    alike = np.abs((seen.rotation[0, has_rotation] * turned).sum(axis=-1)) > 1 - 1e-12
    return bool(np.array_equal(seen.position[0, has_position], position[places[has_position]]) and alike.all())


@pytest.fixture(scope="session")
def clips(waving_clip: Clip) -> list[Clip]:
    """Return three clips of different lengths; the last one is sport."""
    frames = (slice(0, 90), slice(5, 65), slice(20, 50))
    names = (("anna", "sit"), ("ben", "everyday"), ("cleo", "sport"))
    return [
        replace(waving_clip, name=f"{person}-waves", person=person, category=category, pose=waving_clip.pose[part])
        for (person, category), part in zip(names, frames, strict=True)
    ]


@pytest.fixture(scope="session")
def scenes(clips: list[Clip]) -> list[TrackedScene]:
    """Return the scenes of the clips on their own and on unseen bodies."""
    truths: tuple[Truth, ...] = ("own", "stranger")
    return [scene_of(clip, truth, "test") for clip in clips for truth in truths]
