"""Scores of completed motion: errors by part of the body and kind of motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.io.clip import Clip
from bodysense.observing.observation import Observation
from bodysense.quality.metrics import joint_error
from bodysense_lab.core.intervals import Interval, NamedFigure, Shares, interval

RATE = 30.0  # Hz at which motion is scored
MAIN = ("sit", "talk_gesture", "conversation", "everyday", "locomotion")  # categories typical of headset wearers
# Scored joints of both sides.
UNOC_EVAL_JOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")
GROUPS = ("main", "sport", "dance", "other")  # groups of categories that are scored together


Measure = Literal["mpjpe", "rmsjpe"]


@dataclass
class Tally:
    """Running sums of errors in cm, in all and by person; averages are over frames, not over clips."""

    count: float = 0.0
    total: float = 0.0
    squared: float = 0.0
    people: dict[str, Tally] = field(default_factory=dict, repr=False)

    def add(self, error: np.ndarray, person: str = "") -> None:
        """Add errors (any shape), of a person if known."""
        one = Tally(error.size, float(error.sum()), float((error * error).sum()))
        self.merge(replace(one, people={person: one}) if person else one)

    def merge(self, other: Tally) -> None:
        """Add the errors of another tally."""
        self.count += other.count
        self.total += other.total
        self.squared += other.squared
        for person, one in other.people.items():
            self.people.setdefault(person, Tally()).merge(one)

    def shares(self, measure: Measure = "mpjpe") -> Shares:
        """Return the mean (for RMSJPE the mean square) and its weight by person."""
        people = {person: one for person, one in self.people.items() if one.count}
        return {
            person: ((one.total if measure == "mpjpe" else one.squared) / one.count, one.count)
            for person, one in people.items()
        }

    def named(self, name: str, measure: Measure = "mpjpe") -> NamedFigure:
        """Return a figure under a name, for comparisons."""
        return NamedFigure(name, getattr(self, measure), self.shares(measure))

    def interval(self, measure: Measure = "mpjpe") -> Interval:
        """Return a figure and its confidence interval, by bootstrap over people."""
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
    """A clip, its observation by a headset, and its completions."""

    clip: Clip  # the truth, at 30 Hz
    observation: Observation
    position: dict[str, np.ndarray]  # (T, P, 3) m by method


def part_errors(
    position: np.ndarray, truth: np.ndarray, skeleton: Skeleton, fingers: bool
) -> dict[str, tuple[np.ndarray, list[int]]]:
    """Return errors (T, N) in cm of every part of the body, and the indices of its N points.

    Both positions (T, P, 3) in m are in the same axes. Fingers are measured from their wrist, except in parts that
    include the body. Without fingers, these parts are omitted.
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
    """Return the indices of the points that UNOC's tables test, of both sides."""
    return [p for p, name in enumerate(skeleton.points) if name.partition("_")[2] in UNOC_EVAL_JOINTS]


def group_of(clip: Clip) -> str:
    """Return the group of `GROUPS` in which a clip is scored."""
    return group_named(clip.category)


def group_named(category: str) -> str:
    """Return the group of `GROUPS` in which clips of a category are scored."""
    return "main" if category in (*MAIN, "") else category if category in GROUPS else "other"


def suffix_of(group: str) -> str:
    """Return the end of the keys of a group of categories."""
    return "" if group == "main" else f"_{group}"
