"""Constant velocity: hidden points move on for half a second, fingers with their wrist."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense_lab.papers.unoc.score.constant_velocity import LONGEST, constant_velocity

SKELETON = default_skeleton()
ELBOW, WRIST, TIP = (SKELETON.index(f"left_{name}") for name in ("elbow", "wrist", "index_tip"))


def test_a_hidden_point_moves_on_for_half_a_second(make_observation) -> None:
    frames = [{"head": (0, 1.6, 0), "left_elbow": (0.3, 1.2, 0.01 * t)} for t in range(4)]
    frames += [{"head": (0, 1.6, 0)}] * 30
    time = np.arange(len(frames)) / 30
    depth = constant_velocity(make_observation(frames, time), SKELETON)[:, ELBOW, 2]
    assert depth[3] == pytest.approx(0.03)
    assert depth[9] == pytest.approx(0.09)
    np.testing.assert_allclose(depth[-5:], 0.03 + 0.3 * LONGEST)


def test_a_velocity_needs_two_frames_in_a_row(make_observation) -> None:
    frames = [{"head": (0, 1.6, 0), "left_elbow": (0, 1.2, 0)}, {"head": (0, 1.6, 0)}]
    frames += [{"head": (0, 1.6, 0), "left_elbow": (0, 1.2, 0.5)}, {"head": (0, 1.6, 0)}]
    depth = constant_velocity(make_observation(frames, np.arange(4) / 30), SKELETON)[:, ELBOW, 2]
    assert depth[3] == pytest.approx(0.5)


def test_fingers_move_with_their_wrist(make_observation) -> None:
    frames = [
        {"head": (0, 1.6, 0), "left_wrist": (0.3, 1, 0.01 * t), "left_index_tip": (0.3, 0.9, 0.01 * t)} for t in (0, 1)
    ]
    frames += [{"head": (0, 1.6, 0)}] * 3
    moved = constant_velocity(make_observation(frames, np.arange(5) / 30), SKELETON)
    np.testing.assert_allclose(moved[4, WRIST], (0.3, 1, 0.04), atol=1e-9)
    np.testing.assert_allclose(moved[4, TIP] - moved[4, WRIST], (0, -0.1, 0), atol=1e-9)
