"""Hands cut from recordings: both hands of every clip with fingers, at the requested rate, in the body's place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.hands.hand import FINGERTIPS, HAND_JOINTS, angles_of, limits, mirrored_vectors
from bodysense.body.pose import forward_kinematics
from bodysense.io.clip import Clip
from bodysense_lab.data.clips import open_clips
from bodysense_lab.synthesis.motion import hand_motions, hand_pairs


def test_both_hands_keep_the_positions_of_the_recording(waving_clip: Clip) -> None:
    """At twice the recording's rate, every second frame equals a frame of the recording."""
    clip = replace(waving_clip, category="everyday")
    ((left, right),) = hand_pairs([clip], rate=60.0)
    assert (left.side, right.side, left.name, right.category) == ("left", "right", "waving", "everyday")
    skeleton = clip.pose.skeleton
    position = forward_kinematics(clip.pose)[0]
    for hand in (left, right):
        assert hand.frame_rate == 60.0 and len(hand) == 2 * len(clip) - 1
        assert hand.seconds == pytest.approx(len(hand) / 60)
        points = skeleton.indices([f"{hand.side}_{name}" for name in (*HAND_JOINTS, *FINGERTIPS)])
        found = mirrored_vectors(forward_kinematics(hand.pose)[0], hand.side)
        np.testing.assert_allclose(found[::2], position[:, points], atol=1e-9)


def test_clips_without_fingers_are_omitted(waving_clip: Clip) -> None:
    clips = [waving_clip, replace(waving_clip, has_fingers=False), waving_clip]
    assert [motion.side for motion in hand_motions(clips)] == ["left", "right"] * 2


def test_recorded_hands_keep_to_the_26_degrees_of_freedom(motion_data: Path) -> None:
    """Nearly all angles of recorded hands are within the limits."""
    clips = open_clips(motion_data / "rocketbox", "test", at_most=3)
    angles = np.concatenate([angles_of(motion.pose.rotation[:, 1:]) for motion in hand_motions(clips)])
    low, high = limits()
    assert ((angles >= low) & (angles <= high)).mean() > 0.99
