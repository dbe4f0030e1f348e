"""The displayed body: blends do not jump, do not depend on the frame rate, and end exactly; smoothing follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp
from bodysense_live.sessions.body_display import BLEND_HALF_LIFE, LONGEST_GAP, DisplayState

SKELETON = default_skeleton()
JOINTS = len(SKELETON.joints)
seeds = st.integers(0, 2**32 - 1)


def random_pose(rng: np.random.Generator) -> Pose:
    turn = rng.normal(size=(JOINTS, 3))
    turn *= rng.uniform(0, 1.4, (JOINTS, 1)) / np.linalg.norm(turn, axis=-1, keepdims=True)
    return Pose(SKELETON, rng.normal(size=3), np.asarray(quaternion_exp(turn)))


def apart(one: Pose, other: Pose) -> float:
    """Return the largest distance of roots (m) or joints (rad)."""
    angle = np.max(geodesic_angle(np.asarray(one.rotation), np.asarray(other.rotation)))
    return max(float(np.linalg.norm(one.root_position - other.root_position)), float(angle))


def shown(pose: Pose) -> DisplayState:
    """Return the state after a pose at 0 s."""
    return DisplayState().step(pose, 0.0, 0.0)[1]


@settings(max_examples=10)
@given(seed=seeds, steps=st.lists(st.floats(1e-3, 0.1), min_size=2, max_size=6))
def test_a_blend_starts_at_the_displayed_pose_and_does_not_depend_on_the_frame_rate(
    seed: int, steps: list[float]
) -> None:
    rng = np.random.default_rng(seed)
    before, target = random_pose(rng), random_pose(rng)
    state = shown(before).blending()
    assert apart(state.step(target, 0.0, 0.0)[0], before) < 1e-9
    at_once, _ = state.step(target, sum(steps), 0.0)
    after, time = before, 0.0
    for step in steps:
        time += step
        after, state = state.step(target, time, 0.0)
    assert apart(after, at_once) < 1e-6


def test_a_blend_halves_within_its_half_life_and_ends_at_the_target_itself() -> None:
    rng = np.random.default_rng(0)
    before, target = random_pose(rng), random_pose(rng)
    state = shown(before).blending()
    half, _ = state.step(target, BLEND_HALF_LIFE, 0.0)
    np.testing.assert_allclose(half.root_position, (before.root_position + target.root_position) / 2, atol=1e-12)
    distance, pose = [], before
    for frame in range(1, 200):
        pose, state = state.step(target, frame / 60, 0.0)
        distance.append(apart(pose, target))
    assert max(distance[60:]) < 1e-3 and max(distance[120:]) < 1e-6 and pose is target


def test_a_second_blend_starts_at_the_displayed_pose() -> None:
    rng = np.random.default_rng(1)
    first, second, third = (random_pose(rng) for _ in range(3))
    displayed, state = shown(first).blending().step(second, 0.02, 0.0)
    again, _ = state.blending().step(third, 0.02, 0.0)
    assert apart(displayed, first) > 1e-3 and apart(again, displayed) < 1e-9


@pytest.mark.parametrize("gap", [LONGEST_GAP + 0.01, None])
def test_nothing_is_smoothed_or_blended_after_a_long_gap_or_at_once(gap: float | None) -> None:
    rng = np.random.default_rng(2)
    state = shown(random_pose(rng)).blending()
    target = random_pose(rng)
    pose, _ = state.step(target, gap, 0.2) if gap else state.unsmoothed().step(target, 0.01, 0.2)
    assert pose is target


@settings(max_examples=10)
@given(seed=seeds)
def test_smoothing_has_no_jump_in_position_or_velocity_and_reaches_its_target(seed: int) -> None:
    rng = np.random.default_rng(seed)
    before, target = random_pose(rng), random_pose(rng)
    moving = replace(shown(before), velocity=rng.normal(size=(JOINTS + 1, 3)))
    step = 1e-6
    pose, _ = moving.step(target, step, 0.2)
    speed = (np.asarray(pose.root_position) - np.asarray(before.root_position)) / step
    np.testing.assert_allclose(speed, np.asarray(moving.velocity)[-1], atol=1e-2)
    state = moving
    for frame in range(1, 300):
        pose, state = state.step(target, frame / 60, 0.1)
    assert apart(pose, target) < 1e-6
