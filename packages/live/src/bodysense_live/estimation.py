"""The pipeline of a session: gloves' solver and tracker; many sessions are stepped in one run of the network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from bodysense.body.hand import glove_hands
from bodysense.body.hand_family import GlovedHand
from bodysense.body.person import Person
from bodysense.body.skeleton import Skeleton
from bodysense.estimate import Estimate
from bodysense.observation import Observation, without_gloves
from bodysense.tracker import Tracker, TrackerSettings, TrackerState, step_together


class PointSolver(Protocol):
    """Turns what a sensor measures into points of a skeleton, as a glove's solver does with markers."""

    def start(self) -> Any:
        """The state before the first frame."""
        ...

    def step(self, observation: Observation, state: Any) -> tuple[Observation, Any]:
        """Return the frames with points that a tracker takes, and the state after them."""
        ...


@dataclass(frozen=True, eq=False)
class PipelineState:
    """Everything that the next frame of a session depends on."""

    tracker: TrackerState
    device: Any = None


@dataclass(frozen=True, eq=False)
class Pipeline:
    """From one person's signal to their body. Immutable; state is an argument."""

    tracker: Tracker
    device: PointSolver | None = None  # None: the points of the signal are a tracker's already

    def start(self) -> PipelineState:
        """The state before the first frame."""
        return PipelineState(self.tracker.start(), None if self.device is None else self.device.start())

    def continued(self, before: Pipeline, state: PipelineState) -> PipelineState:
        """The state in which this pipeline goes on from where another one of the same person was."""
        tracker, people = state.tracker, self.tracker.people
        if people != before.tracker.people:
            tracker = tracker.with_people(people)
        if self.device is before.device:
            return PipelineState(tracker, state.device)
        return PipelineState(tracker, None if self.device is None else self.device.start())

    def step(self, observation: Observation, state: PipelineState) -> tuple[Estimate, PipelineState]:
        """Complete one frame."""
        return step_many([(self, observation, state)])[0]


@lru_cache(maxsize=1)
def _glove_models() -> Any:
    """The packaged networks of gloves, loaded once."""
    from bodysense.devices.gloves.hands import load_glove_models

    return load_glove_models()


class WithoutMarkers:
    """Leaves the markers of gloves out."""

    def start(self) -> None:
        """Nothing is remembered."""

    def step(self, observation: Observation, state: None) -> tuple[Observation, None]:
        """Return the frames without markers."""
        return without_gloves(observation), state


def device_of(points: Sequence[str], skeleton: Skeleton, calibrated: Mapping[str, GlovedHand]) -> PointSolver | None:
    """Return the solver that a signal of these points needs before a tracker takes it; None without gloves."""
    hands = glove_hands(points)
    if not hands:
        return None
    from bodysense.devices.gloves.device import SIDES, check_calibrated, glove_device, gloved_sides

    if not any(side in hands for side in SIDES):
        return WithoutMarkers()
    check_calibrated(points, gloved_sides(points), calibrated)
    return glove_device(skeleton, gloved_sides(points), _glove_models(), calibrated=calibrated)


def step_many(jobs: Sequence[tuple[Pipeline, Observation, PipelineState]]) -> list[tuple[Estimate, PipelineState]]:
    """Complete one frame of each of many sessions; those with equal settings in one run of the network."""
    seen: list[tuple[Observation, Any]] = []
    for pipeline, observation, state in jobs:
        device = pipeline.device
        seen.append((observation, None) if device is None else device.step(observation, state.device))
    alike: dict[TrackerSettings, list[int]] = {}
    for k, (pipeline, _, _) in enumerate(jobs):
        alike.setdefault(pipeline.tracker.settings, []).append(k)
    found: dict[int, tuple[Estimate, PipelineState]] = {}
    for those in alike.values():
        done = step_together([(jobs[k][0].tracker, seen[k][0], jobs[k][2].tracker) for k in those])
        found |= {
            k: (estimate, PipelineState(state, seen[k][1])) for k, (estimate, state) in zip(those, done, strict=True)
        }
    return [found[k] for k in range(len(jobs))]


def load() -> None:
    """Load and run the network once, so that no wearer's first frame waits for it."""
    pipeline = Pipeline(Tracker(Person()))
    frame = Observation.from_arrays({"head": np.full((1, 3), np.nan)})
    for sessions in (1, 2):
        step_many([(pipeline, frame, pipeline.start())] * sessions)
