"""Accuracy and smoothness of hands with the packaged networks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bodysense.body.hands.glove import default_glove, marker_positions
from bodysense.body.hands.hand import HAND_JOINTS
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.hands import Hands, load_glove_models
from bodysense_lab.synthesis.hands import synthesize_hand


def come_and_go(frames: int, seed: int) -> np.ndarray:
    """Return a mask (T, 9): each marker is hidden for about a quarter of a second, every second or two."""
    rng, hidden = np.random.default_rng(seed), np.zeros((frames, 9), dtype=bool)
    for marker in range(9):
        start = int(rng.integers(10, 60))
        while start < frames:
            length = 1 + int(rng.exponential(15))
            hidden[start : start + length, marker] = True
            start += length + int(rng.exponential(60))
    return hidden


def follow(pose: Pose, hand: Skeleton, hidden: np.ndarray, observe_gloves) -> tuple[np.ndarray, np.ndarray]:
    """Return output and true positions (T, 21, 3) m."""
    markers = np.asarray(marker_positions(default_glove(), pose))
    hands = Hands({"left": hand}, load_glove_models())
    seen = observe_gloves(left=np.where(hidden[..., None], np.nan, markers))
    estimates, _ = hands.step(seen, hands.start())
    return estimates["left"].position, np.asarray(forward_kinematics(pose)[0])


def jumps(output: np.ndarray, truth: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """Return by how much (m) steps exceed true and neighbouring ones when markers are lost or found."""
    step, true = (np.linalg.norm(np.diff(rows, axis=0), axis=-1) for rows in (output, truth))
    at = 1 + np.flatnonzero((hidden[2:-1] != hidden[1:-2]).any(axis=1))
    return (step[at] - np.maximum.reduce([step[at - 1], step[at + 1], true[at]])).max(axis=1)


def test_hands_do_not_jump(hand: Skeleton, observe_gloves) -> None:
    """Jumps are below 5 mm per frame at 60 Hz, in motion at half the speed of the synthesiser's brisk gestures."""
    pose = synthesize_hand(hand, 10.0, np.random.default_rng(8), rate=120.0).pose[:1200]
    hidden = come_and_go(1200, seed=5)
    jump = jumps(*follow(pose, hand, hidden, observe_gloves), hidden)
    assert len(jump) > 150
    assert np.quantile(jump, 0.99) < 0.005


def test_fingers_with_seen_markers_are_accurate(hand: Skeleton, observe_gloves) -> None:
    pose = synthesize_hand(hand, 10.0, np.random.default_rng(9)).pose
    output, truth = follow(pose, hand, np.zeros((len(pose.root_position), 9), dtype=bool), observe_gloves)
    joints = slice(1, len(HAND_JOINTS))
    assert np.linalg.norm(output - truth, axis=-1)[:, joints].mean() < 0.0025


@pytest.mark.slow
def test_recorded_hands_do_not_jump(motion_data: Path, observe_gloves) -> None:
    from bodysense_lab.data.clips import open_clips
    from bodysense_lab.synthesis.motion import hand_motions

    worst = []
    for motion in hand_motions(open_clips(motion_data / "rocketbox", "test", at_most=6)):
        hidden = come_and_go(len(motion), seed=len(worst))
        output, truth = follow(motion.pose, motion.pose.skeleton, hidden, observe_gloves)
        worst.append(jumps(output, truth, hidden).max())
    assert len(worst) > 5
    assert max(worst) < 0.005
