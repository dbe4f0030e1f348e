"""The errors of a detector."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.keypoints import ArmKeypoints
from bodysense.geometry.rotation import geodesic_angle, normalize
from bodysense_lab.papers.pahmt.keypoint_noise import DetectorNoise, detect

NEITHER = (0.0, 0.0)
NONE = DetectorNoise(
    **{
        name: 0.0
        for name, value in vars(DetectorNoise()).items()
        if name not in ("small", "missed_for", "settle") and isinstance(value, float)
    },
    depth_kept=(1.0, 1.0),
    depth_kept_spread=NEITHER,
    nearer=NEITHER,
    nearer_spread=NEITHER,
)


def still(batch: int = 150, frames: int = 32, step: float = 0.0) -> ArmKeypoints:
    """Hands of one box of 0.2, moving sideways by `step` boxes a frame; arms along x; nothing hidden."""
    rng = np.random.default_rng(5)
    shape = rng.uniform(size=(21, 2))
    shape = 0.2 * (shape - shape.min(axis=0)) / (shape.max(axis=0) - shape.min(axis=0))
    moved = shape + 0.2 * step * np.arange(frames)[:, None, None] * [1.0, 0.0]
    arm = np.zeros((batch, frames, 2, 2, 3))
    arm[..., 0] = 1
    torso = np.zeros((batch, frames, 4))
    torso[..., 0] = 1
    seen = np.ones((batch, frames, 2), dtype=bool)
    hand = np.broadcast_to(moved[:, None], (batch, frames, 2, 21, 2))
    return ArmKeypoints(np.arange(frames) / 30, arm, seen, torso, seen[..., 0], hand, seen.copy())


def test_without_errors_nothing_changes() -> None:
    before = still(5)
    after = detect(before, replace(NONE, small=1e-9), np.random.default_rng(0))
    for name, values in vars(before).items():
        np.testing.assert_allclose(getattr(after, name), values, atol=1e-12)


def test_errors_have_the_given_size() -> None:
    noise, before = replace(NONE, arm_jitter=3.0, torso_jitter=2.0, hand_jitter=0.02), still()
    after = detect(before, noise, np.random.default_rng(0))
    across = np.degrees(np.arctan2(after.arm[..., 1], after.arm[..., 0])).std()
    assert across == pytest.approx(3.0, rel=0.07)
    # Three independent components of deviation s have a length with root mean square s √3.
    angle = np.degrees(geodesic_angle(after.torso, before.torso))
    assert np.sqrt((angle**2).mean()) == pytest.approx(2.0 * np.sqrt(3), rel=0.07)
    assert (after.hand - before.hand).std() == pytest.approx(0.02 * 0.2, rel=0.05)
    np.testing.assert_allclose(np.linalg.norm(after.arm, axis=-1), 1, atol=1e-12)


def test_depth_shrinks_and_the_direction_across_stays() -> None:
    before = still(2000, 3)
    before.arm[..., :] = np.asarray(normalize(np.array([0.5, -0.7, 0.4])))
    noise = replace(
        NONE, depth_kept=(0.7, 0.4), depth_kept_spread=(0.1, 0.0), nearer=(0.0, 0.2), nearer_spread=(0, 0.05)
    )
    after = detect(before, noise, np.random.default_rng(0))
    true = before.arm[0, 0, 0, 0]
    depth = after.arm[..., 2]
    np.testing.assert_allclose(depth.mean(axis=(0, 1, 2)), [0.7 * true[2], 0.4 * true[2] + 0.2], atol=0.005)
    np.testing.assert_allclose(depth[:, 0].std(axis=(0, 1)), [0.1 * true[2], 0.05], rtol=0.07)
    np.testing.assert_array_equal(depth[:, 0], depth[:, 2])  # one mind a window
    np.testing.assert_allclose(after.arm[..., 1] / after.arm[..., 0], true[1] / true[0])
    np.testing.assert_allclose(np.linalg.norm(after.arm, axis=-1), 1)


def test_drift_is_slow_and_jitter_is_not() -> None:
    rng = np.random.default_rng(0)
    slow, fast = (
        detect(still(), replace(NONE, **{name: 0.05}), rng).hand - still().hand
        for name in ("hand_drift", "hand_jitter")
    )
    keep = np.exp(-1 / 30 / NONE.settle)
    for error, wanted in ((slow, keep), (fast, 0.0)):
        together = (error[:, 1:] * error[:, :-1]).mean() / (error**2).mean()
        assert together == pytest.approx(wanted, abs=0.03)


def test_hands_are_missed_at_the_given_rate_and_more_if_fast_or_small() -> None:
    noise = replace(NONE, missed=0.1, missed_fast=0.4, missed_for=0.2)
    shares = [
        1 - detect(keypoints, noise, np.random.default_rng(0)).has_hand[:, 16:].mean()
        for keypoints in (still(400), still(400, step=0.5))
    ]
    assert shares[0] == pytest.approx(0.1, abs=0.02)
    assert shares[1] == pytest.approx(0.3, abs=0.03)
    far = replace(still(400), hand=still(400).hand * (noise.small / 0.2))
    assert 1 - detect(far, noise, np.random.default_rng(0)).has_hand.mean() == pytest.approx(0.5, abs=0.04)


def test_misses_come_in_spans() -> None:
    missed = ~detect(still(400), replace(NONE, missed=0.1), np.random.default_rng(0)).has_hand
    stays = (missed[:, 1:] & missed[:, :-1]).sum() / missed[:, :-1].sum()
    assert stays == pytest.approx(np.exp(-1 / 30 / NONE.missed_for), abs=0.03)


def test_swapped_hands_change_places_for_a_while() -> None:
    keypoints = still(300)
    marked = keypoints.hand.copy()
    marked[:, :, 1] += 5.0
    after = detect(replace(keypoints, hand=marked), replace(NONE, swapped=0.5), np.random.default_rng(0))
    left = after.hand[:, :, 0].mean(axis=(-1, -2)) > 2.5
    assert 0.3 < left.any(axis=1).mean() < 0.6 and left.sum(axis=1).max() <= 9
    np.testing.assert_array_equal(left, after.hand[:, :, 1].mean(axis=(-1, -2)) < 2.5)


def test_a_lost_hand_stays_lost_for_long() -> None:
    after = detect(still(300), replace(NONE, lost=0.3), np.random.default_rng(0))
    gone = ~after.has_hand
    assert gone.any(axis=1).mean() == pytest.approx(0.3, abs=0.07)
    assert gone.sum(axis=1).max() > 20


def test_hidden_points_stay_hidden() -> None:
    keypoints = still(20)
    hidden = replace(keypoints, has_hand=np.zeros_like(keypoints.has_hand), has_arm=np.zeros_like(keypoints.has_arm))
    after = detect(hidden, DetectorNoise(), np.random.default_rng(0))
    assert not after.has_hand.any() and not after.has_arm.any()
