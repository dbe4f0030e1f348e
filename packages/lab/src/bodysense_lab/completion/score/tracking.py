"""The tracker as the tables run it: many people in one call, or one person frame by frame for timing."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from bodysense.body.person import Person
from bodysense.observing.observation import Observation
from bodysense.takes.joining_network import JoiningNetwork, load_joining
from bodysense.takes.two_way import TwoWayTracker
from bodysense.tracking.estimate import Estimate
from bodysense.tracking.model import CompletionModel, load_completion, packaged_model
from bodysense.tracking.tracker import Tracker, TrackerSettings, step_together
from bodysense_lab.core.scoring import RATE

_WARM_UP = 30  # frames that are not timed


@dataclass(frozen=True, eq=False)
class TrackedMotion:
    """Estimates of a tracker for one person, T frames."""

    position: np.ndarray  # (T, P, 3) m, world
    rotation: np.ndarray  # (T, J, 4) wxyz, parent ← joint
    confidence: np.ndarray  # (T, P) m, expected error of each position
    bound: np.ndarray  # (T, P) m, radius that contains nine of ten errors
    contact: np.ndarray  # (T, 4) probability: left ankle and ball, right ankle and ball

    @classmethod
    def join(cls, parts: Sequence[Estimate]) -> TrackedMotion:
        """Join the estimates of consecutive frames."""
        names = {"position": "points", "confidence": "confidence", "bound": "bound", "contact": "contact"}
        joined = {name: np.concatenate([getattr(part, own) for part in parts]) for name, own in names.items()}
        return cls(rotation=np.concatenate([part.pose.rotation for part in parts]), **joined)


TrackTake = Callable[[Person, Observation], TrackedMotion]
TrackPeople = Callable[[Sequence[Person], Sequence[Observation]], list[TrackedMotion]]
StepTimes = Callable[[Person, Observation], np.ndarray]


def track_people(
    people: Sequence[Person], observations: Sequence[Observation], network: CompletionModel | None = None
) -> list[TrackedMotion]:
    """Track several people, each for the length of an observation (T, P), by a network (None: the packaged one)."""
    trackers = [Tracker(person, network) for person in people]
    states, parts = [tracker.start() for tracker in trackers], [[] for _ in people]
    for first, last in pairwise(sorted({0, *map(len, observations)})):
        tracked = [k for k, one in enumerate(observations) if len(one) > first]
        jobs = [(trackers[k], observations[k][first:last], states[k]) for k in tracked]
        for k, (estimate, state) in zip(tracked, step_together(jobs), strict=True):
            parts[k].append(estimate)
            states[k] = state
    return [TrackedMotion.join(own) for own in parts]


@dataclass(frozen=True)
class PeopleTracker:
    """`track_people` with the network of a file (None: the packaged one). When pickled, only the path is sent."""

    model: Path | None

    def __reduce__(self) -> tuple[type[PeopleTracker], tuple[Path | None]]:
        return PeopleTracker, (_absolute(self.model),)

    @property
    def network(self) -> CompletionModel:
        """The network, opened once in each process."""
        return _load_model(self.model)

    def __call__(self, people: Sequence[Person], observations: Sequence[Observation]) -> list[TrackedMotion]:
        """Track people."""
        return track_people(people, observations, self.network)


@dataclass(frozen=True)
class TakeTracker:
    """Completes whole takes with past and future, with the networks of files (None: the packaged ones).

    If only `model` is given, it is used in both directions.
    """

    model: Path | None
    backward_model: Path | None = None
    joining_model: Path | None = None

    def __reduce__(self) -> tuple[type[TakeTracker], tuple[Path | None, ...]]:
        return TakeTracker, tuple(map(_absolute, (self.model, self.backward_model, self.joining_model)))

    @property
    def networks(self) -> tuple[CompletionModel | None, CompletionModel | None, JoiningNetwork | None]:
        """Forward, backward and joining network, opened once in each process; None: the packaged one."""
        network = None if self.model is None else _load_model(self.model)
        backward = None if self.backward_model is None else _load_model(self.backward_model, backward=True)
        return network, backward, None if self.joining_model is None else _load_joining(self.joining_model)

    def __call__(self, person: Person, observation: Observation) -> TrackedMotion:
        """Complete a take (T, P) of one person."""
        network, backward, joining = self.networks
        tracker, _ = TwoWayTracker(person, network, TrackerSettings(), backward, joining).of_inferred(observation)
        return TrackedMotion.join([tracker.complete(observation, 1 / RATE)])


def _absolute(path: Path | None) -> Path | None:
    """Return the absolute path: a worker may run in another folder."""
    return None if path is None else path.resolve()


@lru_cache(maxsize=2)
def _load_model(model: Path | None, backward: bool = False) -> CompletionModel:
    return packaged_model(backward) if model is None else load_completion(model, backward)


@lru_cache(maxsize=1)
def _load_joining(model: Path) -> JoiningNetwork:
    return load_joining(model)


def step_times(person: Person, observation: Observation, network: CompletionModel | None = None) -> np.ndarray:
    """Return seconds (N,) of each step of the tracker on an observation (T, P) of one person, after a warm-up."""
    tracker = Tracker(person, network)
    state, taken = tracker.start(), []
    for frame in range(len(observation)):
        seen = observation[frame : frame + 1]
        begun = time.perf_counter()
        _, state = tracker.step(seen, state)
        taken.append(time.perf_counter() - begun)
    return np.array(taken[min(_WARM_UP, len(taken) // 2) :])
