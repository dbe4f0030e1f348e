"""The tracker as the tables run it: many people in one call, and one person frame by frame against the clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from bodysense.body.person import Person
from bodysense.completion.model import CompletionModel, load_completion, packaged_model
from bodysense.observation import Observation
from bodysense.tracker import Tracker

_WARM_UP = 30  # frames that are not timed


@dataclass(frozen=True, eq=False)
class TrackedBatch:
    """What a tracker makes of the observations of B people, T frames each."""

    position: np.ndarray  # (B, T, P, 3) m, world
    rotation: np.ndarray  # (B, T, J, 4) wxyz, parent ← joint
    confidence: np.ndarray  # (B, T, P) m, expected error of every position
    bound: np.ndarray  # (B, T, P) m, within which nine of ten errors are
    contact: np.ndarray  # (B, T, 4) probability: left ankle and ball, right ankle and ball

    def of_person(self, index: int, frames: int) -> TrackedBatch:
        """The first `frames` of one person, without the batch axis."""
        return TrackedBatch(
            position=self.position[index, :frames],
            rotation=self.rotation[index, :frames],
            confidence=self.confidence[index, :frames],
            bound=self.bound[index, :frames],
            contact=self.contact[index, :frames],
        )


TrackBatch = Callable[[Sequence[Person], Observation], TrackedBatch]
StepTimes = Callable[[Person, Observation], np.ndarray]


def track_batch(
    people: Sequence[Person], observation: Observation, network: CompletionModel | None = None
) -> TrackedBatch:
    """Track B people with observations (B, T, P) from their first frame on, in one call; None: the packaged network."""
    tracker = Tracker(people, network)
    estimate, _ = tracker.step(observation, tracker.start())
    return TrackedBatch(estimate.points, estimate.pose.rotation, estimate.confidence, estimate.bound, estimate.contact)


@dataclass(frozen=True)
class TrackedBy:
    """`track_batch` by the network of a file (None: the packaged one), which every process opens for itself."""

    model: Path | None

    @property
    def network(self) -> CompletionModel:
        """The network, opened once in every process."""
        return _opened(self.model)

    def __call__(self, people: Sequence[Person], observation: Observation) -> TrackedBatch:
        """Track B people."""
        return track_batch(people, observation, self.network)


@lru_cache(maxsize=1)
def _opened(model: Path | None) -> CompletionModel:
    return packaged_model() if model is None else load_completion(model)


def step_times(person: Person, observation: Observation, network: CompletionModel | None = None) -> np.ndarray:
    """Seconds (N,) of every step of one wearer's tracker on an observation (T, P), after some that are not counted."""
    tracker = Tracker(person, network)
    state, taken = tracker.start(), []
    for frame in range(len(observation)):
        seen = observation[frame : frame + 1]
        begun = time.perf_counter()
        _, state = tracker.step(seen, state)
        taken.append(time.perf_counter() - begun)
    return np.array(taken[min(_WARM_UP, len(taken) // 2) :])
