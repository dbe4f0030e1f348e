"""Blending of hands when markers are found again."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.hands.glove import MARKERS, default_glove
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.blending import Blend, BlendState, apply_offset, offset_between, scale_offset
from bodysense.devices.gloves.fingers import HandPoses, hand_shape
from bodysense.geometry.rotation import quaternion_canonical, quaternion_multiply

INTERVAL = 1 / 60
SEEN = np.ones((1, len(MARKERS)), dtype=bool)


def posed(hand: Skeleton, count: int, seed: int) -> HandPoses:
    """Return hands with random poses and positions."""
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 16, 4)) * [0.3, 0.1, 0.1, 0.1] + [1.0, 0, 0, 0]
    rotation /= np.linalg.norm(rotation, axis=-1, keepdims=True)
    return hands_at(hand, rng.normal(scale=0.03, size=(count, 3)), rotation)


def hands_at(hand: Skeleton, root: np.ndarray, rotation: np.ndarray) -> HandPoses:
    return HandPoses(root, rotation, np.asarray(forward_kinematics(Pose(hand, root, rotation))[0]))


def blend_of(hand: Skeleton, count: int, speed: float = 0.25, longest: float = 0.5) -> Blend:
    return Blend(hand_shape([hand] * count, [default_glove()] * count), default_glove(), speed, speed, longest)


def output_after(blend: Blend, output: HandPoses, solved: HandPoses) -> tuple[HandPoses, BlendState]:
    """Return the output and state of the frame in which hands with another output are found at `solved`."""
    known = SEEN.repeat(len(solved.root), axis=0)
    _, state = blend.step(output, output, known, INTERVAL, None)
    return blend.step(solved, output, known, INTERVAL, state)


def test_an_offset_restores_the_output_and_scales_by_part(hand: Skeleton) -> None:
    output, solved = posed(hand, 3, 0), posed(hand, 3, 1)
    shape = hand_shape([hand] * 3, [default_glove()] * 3)
    offset = offset_between(output, solved)
    np.testing.assert_allclose(apply_offset(solved, offset, shape).position, output.position, atol=1e-9)
    nothing = apply_offset(solved, scale_offset(offset, np.zeros((1, 1)), np.zeros((1, 5))), shape)
    np.testing.assert_allclose(nothing.position, solved.position, atol=1e-9)
    thumb = apply_offset(solved, scale_offset(offset, np.ones((1, 1)), np.array([[0.0, 1, 1, 1, 1]])), shape)
    np.testing.assert_allclose(thumb.rotation[:, 1:4], solved.rotation[:, 1:4], atol=1e-9)
    same = np.abs((thumb.rotation * output.rotation).sum(axis=-1))
    np.testing.assert_allclose(same[:, [0, *range(4, 16)]], 1, atol=1e-9)
    assert apply_offset(solved, None, shape) is solved


def test_the_output_approaches_a_still_hand_at_the_speed(hand: Skeleton) -> None:
    output, solved = posed(hand, 3, 0), posed(hand, 3, 1)
    solved = HandPoses(
        *(
            np.where(np.arange(3).reshape(3, *[1] * (x.ndim - 1)) == 1, y, x)
            for x, y in zip(solved, output, strict=True)
        )
    )
    blend, known = blend_of(hand, 3, longest=10.0), SEEN.repeat(3, axis=0)
    now, state = output_after(blend, output, solved)
    last, steps = output, 0
    while state.offset is not None:
        np.testing.assert_allclose(now.position[1], solved.position[1], atol=1e-9)
        slow_twin = forward_kinematics(Pose(hand, now.root, quaternion_canonical(now.rotation)))[0]
        np.testing.assert_allclose(now.position, slow_twin, atol=1e-9)
        assert np.linalg.norm(now.position - last.position, axis=-1).max() < 1.15 * 0.25 * INTERVAL
        last, steps = now, steps + 1
        now, state = blend.step(solved, solved, known, INTERVAL, state)
    assert now is solved
    farthest = np.linalg.norm(output.position - solved.position, axis=-1).max()
    assert steps >= int(farthest / (0.25 * INTERVAL))
    assert np.linalg.norm(last.position - solved.position, axis=-1).max() < 0.25 * INTERVAL * 1.15


def test_a_large_offset_decays_within_the_longest_time(hand: Skeleton) -> None:
    output = posed(hand, 1, 2)
    solved = output._replace(root=output.root + 1.0, position=output.position + 1.0)
    blend, frames = blend_of(hand, 1), 1
    _, state = output_after(blend, output, solved)
    while state.offset is not None:
        _, state = blend.step(solved, solved, SEEN, INTERVAL, state)
        frames += 1
    assert frames == pytest.approx(30, abs=1)


def test_a_hand_that_did_not_move_has_no_offset(hand: Skeleton) -> None:
    solved = posed(hand, 2, 3)
    output, state = output_after(blend_of(hand, 2), solved, solved)
    assert output is solved and state.offset is None
    again, state = blend_of(hand, 2).step(solved, solved, SEEN.repeat(2, axis=0), INTERVAL, state)
    assert again is solved and state.offset is None


@pytest.mark.parametrize("seed", range(2))
def test_output_moves_no_farther_than_the_hand_plus_the_speed(hand: Skeleton, seed: int) -> None:
    """The hand moves and turns fast, and the marker of a finger is found that was bent differently."""
    rng = np.random.default_rng(seed)
    blend, solved = blend_of(hand, 1, speed=0.24), posed(hand, 1, seed)
    bent = solved.rotation.copy()
    bent[:, 7] = [np.cos(0.4), 0.0, 0.0, np.sin(0.4)]
    output, state = output_after(blend, hands_at(hand, solved.root, bent), solved)
    root, rotation = solved.root, solved.rotation
    way, turn = rng.normal(scale=0.02, size=(1, 3)), np.array([np.cos(0.04), *(np.sin(0.04) * np.eye(3)[seed % 3])])
    beyond = []
    for _ in range(40):
        root, rotation = root + way, rotation.copy()
        rotation[:, 0] = quaternion_multiply(turn, rotation[:, 0])
        before, now_solved = output, hands_at(hand, root, rotation)
        step = np.linalg.norm(now_solved.position - solved.position, axis=-1)
        solved = now_solved
        output, state = blend.step(solved, solved, SEEN, INTERVAL, state)
        beyond.append((np.linalg.norm(output.position - before.position, axis=-1) - step).max())
    assert max(beyond) < 0.005
    assert state.offset is None
