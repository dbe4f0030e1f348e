"""What a detector of key-points does to what a camera sees: jitter, drift, motion blur, missed and swapped hands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.keypoints import ArmKeypoints
from bodysense.body.rotation import normalize, quaternion_exp, quaternion_multiply

Errors = Callable[[tuple[int, ...], float, float], np.ndarray]
_SWAP = 0.3  # s that a swap lasts on average


@dataclass(frozen=True)
class DetectorNoise:
    """How a detector errs. Angles in degrees; lengths of hands in shares of the longer side of their box.

    The numbers are a little more than what MediaPipe's landmarkers do on rendered people (docs/rendered.md).
    """

    arm_drift: float = 7.0  # slow error of a direction, across
    arm_jitter: float = 0.15  # error of its own in every frame
    depth: float = 2.8  # times as far directions are off in depth, which one picture tells badly
    torso_drift: float = 7.0
    torso_jitter: float = 0.15
    hand_drift: float = 0.045  # slow error of a point
    hand_jitter: float = 0.005
    hand_shape: float = 0.13  # slow error of the whole hand's size, shear and turn
    blur: float = 0.03  # error of a point for every box that the hand moves between two frames
    missed: float = 0.06  # share of hands that are missed anyway
    missed_fast: float = 0.25  # more for every box that the hand moves between two frames
    small: float = 0.025  # of the picture's height: half of the hands of this size are missed
    missed_for: float = 0.2  # s, on average
    lost: float = 0.1  # share of windows in which a hand is gone for long
    swapped: float = 0.02  # share of windows in which left and right hands change places for a while
    arm_missed: float = 0.05  # share of arms, and of torsos
    settle: float = 1.5  # s in which slow errors change
    quality: float = 0.4  # deviation of the logarithm of all errors, drawn once a window


def detect(keypoints: ArmKeypoints, noise: DetectorNoise, rng: np.random.Generator) -> ArmKeypoints:
    """Key-points (..., T) of a perfect view as a detector gives them. Each batch entry has errors of its own."""
    time = keypoints.time
    interval = float(np.median(np.diff(time))) if len(time) > 1 else 1 / 30
    batch = keypoints.has_torso.shape[:-1]
    factor = np.exp(noise.quality * rng.standard_normal(batch))
    keep = float(np.exp(-interval / noise.settle))

    def errors(shape: tuple[int, ...], drift: float, jitter: float) -> np.ndarray:
        """(..., T, *shape): slow and fresh errors together."""
        slow = _slow(rng.standard_normal((*batch, len(time), *shape)), keep, len(batch))
        fresh = rng.standard_normal((*batch, len(time), *shape))
        return (drift * slow + jitter * fresh) * factor.reshape(*batch, *(1,) * (1 + len(shape)))

    deep = np.array([1.0, 1.0, noise.depth])
    bent = np.radians(errors((2, 2, 3), noise.arm_drift, noise.arm_jitter)) * deep
    turn = np.radians(errors((3,), noise.torso_drift, noise.torso_jitter))
    hand, moved, size = _drawn_hands(keypoints, noise, errors, rng)
    chance = np.clip(noise.missed + noise.missed_fast * moved, 0, 0.9)
    chance = np.maximum(chance, 1 / (1 + (size / noise.small) ** 4))
    stay = float(np.exp(-interval / noise.missed_for))
    has_hand = keypoints.has_hand & ~_spans(chance, stay, len(batch), rng)
    has_hand &= ~np.moveaxis(_one_span((*batch, 2, len(time)), noise.lost, len(time), rng), -1, -2)
    arm_missed = np.full((*batch, len(time), 2), noise.arm_missed)
    found = replace(
        keypoints,
        arm=np.asarray(normalize(keypoints.arm + bent)),
        has_arm=keypoints.has_arm & ~_spans(arm_missed, stay, len(batch), rng),
        torso=np.asarray(quaternion_multiply(quaternion_exp(turn), keypoints.torso)),
        has_torso=keypoints.has_torso & ~_spans(arm_missed[..., 0], stay, len(batch), rng),
        hand=hand,
        has_hand=has_hand,
    )
    swap = _one_span((*batch, len(time)), noise.swapped, max(1, round(_SWAP / interval)), rng)
    return replace(
        found,
        hand=np.where(swap[..., None, None, None], found.hand[..., ::-1, :, :], found.hand),
        has_hand=np.where(swap[..., None], found.has_hand[..., ::-1], found.has_hand),
    )


def _drawn_hands(
    keypoints: ArmKeypoints, noise: DetectorNoise, errors: Errors, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hands (..., T, 2, 21, 2) with errors; how far they move between frames, in boxes, and their boxes (..., T, 2)."""
    hand = keypoints.hand
    size = np.maximum((hand.max(axis=-2) - hand.min(axis=-2)).max(axis=-1), 1e-6)
    middle = hand.mean(axis=-2)
    step = np.diff(middle, axis=-3, prepend=middle[..., :1, :, :]) / size[..., None]
    moved = np.linalg.norm(step, axis=-1)
    wrong = errors(hand.shape[-3:], noise.hand_drift, noise.hand_jitter)
    wrong += noise.blur * np.minimum(moved, 2.0)[..., None, None] * rng.standard_normal(hand.shape)
    shape = np.eye(2) + errors((2, 2, 2), noise.hand_shape, 0.0)
    around = (hand - middle[..., None, :]) @ shape
    return middle[..., None, :] + around + size[..., None, None] * wrong, moved, size


def _slow(white: np.ndarray, keep: float, axis: int) -> np.ndarray:
    """White noise made slow along an axis: each value keeps `keep` of the one before; deviation 1 throughout."""
    rows = np.moveaxis(white, axis, 0).copy()
    fresh = np.sqrt(1 - keep * keep)
    for t in range(1, len(rows)):
        rows[t] = keep * rows[t - 1] + fresh * rows[t]
    return np.moveaxis(rows, 0, axis)


def _spans(chance: np.ndarray, stay: float, axis: int, rng: np.random.Generator) -> np.ndarray:
    """Bool of the same shape: on for the share `chance` of the time, in spans that go on with probability `stay`."""
    share = np.moveaxis(chance, axis, 0)
    enter = np.minimum(share * (1 - stay) / (1 - share), 1.0)
    drawn, on = rng.random(share.shape), np.empty(share.shape, dtype=bool)
    on[0] = drawn[0] < share[0]
    for t in range(1, len(on)):
        on[t] = drawn[t] < np.where(on[t - 1], stay, enter[t])
    return np.moveaxis(on, 0, axis)


def _one_span(shape: tuple[int, ...], share: float, longest: int, rng: np.random.Generator) -> np.ndarray:
    """Bool of a shape whose last axis is time: in `share` of the rows one span of up to `longest` frames, somewhere."""
    rows, frame = shape[:-1], np.arange(shape[-1])
    length = rng.integers(1, longest + 1, size=rows)
    first = rng.integers(1 - length, shape[-1], size=rows)
    there = (frame >= first[..., None]) & (frame < (first + length)[..., None])
    return there & (rng.random(rows) < share)[..., None]
