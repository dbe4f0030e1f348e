"""Errors of a key-point detector: jitter, drift, motion blur, missed and swapped hands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.keypoints import ArmKeypoints
from bodysense.geometry.rotation import normalize, quaternion_exp, quaternion_multiply

Errors = Callable[[tuple[int, ...], float, float], np.ndarray]
_SWAP = 0.3  # s that a swap lasts on average
_STEEPEST = 0.98  # depth of a direction toward the camera or away from it, as a detector says it at most


@dataclass(frozen=True)
class DetectorNoise:
    """How a detector errs. Angles in degrees; lengths of hands in shares of the longer side of their box.

    The numbers are about those of MediaPipe's landmarkers on rendered people of the training split (docs/rendered.md).
    One picture tells depth badly: a detector makes it less than it is, and a forearm comes toward the camera.
    """

    arm_drift: float = 4.6  # slow error of a direction, across
    arm_jitter: float = 0.1  # error of its own in every frame
    depth: float = 1.35  # times as far directions are off in depth
    depth_kept: tuple[float, float] = (
        0.65,
        0.38,
    )  # share of the depth of upper arm's and forearm's directions that is seen
    depth_kept_spread: tuple[float, float] = (0.15, 0.2)  # from window to window and arm to arm
    nearer: tuple[float, float] = (0.03, 0.27)  # by so much their ends come toward the camera
    nearer_spread: tuple[float, float] = (0.08, 0.12)
    torso_drift: float = 6.6
    torso_jitter: float = 0.1
    hand_drift: float = 0.04  # slow error of a point
    hand_jitter: float = 0.006
    hand_shape: float = 0.15  # slow error of the whole hand's size, shear and turn
    blur: float = 0.03  # error of a point for every box that the hand moves between two frames
    missed: float = 0.03  # share of hands that are missed anyway
    missed_fast: float = 0.25  # more for every box that the hand moves between two frames
    small: float = 0.025  # of the picture's height: half of the hands of this size are missed
    missed_for: float = 0.25  # s, on average
    lost: float = 0.3  # share of windows in which a hand is gone for long
    swapped: float = 0.05  # share of windows in which left and right hands change places for a while
    arm_missed: float = 0.08  # share of arms, and of torsos
    settle: float = 3.0  # s in which slow errors change
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
    hand, travel, size = _drawn_hands(keypoints, noise, errors, rng)
    chance = np.clip(noise.missed + noise.missed_fast * travel, 0, 0.9)
    chance = np.maximum(chance, 1 / (1 + (size / noise.small) ** 4))
    stay = float(np.exp(-interval / noise.missed_for))
    has_hand = keypoints.has_hand & ~_spans(chance, stay, len(batch), rng)
    has_hand &= ~np.moveaxis(_one_span((*batch, 2, len(time)), noise.lost, len(time), rng), -1, -2)
    arm_missed = np.full((*batch, len(time), 2), noise.arm_missed)
    # The depth that a detector sees in directions (..., T, 2, 2, 3): one mind a window, arm and bone.
    once = (*batch, 1, *keypoints.arm.shape[-3:-1])
    depth_kept = np.clip(noise.depth_kept + noise.depth_kept_spread * rng.standard_normal(once), 0.0, 1.1)
    nearer = noise.nearer + noise.nearer_spread * rng.standard_normal(once)
    found = replace(
        keypoints,
        arm=np.asarray(normalize(flattened(keypoints.arm, depth_kept, nearer) + bent)),
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


def flattened(arm: np.ndarray, kept: np.ndarray, nearer: np.ndarray) -> np.ndarray:
    """Directions (..., 3) of which `kept` of the depth is seen, and their ends `nearer`; both (...), or fit to it."""
    depth = np.clip(kept * arm[..., 2] + nearer, -_STEEPEST, _STEEPEST)
    across = np.asarray(normalize(arm[..., :2])) * np.sqrt(1 - depth * depth)[..., None]
    return np.concatenate([across, depth[..., None]], axis=-1)


def _drawn_hands(
    keypoints: ArmKeypoints, noise: DetectorNoise, errors: Errors, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hands (..., T, 2, 21, 2) with errors; how far they move between frames, in boxes, and their boxes (..., T, 2)."""
    hand = keypoints.hand
    size = np.maximum((hand.max(axis=-2) - hand.min(axis=-2)).max(axis=-1), 1e-6)
    middle = hand.mean(axis=-2)
    step = np.diff(middle, axis=-3, prepend=middle[..., :1, :, :]) / size[..., None]
    travel = np.linalg.norm(step, axis=-1)
    wrong = errors(hand.shape[-3:], noise.hand_drift, noise.hand_jitter)
    wrong += noise.blur * np.minimum(travel, 2.0)[..., None, None] * rng.standard_normal(hand.shape)
    shape = np.eye(2) + errors((2, 2, 2), noise.hand_shape, 0.0)
    around = (hand - middle[..., None, :]) @ shape
    return middle[..., None, :] + around + size[..., None, None] * wrong, travel, size


def _slow(white: np.ndarray, keep: float, axis: int) -> np.ndarray:
    """White noise made slow along an axis: each value keeps `keep` of the one before; deviation 1 throughout."""
    rows = np.moveaxis(white, axis, 0).copy()
    fresh = np.sqrt(1 - keep * keep)
    for t in range(1, len(rows)):
        rows[t] = keep * rows[t - 1] + fresh * rows[t]
    return np.moveaxis(rows, 0, axis)


def _spans(chance: np.ndarray, stay: float, axis: int, rng: np.random.Generator) -> np.ndarray:
    """Bool of the same shape: on for the share `chance` of the time, in spans that continue with probability `stay`."""
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
