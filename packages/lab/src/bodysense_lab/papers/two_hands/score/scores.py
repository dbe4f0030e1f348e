"""Errors of a glove's hidden markers and of finger joints (two-hands, section 6.2)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.hand import FINGERS
from bodysense.body.hands.hand_family import draw_hand
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.devices.gloves.gap_fillers import NetworkGapFiller, RigidGapFiller
from bodysense.devices.gloves.hands import HandsSettings, load_glove_models
from bodysense.devices.gloves.networks import load_marker_network
from bodysense.parallel import parallel_map
from bodysense.quality.metrics import joint_error
from bodysense_lab.core.scoring import GROUPS, Tally, group_of
from bodysense_lab.data.datasets import Census, DataSet, census_of
from bodysense_lab.papers.two_hands.score.baselines import (
    AffineCombination,
    FingerLimits,
    LastKnown,
    MovingAverage,
    solve_fingers,
)
from bodysense_lab.papers.two_hands.score.foreign import ForeignModels, foreign_fingers, foreign_markers
from bodysense_lab.papers.two_hands.score.hand_pairs import SYNTHESISED
from bodysense_lab.papers.two_hands.trials import (
    DURATIONS,
    FINGER_POINTS,
    HIDDEN,
    HandErrors,
    Trials,
    cut,
    finger_error,
    hide_some,
    marker_error,
    together,
)
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import HandMotion, hand_motions

SEEDS = 5


class HandTask(NamedTuple):
    """Motions that are scored together, and their group."""

    motions: list[HandMotion]
    group: str  # of categories
    person: str = ""  # of the motions, if known


# Trials have no wrong markers, and each has one hand, so that no contact is possible.
ALONE = HandsSettings(rejection=None)
FOREIGN_STRIDE = 60  # frames from one trial to the next, on unseen hands
STRIDE = 30  # frames at 60 Hz from one trial to the next, at each seed from another one on
SYNTHETIC_SECONDS, SYNTHETIC_SEED = 12.0, 2019


@dataclass(frozen=True)
class GloveTable:
    """Measured means in cm under (group, method, hidden, duration)."""

    means: HandErrors
    census: Census
    data: DataSet | None  # None: synthesised motion alone
    synthesised: int  # hands

    @property
    def groups(self) -> list[str]:
        """Groups that have figures, first the one whose keys have no suffix."""
        return [group for group in (*GROUPS, SYNTHESISED) if any(key[0] == group for key in self.means)]

    def get(self, method: str, hidden: int, duration: float, group: str | None = None) -> float:
        """Return one cell, cm, by default of the main group."""
        return self.means.mean(group or self.groups[0], method, hidden, duration)

    def tally(self, method: str, hidden: int, duration: float, group: str | None = None) -> Tally:
        """Return one cell with its shares by person, by default of the main group."""
        return self.means[group or self.groups[0], method, hidden, duration]

    def suffix(self, group: str) -> str:
        """Return the suffix of the group's keys."""
        return "" if group == self.groups[0] else f"_{group}"


def measure(
    work: Callable[[HandTask], HandErrors],
    data: DataSet | None,
    synthesised: int,
    jobs: int,
    advance: Callable[[], None],
    by_person: bool = False,
) -> GloveTable:
    """Measure every clip of `data` with fingers and `synthesised` synthesised hands, in `jobs` processes.

    `by_person` gives all motions of a person to `work` at once.
    """
    means, census = HandErrors(), Census()

    def tasks() -> Iterator[HandTask]:
        nonlocal census
        for clip in data.clips() if data is not None else ():
            if clip.has_fingers:
                census += census_of(clip)
                yield HandTask(list(hand_motions([clip])), group_of(clip), clip.person)
            else:
                advance()
        for number in range(synthesised):
            yield HandTask([synthetic_hand(number)], SYNTHESISED, f"hand {number}")

    for _, part in parallel_map(work, _of_people(tasks()) if by_person else tasks(), jobs):
        means.merge(part)
        advance()
    return GloveTable(means, census, data, synthesised)


def _of_people(tasks: Iterator[HandTask]) -> Iterator[HandTask]:
    """Join the tasks of each person and group."""
    joined: dict[tuple[str, str], list[HandMotion]] = {}
    for motions, group, person in tasks:
        joined.setdefault((group, person), []).extend(motions)
    return (HandTask(motions, group, person) for (group, person), motions in joined.items())


def synthetic_hand(number: int) -> HandMotion:
    """Return a synthesised hand, drawn with a seed that no training uses."""
    rng = np.random.default_rng([SYNTHETIC_SEED, number])
    return synthesize_hand(draw_hand(rng).skeleton, SYNTHETIC_SECONDS, rng)


def measure_markers(
    task: HandTask, model: Path | None = None, stride: int = STRIDE, left_out: Path | None = None
) -> HandErrors:
    """Measure errors of hidden markers for Table 3, cm, under (group, method, hidden, duration)."""
    motions, group, person = task
    network, means = load_marker_network(model), HandErrors(person)
    for trials, count, hidden in _all_trials(motions, stride):
        fillers = {
            "lk": LastKnown(),
            "ls": RigidGapFiller(np.zeros((1, 9, 3))),  # its natural shape is not needed: five markers are seen
            "ma": MovingAverage(),
            "ac": AffineCombination(),
            "nn": NetworkGapFiller(network, trials.hands),
        }
        for method, filler in fillers.items():
            for duration, error in zip(DURATIONS, marker_error(trials, hidden, filler), strict=True):
                means.add((group, method, count, duration), error)
    if group == GROUPS[0]:
        means.merge(foreign_markers(motions, person, ForeignModels(model, left_out=left_out), FOREIGN_STRIDE))
    return means


def measure_fingers(
    task: HandTask,
    markers: Path | None = None,
    joints: Path | None = None,
    stride: int = STRIDE,
    left_out: Path | None = None,
) -> HandErrors:
    """Measure errors of finger joints for Table 4, cm, under (group, method, hidden, duration)."""
    motions, group, person = task
    models, means = load_glove_models(markers, joints), HandErrors(person)
    for method, limits in (("ik", None), ("ik_tuned", FingerLimits())):
        for motion in motions:
            means.add((group, method, 0, 0.0), descent_error(motion, limits, stride))
    for trials, count, hidden in _all_trials(motions, stride):
        still, *errors = finger_error(trials, hidden, models, ALONE)
        means.add((group, "nn", 0, 0.0), still)
        for duration, error in zip(DURATIONS, errors, strict=True):
            means.add((group, "nn", count, duration), error)
    if group == GROUPS[0]:
        foreign = ForeignModels(markers, joints, left_out)
        means.merge(foreign_fingers(motions, person, foreign, ALONE, FOREIGN_STRIDE))
    return means


def _all_trials(motions: list[HandMotion], stride: int) -> Iterator[tuple[Trials, int, np.ndarray]]:
    """Yield the trials of all seeds, the number of hidden markers, and which (H, 9); nothing if too short."""
    generators = [np.random.default_rng(seed) for seed in range(SEEDS)]
    parts = [(rng, trials) for rng in generators if (trials := cut(motions, stride, rng)) is not None]
    if not parts:
        return
    every = together([trials for _, trials in parts])
    for count in HIDDEN:
        yield every, count, np.concatenate([hide_some(len(trials), count, rng) for rng, trials in parts])


def descent_error(motion: HandMotion, limits: FingerLimits | None, stride: int) -> np.ndarray:
    """Return errors (n,) cm of finger joints by inverse kinematics, at every `stride` frames, nothing hidden."""
    pose = motion.pose[::stride]
    rotation = np.array(pose.rotation)
    rotation[:, 0] = [1.0, 0.0, 0.0, 0.0]
    true, _ = forward_kinematics(Pose(pose.skeleton, np.zeros_like(pose.root_position), rotation))
    tips, points = (pose.skeleton.indices(names) for names in ([f"{finger}_tip" for finger in FINGERS], FINGER_POINTS))
    solved = solve_fingers(pose.skeleton, true[:, tips], limits)
    return joint_error(solved[:, points], true[:, points]).mean(axis=-1)
