from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.glove import MARKERS, default_glove
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_canonical, quaternion_multiply
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.blending import Blend, BlendState, between, displaced, scaled
from bodysense.devices.gloves.fingers import HandPoses, hand_shape

INTERVAL = 1 / 60
SEEN = np.ones((1, len(MARKERS)), dtype=bool)


def posed(hand: Skeleton, count: int, seed: int) -> HandPoses:
    """Hands of any pose, anywhere."""
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 16, 4)) * [0.3, 0.1, 0.1, 0.1] + [1.0, 0, 0, 0]
    rotation /= np.linalg.norm(rotation, axis=-1, keepdims=True)
    return placed(hand, rng.normal(scale=0.03, size=(count, 3)), rotation)


def placed(hand: Skeleton, root: np.ndarray, rotation: np.ndarray) -> HandPoses:
    return HandPoses(root, rotation, np.asarray(forward_kinematics(Pose(hand, root, rotation))[0]))


def blend_of(hand: Skeleton, count: int, speed: float = 0.25, longest: float = 0.5) -> Blend:
    return Blend(hand_shape([hand] * count, [default_glove()] * count), default_glove(), speed, speed, longest)


def found(blend: Blend, shown: HandPoses, told: HandPoses) -> tuple[HandPoses, BlendState]:
    """The frame in which hands that were shown somewhere are found elsewhere."""
    known = SEEN.repeat(len(told.root), axis=0)
    _, state = blend.step(shown, shown, known, INTERVAL, None)
    return blend.step(told, shown, known, INTERVAL, state)


def test_what_is_offset_is_shown_where_it_was_and_partly_or_not_at_all(hand: Skeleton) -> None:
    shown, told = posed(hand, 3, 0), posed(hand, 3, 1)
    shape = hand_shape([hand] * 3, [default_glove()] * 3)
    offset = between(shown, told)
    np.testing.assert_allclose(displaced(told, offset, shape).position, shown.position, atol=1e-9)
    nothing = displaced(told, scaled(offset, np.zeros((1, 1)), np.zeros((1, 5))), shape)
    np.testing.assert_allclose(nothing.position, told.position, atol=1e-9)
    thumb = displaced(told, scaled(offset, np.ones((1, 1)), np.array([[0.0, 1, 1, 1, 1]])), shape)
    np.testing.assert_allclose(thumb.rotation[:, 1:4], told.rotation[:, 1:4], atol=1e-9)
    same = np.abs((thumb.rotation * shown.rotation).sum(axis=-1))
    np.testing.assert_allclose(same[:, [0, *range(4, 16)]], 1, atol=1e-9)
    assert displaced(told, None, shape) is told


def test_a_still_hand_comes_at_the_speed(hand: Skeleton) -> None:
    shown, told = posed(hand, 3, 0), posed(hand, 3, 1)
    told = HandPoses(
        *(np.where(np.arange(3).reshape(3, *[1] * (x.ndim - 1)) == 1, y, x) for x, y in zip(told, shown, strict=True))
    )
    blend, known = blend_of(hand, 3, longest=10.0), SEEN.repeat(3, axis=0)
    now, state = found(blend, shown, told)
    last, steps = shown, 0
    while state.offset is not None:
        np.testing.assert_allclose(now.position[1], told.position[1], atol=1e-9)
        slow_twin = forward_kinematics(Pose(hand, now.root, quaternion_canonical(now.rotation)))[0]
        np.testing.assert_allclose(now.position, slow_twin, atol=1e-9)
        assert np.linalg.norm(now.position - last.position, axis=-1).max() < 1.15 * 0.25 * INTERVAL
        last, steps = now, steps + 1
        now, state = blend.step(told, told, known, INTERVAL, state)
    assert now is told
    farthest = np.linalg.norm(shown.position - told.position, axis=-1).max()
    assert steps >= int(farthest / (0.25 * INTERVAL))
    assert np.linalg.norm(last.position - told.position, axis=-1).max() < 0.25 * INTERVAL * 1.15


def test_what_is_far_comes_within_the_longest_time(hand: Skeleton) -> None:
    shown = posed(hand, 1, 2)
    told = shown._replace(root=shown.root + 1.0, position=shown.position + 1.0)
    blend, frames = blend_of(hand, 1), 1
    _, state = found(blend, shown, told)
    while state.offset is not None:
        _, state = blend.step(told, told, SEEN, INTERVAL, state)
        frames += 1
    assert frames == pytest.approx(30, abs=1)


def test_a_hand_that_is_there_is_not_offset(hand: Skeleton) -> None:
    told = posed(hand, 2, 3)
    shown, state = found(blend_of(hand, 2), told, told)
    assert shown is told and state.offset is None
    again, state = blend_of(hand, 2).step(told, told, SEEN.repeat(2, axis=0), INTERVAL, state)
    assert again is told and state.offset is None


@pytest.mark.parametrize("seed", range(2))
def test_a_moving_hand_goes_no_farther_than_it_moves_and_the_speed(hand: Skeleton, seed: int) -> None:
    """It turns and goes fast; one finger was somewhere else, and its marker is found."""
    rng = np.random.default_rng(seed)
    blend, told = blend_of(hand, 1, speed=0.24), posed(hand, 1, seed)
    bent = told.rotation.copy()
    bent[:, 7] = [np.cos(0.4), 0.0, 0.0, np.sin(0.4)]
    shown, state = found(blend, placed(hand, told.root, bent), told)
    root, rotation = told.root, told.rotation
    way, turn = rng.normal(scale=0.02, size=(1, 3)), np.array([np.cos(0.04), *(np.sin(0.04) * np.eye(3)[seed % 3])])
    beyond = []
    for _ in range(40):
        root, rotation = root + way, rotation.copy()
        rotation[:, 0] = quaternion_multiply(turn, rotation[:, 0])
        before, moved = shown, placed(hand, root, rotation)
        step = np.linalg.norm(moved.position - told.position, axis=-1)
        told = moved
        shown, state = blend.step(told, told, SEEN, INTERVAL, state)
        beyond.append((np.linalg.norm(shown.position - before.position, axis=-1) - step).max())
    assert max(beyond) < 0.005
    assert state.offset is None
