"""The pipeline of a session: glove solver and tracker. Many sessions are stepped in one run of the network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from bodysense.body.hands.hand import glove_hands
from bodysense.body.hands.hand_family import GlovedHand
from bodysense.body.person import Person
from bodysense.body.skeleton import Skeleton
from bodysense.observing.observation import Observation
from bodysense.observing.points import without_gloves
from bodysense.tracking.estimate import Estimate
from bodysense.tracking.tracker import Tracker, TrackerSettings, TrackerState, step_together


class PointSolver(Protocol):
    """A solver that converts measurements to points of a skeleton, as the glove solver does with markers."""

    def start(self) -> Any:
        """The state before the first frame."""
        ...

    def step(self, observation: Observation, state: Any) -> tuple[Observation, Any]:
        """Return the frames with points that a tracker takes, and the state after them."""
        ...


@dataclass(frozen=True, eq=False)
class PipelineState:
    """The state of a pipeline between frames."""

    tracker: TrackerState
    device: Any = None


@dataclass(frozen=True, eq=False)
class Pipeline:
    """The pipeline from one person's signal to the body. Immutable; state is an argument."""

    tracker: Tracker
    device: PointSolver | None = None  # None: the signal has no glove markers

    def start(self) -> PipelineState:
        """The state before the first frame."""
        return PipelineState(self.tracker.start(), None if self.device is None else self.device.start())

    def continued(self, before: Pipeline, state: PipelineState) -> PipelineState:
        """Return the state with which this pipeline continues a motion of the pipeline `before`, of the same person."""
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
    """Return the packaged networks of gloves, loaded once."""
    from bodysense.devices.gloves.hands import load_glove_models

    return load_glove_models()


class WithoutMarkers:
    """A solver that drops the markers of gloves."""

    def start(self) -> None:
        """Return None: this solver has no state."""

    def step(self, observation: Observation, state: None) -> tuple[Observation, None]:
        """Return the frames without markers."""
        return without_gloves(observation), state


def device_of(points: Sequence[str], skeleton: Skeleton, calibrated: Mapping[str, GlovedHand]) -> PointSolver | None:
    """Return the solver for a signal of these points; None without gloves."""
    hands = glove_hands(points)
    if not hands:
        return None
    from bodysense.devices.gloves.device import SIDES, check_calibrated, glove_device, gloved_sides

    if not any(side in hands for side in SIDES):
        return WithoutMarkers()
    check_calibrated(points, gloved_sides(points), calibrated)
    return glove_device(skeleton, gloved_sides(points), _glove_models(), calibrated=calibrated)


def step_many(jobs: Sequence[tuple[Pipeline, Observation, PipelineState]]) -> list[tuple[Estimate, PipelineState]]:
    """Complete one frame of each session. Sessions with equal settings share one run of the network."""
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
    """Load and run the network once, so that a first frame does not wait for it."""
    pipeline = Pipeline(Tracker(Person()))
    frame = Observation.from_arrays({"head": np.full((1, 3), np.nan)})
    for sessions in (1, 2):
        step_many([(pipeline, frame, pipeline.start())] * sessions)
