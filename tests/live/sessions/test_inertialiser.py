"""The inertialiser: no jump in pose or velocity, independence of the frame rate, an exact end, exact followers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    geodesic_angle,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
)
from bodysense_live.sessions.inertialiser import Inertialiser, Offset, Velocity

SKELETON = default_skeleton()
JOINTS = len(SKELETON.joints)
BATCHES = [(), (2, 3)]
ONE = Inertialiser()
seeds = st.integers(0, 2**32 - 1)


def random_pose(rng: np.random.Generator, batch: tuple[int, ...], most: float = 2.0) -> Pose:
    turn = rng.normal(size=(*batch, JOINTS, 3))
    turn *= rng.uniform(0, most, (*batch, JOINTS, 1)) / np.linalg.norm(turn, axis=-1, keepdims=True)
    return Pose(SKELETON, rng.normal(size=(*batch, 3)), np.asarray(quaternion_exp(turn)))


def random_velocity(rng: np.random.Generator, batch: tuple[int, ...]) -> Velocity:
    return Velocity(rng.normal(size=(*batch, 3)), rng.normal(size=(*batch, JOINTS, 3)))


def moved(pose: Pose, velocity: Velocity, seconds: float) -> Pose:
    """Return a pose after steady motion."""
    turn = np.asarray(quaternion_exp(velocity.spin * seconds))
    root = pose.root_position + velocity.root * seconds
    return Pose(pose.skeleton, root, quaternion_multiply(turn, np.asarray(pose.rotation)))


def apart(one: Pose, other: Pose) -> float:
    """Return the largest distance of roots (m) or joints (rad)."""
    root = np.linalg.norm(one.root_position - other.root_position, axis=-1).max()
    return max(float(root), float(np.max(geodesic_angle(np.asarray(one.rotation), np.asarray(other.rotation)))))


def begun(rng: np.random.Generator, batch: tuple[int, ...]) -> tuple[Pose, Pose, Offset]:
    """Return an output, a target, and the offset between them."""
    output, target = random_pose(rng, batch), random_pose(rng, batch)
    return output, target, ONE.start(output, target, ONE.rest(target), velocity=random_velocity(rng, batch))


@pytest.mark.parametrize("batch", BATCHES)
@settings(max_examples=10)
@given(seed=seeds)
def test_the_pose_is_continuous(batch: tuple[int, ...], seed: int) -> None:
    output, target, offset = begun(np.random.default_rng(seed), batch)
    after, _ = ONE.apply(target, 0.0, offset)
    np.testing.assert_allclose(after.root_position, output.root_position, atol=1e-9)
    np.testing.assert_allclose(forward_kinematics(after)[0], forward_kinematics(output)[0], atol=1e-9)


@pytest.mark.parametrize("batch", BATCHES)
@settings(max_examples=10)
@given(seed=seeds)
def test_the_velocity_is_continuous(batch: tuple[int, ...], seed: int) -> None:
    """The output keeps its velocity, also if the target moves."""
    rng = np.random.default_rng(seed)
    output, target = random_pose(rng, batch), random_pose(rng, batch, 1.0)
    before, own = random_velocity(rng, batch), random_velocity(rng, batch)
    offset = ONE.start(output, target, ONE.rest(target), velocity=before, target_velocity=own)
    step = 1e-7
    after, _ = ONE.apply(moved(target, own, step), step, offset)
    turn = quaternion_multiply(after.rotation, quaternion_conjugate(output.rotation))
    np.testing.assert_allclose((after.root_position - output.root_position) / step, before.root, atol=1e-3)
    np.testing.assert_allclose(quaternion_log(turn) / step, before.spin, atol=2e-3)


@settings(max_examples=4)
@given(seed=seeds)
def test_the_output_equals_the_target_in_the_end(seed: int) -> None:
    _, target, offset = begun(np.random.default_rng(seed), (2,))
    distance = []
    for _ in range(200):
        output, offset = ONE.apply(target, 1 / 60, offset)
        distance.append(apart(output, target))
    assert max(distance[60:]) < 1e-3 and max(distance[120:]) < 1e-6
    assert ONE.apply(target, 1 / 60, offset)[0] is target


@settings(max_examples=10)
@given(seed=seeds, steps=st.lists(st.floats(1e-3, 0.1), min_size=2, max_size=6))
def test_the_result_is_independent_of_the_frame_rate(seed: int, steps: list[float]) -> None:
    _, target, offset = begun(np.random.default_rng(seed), (2,))
    at_once, _ = ONE.apply(target, sum(steps), offset)
    after = target
    for step in steps:
        after, offset = ONE.apply(target, step, offset)
    assert apart(after, at_once) < 1e-6


def test_half_of_an_offset_at_rest_decays_in_the_half_life() -> None:
    output, target, _ = begun(np.random.default_rng(0), (3,))
    offset = ONE.start(output, target, ONE.rest(target))
    after, _ = ONE.apply(target, ONE.half_life, offset)
    np.testing.assert_allclose(after.root_position, (output.root_position + target.root_position) / 2, atol=1e-12)


@pytest.mark.parametrize("batch", BATCHES)
@settings(max_examples=10)
@given(seed=seeds)
def test_joints_that_follow_are_exact(batch: tuple[int, ...], seed: int) -> None:
    rng = np.random.default_rng(seed)
    output, target = random_pose(rng, batch), random_pose(rng, batch)
    follow = rng.random((*batch, JOINTS)) < 0.4
    offset = ONE.start(output, target, ONE.rest(target), follow=follow, velocity=random_velocity(rng, batch))
    after, _ = ONE.apply(target, 0.01, offset)
    np.testing.assert_array_equal(np.asarray(after.rotation)[follow], np.asarray(target.rotation)[follow])
    np.testing.assert_array_equal(after.root_position[follow[..., 0]], target.root_position[follow[..., 0]])
    others = ~follow
    assert (np.abs(np.asarray(after.rotation) - np.asarray(target.rotation)).max(axis=-1)[others] > 0).all()


def test_only_given_people_break() -> None:
    """A second break of one of two people does not change the offset of the other."""
    rng = np.random.default_rng(0)
    output, target, offset = begun(rng, (2,))
    elsewhere = random_pose(rng, (2,))
    again = ONE.start(output, elsewhere, offset, people=np.array([False, True]))
    for before, after in ((offset.root, again.root), (offset.rotation, again.rotation)):
        np.testing.assert_array_equal(after[0], before[0])
        assert (after[1] != before[1]).any()
    np.testing.assert_array_equal(again.velocity.spin[0], offset.velocity.spin[0])
    both, _ = ONE.apply(target, np.array([0.01, 0.02]), offset)
    for k, passed in enumerate((0.01, 0.02)):
        own = Offset(offset.root[k], offset.rotation[k], Velocity(offset.velocity.root[k], offset.velocity.spin[k]))
        alone, _ = ONE.apply(target[k], passed, own)
        np.testing.assert_allclose(both.rotation[k], alone.rotation, atol=1e-15)


def test_a_change_of_skeleton_is_continuous() -> None:
    output, target, _ = begun(np.random.default_rng(1), ())
    taller = Pose(SKELETON.scaled(1.9), target.root_position, target.rotation)
    after, _ = ONE.apply(taller, 0.0, ONE.start(output, taller, ONE.rest(taller)))
    assert after.skeleton is taller.skeleton
    assert apart(after, output) < 1e-9


def test_the_output_is_the_target_without_an_offset() -> None:
    target = random_pose(np.random.default_rng(0), (2,))
    rest = ONE.rest(target)
    assert ONE.apply(target, 1 / 60, rest) == (target, rest)
    same = ONE.start(target, target, rest)
    assert apart(ONE.apply(target, 0.01, same)[0], target) < 1e-7


@pytest.mark.parametrize("half_life", [0.0, -1.0, np.nan, np.inf])
def test_invalid_half_lives_are_refused(half_life: float) -> None:
    with pytest.raises(BodysenseError, match=r"half-life .* s; give a positive number of seconds"):
        Inertialiser(half_life)
