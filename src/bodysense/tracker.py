"""The tracker: observations of people in, whole moving bodies out. The one thing that completes a body.

Offline, live, in tables and for many people at once it is this class and one network file. It keeps the books: times,
who the people are and what has been learned of their proportions, how their trackers are worn. Everything else of a
step is inside the network's graph.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.completion.clock import Clock
from bodysense.completion.inputs import Frames, frames_of, frames_together
from bodysense.completion.model import Completed, CompletionModel, packaged_model
from bodysense.completion.mounts import Mounts, mounts_of
from bodysense.completion.proportions import Proportions, proportions_of
from bodysense.completion.refinement import refined
from bodysense.errors import BodysenseError
from bodysense.observation import Estimate, Observation

__all__ = ["Estimate", "Tracker", "TrackerSettings", "TrackerState", "step_together"]


@dataclass(frozen=True)
class TrackerSettings:
    """What the world is like and what the body keeps to."""

    floor: float = 0.0  # m, height of the floor
    hold_feet: bool = True  # feet that stand are held, and none is under the floor
    infer: bool = True  # what was not told of the person, and how trackers are worn, is inferred from what is tracked
    refine: bool = (
        False  # measured points between head, hands and feet are met exactly, at the cost of inverse kinematics
    )
    clock: Clock = Clock()

    def __post_init__(self) -> None:
        if not abs(self.floor) < 1000:
            raise BodysenseError(f"tracker settings: floor {self.floor:g} m; give the floor's height in metres")


@dataclass(frozen=True, eq=False)
class TrackerState:
    """Everything that the next frame of B people depends on."""

    time: np.ndarray  # (B,) s of the frame before; NaN before the first
    network: dict[str, np.ndarray]  # (B, …) by input of the graph
    proportions: Proportions
    mounts: Mounts

    def person(self, k: int = 0) -> Person:
        """A person as believed now: a guess that `Person.save` keeps for the next time."""
        return self.proportions.person(k, self.mounts.person(k))


@dataclass(frozen=True, eq=False)
class Tracker:
    """Completes the bodies of one person or of several, at any input rate. Immutable; state is an argument.

    With one `person` observations have no batch axis; with a sequence of B they lead with one of B. Without any, the
    likeliest adult is taken, and proportions are inferred while the tracker runs.
    """

    person: Person | Sequence[Person] = Person()
    network: CompletionModel | None = None  # None: the packaged one
    settings: TrackerSettings = TrackerSettings()

    @cached_property
    def people(self) -> tuple[Person, ...]:
        """Who is tracked."""
        return (self.person,) if isinstance(self.person, Person) else tuple(self.person)

    @cached_property
    def model(self) -> CompletionModel:
        """The network that completes."""
        return packaged_model() if self.network is None else self.network

    def start(self) -> TrackerState:
        """The state before the first frame."""
        count = len(self.people)
        return TrackerState(
            np.full(count, np.nan), self.model.start(count), proportions_of(self.people), mounts_of(self.people)
        )

    def step(self, observation: Observation, state: TrackerState) -> tuple[Estimate, TrackerState]:
        """Complete the next T ≥ 1 frames; one call with T frames equals T calls with one.

        Raises BodysenseError when time does not increase, and for points that no body has.
        """
        alone = isinstance(self.person, Person)
        frames = frames_of(observation, self.people, batched=not alone)
        done: list[tuple[Completed, Frames, TrackerState]] = []
        for t in range(len(frames)):
            completed, state = _stepped(self.model, self.settings, frames[t], state)
            done.append((completed, frames[t], state))
        whole = _estimate(done)
        return (whole.of(0) if alone else whole), state


def step_together(
    jobs: Sequence[tuple[Tracker, Observation, TrackerState]],
) -> list[tuple[Estimate, TrackerState]]:
    """Complete one frame each of many trackers of one person, which share a network and settings, in one run.

    Each gets what its own `step` gives. Raises BodysenseError as `step` does, for the first that it concerns.
    """
    if len(jobs) == 1:
        tracker, observation, state = jobs[0]
        return [tracker.step(observation, state)]
    first = jobs[0][0]
    frame = frames_together([observation for _, observation, _ in jobs], [tracker.people[0] for tracker, _, _ in jobs])
    before = _stacked([state for _, _, state in jobs])
    completed, after = _stepped(first.model, first.settings, frame, before)
    whole = _estimate([(completed, frame, after)])
    return [(whole.of(k), _alone(after, k)) for k in range(len(jobs))]


def _stepped(
    model: CompletionModel,
    settings: TrackerSettings,
    frame: Frames,
    state: TrackerState,
) -> tuple[Completed, TrackerState]:
    """One frame of B people."""
    interval, fresh = settings.clock.interval(frame.time, state.time)
    network, proportions, mounts = state.network, state.proportions, state.mounts
    if fresh.any():  # after a gap nothing that moved is remembered; who the person is stays known
        start = model.start(len(fresh))
        network = {
            name: np.where(fresh.reshape(-1, *[1] * (values.ndim - 1)), start[name], values)
            for name, values in network.items()
        }
    if settings.infer:
        mounts = mounts.updated(frame, interval)
        frame = mounts.applied(frame)
        proportions = proportions.updated(frame, interval, settings.floor)
    completed, network = model.step(frame, interval, proportions, settings.floor, settings.hold_feet, network)
    if settings.refine:
        completed = refined(completed, frame, proportions.rest_offset)
    return completed, TrackerState(frame.time, network, proportions, mounts)


def _estimate(frames: Sequence[tuple[Completed, Frames, TrackerState]]) -> Estimate:
    """Estimates of T frames of B people, from what was completed, tracked and believed in each."""

    def by_person(values: Sequence[np.ndarray]) -> np.ndarray:
        return np.stack(values, axis=1) if len(values) > 1 else values[0][:, None]

    offset = by_person([state.proportions.rest_offset for _, _, state in frames])
    pose = Pose(
        default_skeleton().with_offsets(offset[0, -1]),
        by_person([body.root_position for body, _, _ in frames]).astype(np.float64),
        by_person([body.rotation for body, _, _ in frames]).astype(np.float64),
    )
    return Estimate(
        pose=pose,
        points=by_person([body.points for body, _, _ in frames]).astype(np.float64),
        measured=by_person([frame.has_position for _, frame, _ in frames]),
        confidence=by_person([body.confidence for body, _, _ in frames]).astype(np.float64),
        bound=by_person([body.bound for body, _, _ in frames]).astype(np.float64),
        contact=by_person([body.contact for body, _, _ in frames]).astype(np.float64),
        rest_offset=offset,
    )


def _stacked(states: Sequence[TrackerState]) -> TrackerState:
    """States of several people as one of all of them."""
    return TrackerState(
        np.concatenate([state.time for state in states]),
        {name: np.concatenate([state.network[name] for state in states]) for name in states[0].network},
        Proportions.stacked([state.proportions for state in states]),
        Mounts.stacked([state.mounts for state in states]),
    )


def _alone(state: TrackerState, k: int) -> TrackerState:
    """The state of one of several people."""
    own = slice(k, k + 1)
    return TrackerState(
        state.time[own],
        {name: values[own] for name, values in state.network.items()},
        state.proportions.alone(k),
        state.mounts.alone(k),
    )
