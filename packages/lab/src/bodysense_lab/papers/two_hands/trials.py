"""Trials of gloves: some markers of a hand are hidden for a while; the error is measured (two-hands, section 6.2).

A trial is a stretch of motion. At first all markers are seen; then some markers are hidden until its end. The
error after 0.1 s is what it would be had they returned then, so that one trial serves all durations.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from bodysense.body.hands.glove import MARKERS, Glove, glove_points, marker_positions
from bodysense.body.hands.hand import FINGERS
from bodysense.body.hands.hand_family import GlovedHand, plain_hand, transfer_pose
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.gap_fillers import GapFiller
from bodysense.devices.gloves.hands import GloveModels, Hands, HandsSettings
from bodysense.observing.observation import Observation
from bodysense.quality.metrics import joint_error
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.synthesis.glove_stream import observed_markers
from bodysense_lab.synthesis.motion import RATE, HandMotion

HIDDEN = (1, 2, 3, 4)  # markers at once
DURATIONS = (0.1, 0.2, 0.5, 1.0, 2.0)  # s
BEFORE = 20  # frames with all markers: what the moving average looks back on
LAST = tuple(BEFORE + round(duration * RATE) - 1 for duration in DURATIONS)  # frames before markers return
FINGER_POINTS = tuple(f"{finger}{k}" for finger in FINGERS for k in ("2", "3", "_tip"))  # p1, p2 and p3 of the paper
_AT_ONCE = 400  # trials


@dataclass(frozen=True, eq=False)
class Trials:
    """H stretches of motion of T frames at 60 Hz; after its end a motion's last frame repeats."""

    gloved_hands: tuple[GlovedHand, ...]
    markers: np.ndarray  # (T, H, 9, 3) m
    points: np.ndarray  # (T, H, 21, 3) m
    turned: np.ndarray  # (T, H, 16, 4) wxyz, world ← joint
    frames: np.ndarray  # (H,) number of frames within the motion

    def __len__(self) -> int:
        return len(self.gloved_hands)

    @property
    def hands(self) -> tuple[Skeleton, ...]:
        """Their skeletons."""
        return tuple(hand.skeleton for hand in self.gloved_hands)

    @property
    def gloves(self) -> tuple[Glove, ...]:
        """Their gloves."""
        return tuple(hand.glove for hand in self.gloved_hands)

    def part(self, start: int, stop: int) -> Trials:
        """Return the trials from `start` to `stop`."""
        rows = slice(start, stop)
        of_time = (self.markers[:, rows], self.points[:, rows], self.turned[:, rows])
        return Trials(self.gloved_hands[rows], *of_time, self.frames[rows])


def together(several: Sequence[Trials]) -> Trials:
    """Concatenate trials."""
    return Trials(
        tuple(hand for part in several for hand in part.gloved_hands),
        np.concatenate([part.markers for part in several], axis=1),
        np.concatenate([part.points for part in several], axis=1),
        np.concatenate([part.turned for part in several], axis=1),
        np.concatenate([part.frames for part in several]),
    )


class HandErrors(Tallies):
    """Errors of the hands of one person, under keys; NaN, of motions that end before, is left out."""

    def __init__(self, person: str = "") -> None:
        super().__init__()
        self.person = person

    def add(self, key: tuple, errors: np.ndarray, person: str = "") -> None:
        """Add errors of any shape, by default of the person."""
        super().add(key, errors[np.isfinite(errors)], person or self.person)


def cut(
    motions: Iterable[HandMotion],
    stride: int,
    rng: np.random.Generator,
    hand: GlovedHand | None = None,
    last: Sequence[int] = LAST,
) -> Trials | None:
    """Cut a trial at every `stride` frames of every motion at 60 Hz, from a random one on; None if all are too short.

    The hands are those of the motions in default gloves, or `hand`. `last` are the frames that are scored.
    """
    length, hands = last[-1] + 1, []
    markers, points, turned, frames = [], [], [], []
    for motion in motions:
        begins = np.arange(int(rng.integers(stride)), len(motion) - last[0], stride)
        rows = np.minimum(begins + np.arange(length)[:, None], len(motion) - 1)
        gloved = plain_hand(motion.pose.skeleton) if hand is None else hand
        pose = transfer_pose(motion.pose, gloved)
        markers.append(np.asarray(marker_positions(gloved.glove, pose))[rows])
        place, turn = (np.asarray(part) for part in forward_kinematics(pose))
        points.append(place[rows])
        turned.append(turn[rows])
        frames.append(len(motion) - begins)
        hands += [gloved] * len(begins)
    if not hands:
        return None
    return Trials(
        tuple(hands),
        markers=np.concatenate(markers, axis=1),
        points=np.concatenate(points, axis=1),
        turned=np.concatenate(turned, axis=1),
        frames=np.concatenate(frames),
    )


def hide_some(trials: int, count: int | np.ndarray, rng: np.random.Generator, of: int = len(MARKERS)) -> np.ndarray:
    """Choose `count` random markers (a number, or (H, 1)) of each trial: (H, 9) bool; or of `of` other things."""
    return rng.random((trials, of)).argsort(axis=1).argsort(axis=1) < count


def marker_error(trials: Trials, hidden: np.ndarray, filler: GapFiller) -> np.ndarray:
    """Return the mean error of the markers `hidden` (H, 9) on the last frame of each duration, cm: (5, H).

    NaN if the motion ends before. `filler` is made for the hands of the trials.
    """
    state, errors = filler.start(len(trials)), []
    for frame in range(LAST[-1] + 1):
        seen = trials.markers[frame]
        if frame >= BEFORE:
            seen = np.where(hidden[..., None], np.nan, seen)
        filled, state = filler.fill(seen, 1 / RATE, state)
        if frame in LAST:
            error = joint_error(filled, trials.markers[frame])
            mean = (error * hidden).sum(axis=1) / hidden.sum(axis=1)
            errors.append(np.where(trials.frames > frame, mean, np.nan))
    return np.stack(errors)


def finger_error(trials: Trials, hidden: np.ndarray, models: GloveModels, settings: HandsSettings) -> np.ndarray:
    """Return the mean error of finger joints by the whole solver, cm: (6, H).

    On the frame before markers are hidden, and on the last of each duration. NaN where the motion ends before.
    """
    parts = [
        _finger_error(trials.part(k, k + _AT_ONCE), hidden[k : k + _AT_ONCE], models, settings)
        for k in range(0, len(trials), _AT_ONCE)
    ]
    return np.concatenate(parts, axis=1)


def _finger_error(trials: Trials, hidden: np.ndarray, models: GloveModels, settings: HandsSettings) -> np.ndarray:
    """Complete all trials at once, each as a hand of its own."""
    hands = hands_of(trials, models, settings)
    answers, _ = hands.step(observed(trials, hidden), hands.start())
    points = trials.hands[0].indices(FINGER_POINTS)
    predicted = np.stack([answers[name].position for name in hands.hands], axis=1)
    frames = [BEFORE - 1, *LAST]
    error = joint_error(predicted[frames][:, :, points], trials.points[frames][:, :, points]).mean(axis=-1)
    return np.where(trials.frames > np.array(frames)[:, None], error, np.nan)


def hands_of(trials: Trials, models: GloveModels, settings: HandsSettings) -> Hands:
    """Return the solver of all trials at once, each as a hand of its own: 'left0', 'left1' …"""
    names = [f"left{k}" for k in range(len(trials))]
    return Hands(
        dict(zip(names, trials.hands, strict=True)),
        models,
        settings,
        gloves=dict(zip(names, trials.gloves, strict=True)),
        axes=np.stack([hand.axes for hand in trials.gloved_hands]),
    )


def observed(trials: Trials, hidden: np.ndarray, before: int = BEFORE) -> Observation:
    """Return the markers of all trials, of which some (H, 9) are hidden from frame `before` on."""
    position = np.array(trials.markers)
    position[before:][:, hidden] = np.nan
    points = tuple(point for k in range(len(trials)) for point in glove_points(f"left{k}"))
    return observed_markers(points, position.reshape(len(position), -1, 3))
