"""How completed motion is scored: errors by part of the body, share of joints and kind of motion, beside last known.

The baseline without a network: a hidden point stays where it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.rotation import heading, quaternion_conjugate, quaternion_rotate
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.intervals import Interval, Named, Shares, interval
from bodysense.io.clip import Clip
from bodysense.metrics import joint_error
from bodysense.observation import Observation, observed_points


@dataclass(frozen=True)
class HoldState:
    """The last known place of every point, in the frame in which it is kept."""

    place: np.ndarray  # (P, 3) m
    seen: np.ndarray  # (P,) bool, whether ever
    head_position: np.ndarray  # (3,) m, world
    head_heading: np.ndarray  # (4,) wxyz


@dataclass(frozen=True)
class Hold:
    """Last known position.

    Kept in the world, with the head in the world's axes ('head', as in UNOC), or turning with the head's heading.

    Fingers are kept relative to their wrist, in the same axes. A point that was never seen is where a standing body
    under the head has it.
    """

    skeleton: Skeleton
    frame: Literal["world", "head", "heading"] = "heading"

    @cached_property
    def _origin(self) -> np.ndarray:
        """(P,) the point that each one is kept relative to: the wrist for fingers, itself where none."""
        wrist = self.skeleton.wrist_of
        return np.where(wrist >= 0, wrist, np.arange(len(wrist)))

    @cached_property
    def _standing(self) -> np.ndarray:
        """(P, 3) where points stand relative to the head, fingers relative to their wrist."""
        position, _ = forward_kinematics(standing_pose(self.skeleton))
        return np.where(self._is_finger, position - position[self._origin], position - position[self._head])

    @cached_property
    def _is_finger(self) -> np.ndarray:
        return (self.skeleton.wrist_of >= 0)[:, None]

    @cached_property
    def _head(self) -> int:
        return self.skeleton.index("head")

    def start(self) -> HoldState:
        """Nothing seen yet: a standing body that faces +Z."""
        count = len(self.skeleton.points)
        standing, _ = forward_kinematics(standing_pose(self.skeleton))
        return HoldState(
            place=np.zeros((count, 3)),
            seen=np.zeros(count, dtype=bool),
            head_position=standing[self._head],
            head_heading=np.array([1.0, 0.0, 0.0, 0.0]),
        )

    def step(self, observation: Observation, state: HoldState) -> tuple[PointEstimate, HoldState]:
        """Complete T frames, one after the other."""
        position, rotation, has_position, has_rotation = observed_points(observation, self.skeleton)
        turned = np.where(has_rotation[:, self._head, None], rotation[:, self._head], [1.0, 0.0, 0.0, 0.0])
        head = _held(position[:, self._head], has_position[:, self._head], state.head_position)
        turn = _held(np.asarray(heading(turned)), has_rotation[:, self._head], state.head_heading)
        axes = turn[:, None] if self.frame == "heading" else np.array([1.0, 0.0, 0.0, 0.0])
        middle = np.where(self._is_finger, 0.0, head[:, None])  # of points that are kept with the head
        origin = np.zeros(3) if self.frame == "world" else middle
        base = np.where(self._is_finger, position[:, self._origin], origin)
        measured = has_position & has_position[:, self._origin]
        place = _held(quaternion_rotate(quaternion_conjugate(axes), position - base), measured, state.place)
        seen = np.logical_or.accumulate(np.concatenate([state.seen[None], measured]))[1:]
        standing = quaternion_rotate(turn[:, None], self._standing) + middle
        guess = np.where(seen[..., None], quaternion_rotate(axes, place) + origin, standing)
        now = np.where(has_position[..., None], position, guess)
        # Fingers hang on the wrist that is output, measured or kept.
        hanging = self._is_finger & ~has_position[..., None]
        estimate = PointEstimate(
            skeleton=self.skeleton,
            position=np.where(hanging, guess + now[:, self._origin], now),
            occluded=(~has_position).astype(float),
            confidence=np.where(has_position, 0.0, 0.1),
        )
        return estimate, HoldState(place[-1], seen[-1], head[-1], turn[-1])


def _held(values: np.ndarray, known: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Return values (T, …, D) in which those that are not known (T, …) are the last known ones, before them `first`."""
    frame = np.arange(len(values)).reshape(-1, *[1] * (known.ndim - 1))
    last = np.maximum.accumulate(np.where(known, frame, -1))[..., None]
    return np.where(last >= 0, np.take_along_axis(values, np.maximum(last, 0), axis=0), first)


RATE = 30.0
KNOWN: tuple[Literal["world", "head", "heading"], ...] = (
    "world",
    "head",
    "heading",
)  # frames of the last-known baselines
MAIN = ("sit", "talk_gesture", "conversation", "everyday", "locomotion")  # what a headset's wearer does
# Scored joints of both sides.
UNOC_EVAL_JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")
GROUPS = ("main", "sport", "dance", "other")  # the categories that are scored together


Measure = Literal["mpjpe", "rmsjpe"]


@dataclass
class Tally:
    """Running sums of errors (cm), so that averages are over frames, not over clips; and the same by person."""

    count: float = 0.0
    total: float = 0.0
    squared: float = 0.0
    people: dict[str, Tally] = field(default_factory=dict, repr=False)

    def add(self, error: np.ndarray, person: str = "") -> None:
        """Count errors of any shape; whose they are, where that is known."""
        one = Tally(error.size, float(error.sum()), float((error * error).sum()))
        self.merge(replace(one, people={person: one}) if person else one)

    def merge(self, other: Tally) -> None:
        """Count what another has counted."""
        self.count += other.count
        self.total += other.total
        self.squared += other.squared
        for person, one in other.people.items():
            self.people.setdefault(person, Tally()).merge(one)

    def shares(self, measure: Measure = "mpjpe") -> Shares:
        """By person: the mean (of RMSJPE its square) and its weight."""
        people = {person: one for person, one in self.people.items() if one.count}
        return {
            person: ((one.total if measure == "mpjpe" else one.squared) / one.count, one.count)
            for person, one in people.items()
        }

    def named(self, name: str, measure: Measure = "mpjpe") -> Named:
        """A figure under a name, to be compared."""
        return Named(name, getattr(self, measure), self.shares(measure))

    def interval(self, measure: Measure = "mpjpe") -> Interval:
        """Between what a figure lies, by bootstrap over people."""
        found = interval(self.shares(measure))
        if measure == "mpjpe":
            return found
        return Interval(math.sqrt(found.value), math.sqrt(found.low), math.sqrt(found.high))

    @property
    def mpjpe(self) -> float:
        """Mean, cm."""
        return self.total / self.count if self.count else math.nan

    @property
    def rmsjpe(self) -> float:
        """Root of the mean square, cm."""
        return math.sqrt(self.squared / self.count) if self.count else math.nan


@dataclass(frozen=True, eq=False)
class TrackedClip:
    """A clip, what the headset saw of it, and what every method made of that."""

    clip: Clip  # the truth, at 30 Hz
    observation: Observation
    pose: Pose  # of the tracker
    position: dict[str, np.ndarray]  # method → (T, P, 3) m


def last_known(observation: Observation, skeleton: Skeleton) -> dict[str, np.ndarray]:
    """The baselines: the frame of `KNOWN` in which hidden points stay → (T, P, 3) m, world."""
    holds = {frame: Hold(skeleton, frame) for frame in KNOWN}
    return {frame: hold.step(observation, hold.start())[0].position for frame, hold in holds.items()}


def part_errors(
    position: np.ndarray, truth: np.ndarray, skeleton: Skeleton, fingers: bool
) -> dict[str, tuple[np.ndarray, list[int]]]:
    """Errors (T, N), cm, of every part of the body, and which N points it has: positions (T, P, 3) m in one frame.

    Fingers are measured from their wrist, except in parts that include the body. Without fingers, these parts are
    omitted.
    """
    finger, tested = np.flatnonzero(skeleton.wrist_of >= 0).tolist(), scored_points(skeleton)
    wrist = skeleton.wrist_of[finger]
    every = [p for p, name in enumerate(skeleton.points) if p not in finger and name != "head"]
    error = joint_error(position, truth)
    parts = {"body": (error[:, tested], tested), "every_point": (error[:, every], every)}
    if fingers:
        local = joint_error(position[:, finger] - position[:, wrist], truth[:, finger] - truth[:, wrist])
        both = tested + finger
        parts |= {"finger": (local, finger), "body_and_finger": (error[:, both], both)}
    return parts


def scored_points(skeleton: Skeleton) -> list[int]:
    """The points that UNOC's tables test, of either side."""
    return [p for p, name in enumerate(skeleton.points) if name.partition("_")[2] in UNOC_EVAL_JOINTS]


def group_of(clip: Clip) -> str:
    """The one of `GROUPS` with which a clip is scored."""
    return group_named(clip.category)


def group_named(category: str) -> str:
    """The one of `GROUPS` with which clips of a category are scored."""
    return "main" if category in (*MAIN, "") else category if category in GROUPS else "other"
