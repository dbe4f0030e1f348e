"""The tracker: observations of people in, whole moving bodies out.

Offline, live, in tables and for batches of people the same class completes a body, with a network file and the compiled
core, which does all work between an observation and an estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isnan
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.person import Person
from bodysense.errors import BodysenseError, expect
from bodysense.observing.checks import FARTHEST, check_observation, check_order, check_shapes
from bodysense.observing.observation import RAW_POINTS, Observation
from bodysense.tracking import core
from bodysense.tracking.estimate import Estimate, TrackedPose
from bodysense.tracking.model import CompletionModel, packaged_model

if TYPE_CHECKING:
    from bodysense.observing.guard import Guard

__all__ = ["Estimate", "Tracker", "TrackerSettings", "TrackerState", "step_together"]

SHORTEST_INTERVAL, LONGEST_INTERVAL, LONGEST_EASE = 1e-4, 10.0, 10.0  # s, of settings


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of the world and of the body's motion."""

    floor: float = 0.0  # m, height of the floor
    hold_feet: bool = True  # standing feet are held still, and feet stay above the floor
    infer: bool = True  # unknown proportions and mounts of trackers are inferred from tracked points
    ease: float = 0.25  # s in which a point that is seen again is reached; 0: at once
    longest_gap: float = 1.0  # s without frames after which the motion is reset
    first_interval: float = 1 / 30  # s, assumed interval before the first frame
    longest_interval: float = 0.1  # s; longer intervals, up to `longest_gap`, count as this

    def __post_init__(self) -> None:
        if not abs(self.floor) < FARTHEST:
            raise BodysenseError(f"tracker settings: floor {self.floor:g} m; give the floor's height in metres")
        ranges = {
            "ease": (0.0, LONGEST_EASE),
            "longest_gap": (SHORTEST_INTERVAL, np.finfo(float).max),
            "first_interval": (SHORTEST_INTERVAL, LONGEST_INTERVAL),
            "longest_interval": (SHORTEST_INTERVAL, LONGEST_INTERVAL),
        }
        for name, (least, most) in ranges.items():
            if not least <= getattr(self, name) <= most:
                raise BodysenseError(
                    f"tracker settings: {name} is {getattr(self, name):g}; give {least:g} to {most:g} seconds"
                )

    @cached_property
    def struct(self) -> core.SettingsStruct:
        """The settings as a struct of the core."""
        return core.SettingsStruct(
            floor=self.floor,
            ease=self.ease,
            longest_gap=self.longest_gap,
            first=self.first_interval,
            longest=self.longest_interval,
            hold_feet=self.hold_feet,
            infer=self.infer,
        )


@dataclass(frozen=True, eq=False)
class TrackerState:
    """State of the tracker of B people between frames. Immutable."""

    people: tuple[Person, ...]  # their known properties, as given
    model: CompletionModel
    memory: tuple[np.ndarray, ...]  # B states of the core, (N,) uint8
    guards: tuple[Guard | None, ...]  # B, what was looked at of each person's world; None before the first frame

    def __repr__(self) -> str:
        times = (self.time(k) for k in range(len(self.people)))
        last = ("no frame" if np.isnan(time) else f"at {time:.4g} s" for time in times)
        return f"TrackerState({', '.join(f'{self.person(k)} {when}' for k, when in enumerate(last))})"

    def person(self, k: int = 0) -> Person:
        """Return a person as inferred so far; `Person.save` stores it for the next session."""
        return self.model.core.person(self.memory[k], self.people[k])

    def time(self, k: int = 0) -> float:
        """Return the time (s) of a person's last frame; NaN before the first."""
        return core.time_of(self.memory[k])

    def contradicts_height(self, k: int = 0) -> bool:
        """Whether the head was higher for 2 s than a person's known height allows; the height is inferred since."""
        return core.contradicts_height(self.memory[k])

    def with_people(self, people: Sequence[Person]) -> TrackerState:
        """Return the state with new known properties of the people. Evidence and motion are unchanged.

        The body in use changes gradually to the inferred one, and at once if all proportions are known. Learned mounts
        are kept if the mounts of the person are unchanged, else they are reset.
        """
        rows = zip(self.memory, people, strict=True)
        memory = tuple(self.model.core.updated(*row) for row in rows)
        return TrackerState(tuple(people), self.model, memory, self.guards)

    def to_bytes(self) -> bytes:
        """Return the state as bytes, which `Tracker.restore` reads."""
        return b"".join(memory.tobytes() for memory in self.memory)


@dataclass(frozen=True, eq=False)
class Tracker:
    """Completes the bodies of one person or of several, at any input rate. Immutable; state is an argument.

    With one `person` observations have no batch axis; with a sequence of B people they lead with an axis of B. If it
    is omitted, the tracker begins with the likeliest adult and infers the proportions. Points are joints and end sites
    by name, or 'headset', 'left_controller' and 'right_controller': raw poses of these devices.
    """

    person: Person | Sequence[Person] = field(default_factory=Person)
    network: CompletionModel | None = None  # None: the packaged one
    settings: TrackerSettings = TrackerSettings()

    def __post_init__(self) -> None:
        for person in self.people if isinstance(self.person, Sequence) else (self.person,):
            expect(person, Person, "Tracker", "a Person, such as Person(height=1.75), or a list of them")
        if not self.people:
            raise BodysenseError("tracker: no people; give at least one Person")

    def __repr__(self) -> str:
        who = repr(self.people[0]) if len(self.people) == 1 else f"{len(self.people)} people"
        return f"Tracker({who}, {'packaged network' if self.network is None else self.network.name})"

    @cached_property
    def people(self) -> tuple[Person, ...]:
        """The tracked people."""
        return (self.person,) if isinstance(self.person, Person) else tuple(self.person)

    @cached_property
    def model(self) -> CompletionModel:
        """The completion network."""
        return packaged_model() if self.network is None else self.network

    def start(self) -> TrackerState:
        """Return the state before the first frame."""
        memory = tuple(self.model.core.start(person) for person in self.people)
        return TrackerState(self.people, self.model, memory, (None,) * len(memory))

    def restore(self, stored: bytes) -> TrackerState:
        """Return the state of these people from bytes of `TrackerState.to_bytes`, possibly of another process.

        Raises BodysenseError for any other bytes, and for a state of another network or of another number of people.
        """
        size, count = self.model.core.state_size, len(self.people)
        if len(stored) != size * count:
            raise BodysenseError(
                f"tracker state: {len(stored)} bytes; a state of {count} people has {size * count} with the network "
                f"{self.model.name}: give what `to_bytes` gave, and the same people and network"
            )
        parts = [stored[k * size : (k + 1) * size] for k in range(count)]
        memory = tuple(self.model.core.opened(part) for part in parts)
        from bodysense.observing.guard import LOOKED

        guards = (None if isnan(core.time_of(part)) else LOOKED for part in memory)
        return TrackerState(self.people, self.model, memory, tuple(guards))

    def step(
        self,
        observation: Observation,
        state: TrackerState,
        *,
        out: tuple[Estimate, TrackerState] | None = None,
    ) -> tuple[Estimate, TrackerState]:
        """Complete the next T ≥ 1 frames. One call with T frames equals T calls with one frame.

        Args:
            observation: (T, P) of one person, (B, T, P) of B people.
            state: after the frames before; unchanged, unless `out` has the same one.
            out: an estimate and a state of an earlier step of this tracker, with as many frames, whose memory is
                overwritten. A live loop gives the last ones: `tracker.step(seen, state, out=(estimate, state))`.

        Raises BodysenseError if time does not increase, and for unknown points.
        """
        alone = isinstance(self.person, Person)
        expect(observation, Observation, "Tracker.step", "an Observation, such as observe(time, poses) returns")
        expect(state, TrackerState, "Tracker.step", "the state of the frame before, at first tracker.start()")
        check_shapes(observation)
        count, lead = len(self.people), observation.position.shape[:-3]
        if lead != (() if alone else (count,)):
            raise BodysenseError(
                f"observation: batch axes {lead}, but the tracker is of "
                f"{'one person: give (T, P, 3)' if alone else f'{count} people: give ({count}, T, P, 3)'}"
            )
        leading = ["position", "rotation", "has_position", "has_rotation", "accuracy"]
        leading += [] if observation.acceleration is None else ["acceleration"]
        each = [observation]
        if not alone:
            each = [replace(observation, **{of: getattr(observation, of)[k] for of in leading}) for k in range(count)]
        if not RAW_POINTS.isdisjoint(observation.points):
            each = [_joints_only(one, person) for one, person in zip(each, self.people, strict=True)]
        outputs, after = None, None
        if out is not None:
            outputs, after = out[0].memory, out[1].memory
            if outputs is None or outputs.shape != (count, len(observation.time)) or len(after) != count:
                raise BodysenseError(
                    f"tracker: out has memory of other frames or people than the observation's {len(observation)} "
                    f"frames of {count}; give an estimate and a state of an earlier step like this one"
                )
        notices, guards = _watch(each, state, self.settings.floor)
        made, memory = _step_core(self.model, self.settings, each, state.memory, outputs, after)
        estimate = _estimate(made.of_first if alone else made.arrays, made, notices)
        return estimate, TrackerState(state.people, state.model, memory, guards)


def step_together(
    jobs: Sequence[tuple[Tracker, Observation, TrackerState]],
) -> list[tuple[Estimate, TrackerState]]:
    """Complete frames of many trackers, each of one person, in one run of their common network.

    All trackers have the same network and settings, and all observations the same number of frames. The results equal
    those of `step` for each tracker. Raises BodysenseError like `step`, for the first tracker with an error.
    """
    if not jobs:
        raise BodysenseError("step_together: no jobs; give at least one")
    first = jobs[0][0]
    for _, observation, _ in jobs:
        check_shapes(observation)
    memory = [state.memory[0] for _, _, state in jobs]
    each = [_joints_only(observation, tracker.people[0]) for tracker, observation, _ in jobs]
    watched = [_watch([seen], job[2], first.settings.floor) for seen, job in zip(each, jobs, strict=True)]
    made, after = _step_core(first.model, first.settings, each, memory)
    return [
        (
            _estimate({name: values[k] for name, values in made.arrays.items()}, notices=notices),
            TrackerState(state.people, state.model, after[k : k + 1], guards),
        )
        for k, ((_, _, state), (notices, guards)) in enumerate(zip(jobs, watched, strict=True))
    ]


def _watch(
    each: Sequence[Observation], state: TrackerState, floor: float
) -> tuple[tuple[str, ...], tuple[Guard | None, ...]]:
    """Return notices about the worlds of each person's next frames, and the guards after them."""
    found: list[str] = []
    guards = list(state.guards)
    for k, (observation, memory) in enumerate(zip(each, state.memory, strict=True)):
        before, guard = core.time_of(memory), guards[k]
        if guard is None or guard.is_due(observation, before):
            from bodysense.observing.guard import Guard, watch

            notices, guards[k] = watch(guard or Guard(), observation, before, floor)
            found += notices
    return tuple(dict.fromkeys(found)), tuple(guards)


def _step_core(
    model: CompletionModel,
    settings: TrackerSettings,
    observations: Sequence[Observation],
    memory: Sequence[np.ndarray],
    outputs: core.Outputs | None = None,
    states: tuple[np.ndarray, ...] | None = None,
) -> tuple[core.Outputs, tuple[np.ndarray, ...]]:
    """Return estimates and the states of B people after T frames each, in `outputs` and `states` if given."""
    result, k, made, after = model.core.step(settings.struct, observations, memory, outputs, states)
    if result != core.OK:
        # The core reports a person and a reason; the checks of the observation find point and frame.
        check_observation(observations[k])
        if result == core.TIME_DISORDERED:
            check_order(observations[k].time[0], core.time_of(memory[k]), "tracker")
        raise BodysenseError(f"tracker: {core.message(result)}")
    return made, after


def _joints_only(observation: Observation, person: Person) -> Observation:
    """Convert raw poses of devices, if there are any, to the joints that carry them."""
    if RAW_POINTS.isdisjoint(observation.points):
        return observation
    from bodysense.observing.raw_poses import with_joints

    return with_joints(observation, person.skeleton)


def _estimate(
    made: dict[str, np.ndarray], memory: core.Outputs | None = None, notices: tuple[str, ...] = ()
) -> Estimate:
    """Return an estimate of the core's arrays; `memory` is theirs if a step may reuse it."""
    offset = made["rest_offset"]
    last = offset.reshape(-1, *offset.shape[-3:])[0, -1] if offset.ndim > 3 else offset[-1]
    return Estimate(
        pose=TrackedPose.of(last, made["root_position"], made["rotation"]),
        points=made["points"],
        measured=made["measured"],
        confidence=made["confidence"],
        bound=made["bound"],
        contact=made["contact"],
        rest_offset=offset,
        memory=memory,
        notices=notices,
    )
