"""Motion for the tables of completion, and a tracker that knows the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.io.clip import Clip
from bodysense.observation import Observation
from bodysense_lab.completion.scenes import TrackedScene, Truth, scene_of
from bodysense_lab.completion.tracking import TrackedBatch

Change = Callable[[np.ndarray, TrackedScene], np.ndarray]  # positions (T, P, 3) m of a scene → what is said of them


@dataclass(frozen=True)
class Oracle:
    """Knows every scene, and says of it what `change` makes of the truth; after its end it says nonsense."""

    scenes: Sequence[TrackedScene]
    change: Change = lambda position, scene: position
    confidence: float | None = None  # m; None: the true error

    def __call__(self, people: Sequence[Person], observation: Observation) -> TrackedBatch:
        shape = (len(people), len(observation))
        batch = TrackedBatch(
            position=np.full((*shape, 65, 3), 1e3),
            rotation=np.full((*shape, 52, 4), 1e3),
            confidence=np.full((*shape, 65), 1e3),
            bound=np.full((*shape, 65), 1e3),
            contact=np.full((*shape, 4), 1e3),
        )
        for index in range(len(people)):
            scene = self.find(observation.position[index, :, observation.points.index("head")])
            truth, own = scene.placed[0], slice(0, len(scene))
            batch.position[index, own] = self.change(truth.copy(), scene)
            batch.rotation[index, own] = scene.pose.rotation
            error = np.linalg.norm(batch.position[index, own] - truth, axis=-1)
            batch.confidence[index, own] = error if self.confidence is None else self.confidence
            batch.bound[index, own] = 1.001 * batch.confidence[index, own]
        return batch

    def find(self, head: np.ndarray) -> TrackedScene:
        """The scene, whose head moves so; the longest of those that begin alike."""
        found = [one for one in self.scenes if len(one) <= len(head) and np.array_equal(_head(one), head[: len(one)])]
        return max(found, key=len)


def _head(scene: TrackedScene) -> np.ndarray:
    return scene.placed[0][:, scene.skeleton.index("head")]


@pytest.fixture(scope="session")
def clips(waving_clip: Clip) -> list[Clip]:
    """Three clips of different length, the last one sport."""
    frames = (slice(0, 90), slice(5, 65), slice(20, 50))
    names = (("anna", "sit"), ("ben", "everyday"), ("cleo", "sport"))
    return [
        replace(waving_clip, name=f"{person}-waves", person=person, category=category, pose=waving_clip.pose[part])
        for (person, category), part in zip(names, frames, strict=True)
    ]


@pytest.fixture(scope="session")
def scenes(clips: list[Clip]) -> list[TrackedScene]:
    """Their scenes, on their own bodies and on strangers, and the beginnings of them."""
    truths: tuple[Truth, ...] = ("own", "stranger")
    return [scene_of(clip, truth, "test") for clip in clips for truth in truths]
