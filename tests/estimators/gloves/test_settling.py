from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.glove import default_glove
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_canonical
from bodysense.body.skeleton import Skeleton
from bodysense.estimators.gloves.fingers import hand_shape
from bodysense.estimators.gloves.joints import HandPoses
from bodysense.estimators.gloves.settling import between, displaced, nearer

INTERVAL = 1 / 60


def posed(hand: Skeleton, count: int, seed: int) -> HandPoses:
    """Hands of any pose, anywhere."""
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 16, 4)) * [0.3, 0.1, 0.1, 0.1] + [1.0, 0, 0, 0]
    rotation /= np.linalg.norm(rotation, axis=-1, keepdims=True)
    root = rng.normal(scale=0.03, size=(count, 3))
    return HandPoses(root, rotation, np.asarray(forward_kinematics(Pose(hand, root, rotation))[0]))


def test_a_hand_begins_where_it_was_shown_and_comes_at_the_speed(hand: Skeleton) -> None:
    shown, told = posed(hand, 3, 0), posed(hand, 3, 1)
    shape = hand_shape([hand] * 3, default_glove())
    moving = np.array([True, False, True])
    state = between(shown, told, moving, speed=0.25, longest=10.0)
    first = displaced(told, state, shape)
    np.testing.assert_allclose(first.position[moving], shown.position[moving], atol=1e-9)
    np.testing.assert_allclose(first.position[1], told.position[1], atol=1e-9)
    last, steps = first, 0
    while (state := nearer(state, INTERVAL)) is not None:
        now = displaced(told, state, shape)
        slow_twin = forward_kinematics(Pose(hand, now.root, quaternion_canonical(now.rotation)))[0]
        np.testing.assert_allclose(now.position, slow_twin, atol=1e-9)
        # Points go on arcs, at most a little longer than the straight way that is counted.
        assert np.linalg.norm(now.position - last.position, axis=-1).max() < 1.15 * 0.25 * INTERVAL
        last, steps = now, steps + 1
    farthest = np.linalg.norm(first.position - told.position, axis=-1).max()
    assert steps >= int(farthest / (0.25 * INTERVAL))
    assert np.linalg.norm(last.position - told.position, axis=-1).max() < 0.25 * INTERVAL * 1.15


def test_what_is_far_comes_within_the_longest_time(hand: Skeleton) -> None:
    told = posed(hand, 1, 2)
    shown = told._replace(root=told.root + 1.0, position=told.position + 1.0)
    state, frames = between(shown, told, np.array([True]), speed=0.25, longest=0.5), 0
    while state is not None:
        state, frames = nearer(state, INTERVAL), frames + 1
    assert frames == pytest.approx(30, abs=1)


def test_a_hand_that_is_there_is_not_away(hand: Skeleton) -> None:
    told = posed(hand, 2, 3)
    assert nearer(between(told, told, np.array([True, True]), 0.25, 0.5), INTERVAL) is None
