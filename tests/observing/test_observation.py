"""Observations: checks, construction, and the order of their points on a skeleton."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.pose import forward_kinematics, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.observing.checks import check_observation, check_order
from bodysense.observing.observation import (
    HEADSET_ACCURACY,
    OPTICAL_ACCURACY,
    TRACKER_ACCURACY,
    Observation,
    accuracy_like,
    observe,
    usual_accuracy,
)
from bodysense.observing.points import chosen_points, joined_points, observed_points
from bodysense.tracking.estimate import Estimate

SKELETON = default_skeleton()


def example(batch: tuple[int, ...] = (), frames: int = 4) -> Observation:
    """Two points: the second is hidden in the first frame, and the first has the identity as rotation."""
    rng = np.random.default_rng(0)
    position = rng.normal(size=(*batch, frames, 2, 3))
    rotation = np.full((*batch, frames, 2, 4), np.nan)
    rotation[..., 0, :] = [1.0, 0.0, 0.0, 0.0]
    position[..., 0, 1, :] = np.nan
    return Observation(
        points=("head", "left_wrist"),
        position=position,
        rotation=rotation,
        has_position=np.isfinite(position[..., 0]),
        has_rotation=np.isfinite(rotation[..., 0]),
        accuracy=np.full((*batch, frames, 2), 0.01),
        time=np.arange(frames) / 30,
    )


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2)])
def test_valid_observations_pass(batch: tuple[int, ...]) -> None:
    observation = example(batch)
    assert check_observation(observation) is observation


@pytest.mark.parametrize("field", ["position", "rotation", "has_position", "has_rotation", "accuracy"])
def test_shapes_that_do_not_agree_are_refused(field: str) -> None:
    good = example((2,))
    value = getattr(good, field)
    for bad in (value[..., :1], np.concatenate([value, value]), value[None], np.zeros(())):
        with pytest.raises(
            BodysenseError, match=r"mine: (position|has_position|rotation|has_rotation|accuracy) has shape \(.*need"
        ):
            check_observation(replace(good, **{field: bad}), "mine")


def test_times_have_one_axis() -> None:
    with pytest.raises(BodysenseError, match=r"mine: time has shape \(4, 1\); give one number a frame, in seconds"):
        check_observation(replace(example(), time=np.arange(4.0)[:, None]), "mine")


@pytest.mark.parametrize("length", [0.0, 1.5, 1e200])
def test_rotations_are_unit_quaternions(length: float) -> None:
    observation = example((3, 1, 2))
    observation.rotation[..., 2, 0, 0] = length
    with pytest.raises(
        BodysenseError, match=r"the rotation of 'head' at frame 2 has length (0|1\.5|inf); give unit quat"
    ):
        check_observation(observation)
    observation.has_rotation[..., 2, 0] = False
    check_observation(observation)


@pytest.mark.parametrize("metres", [-0.01, 0.0, np.nan, np.inf])
def test_accuracies_are_positive_where_a_position_is_tracked(metres: float) -> None:
    observation = example()
    observation.accuracy[..., 0, 1] = metres  # hidden there
    check_observation(observation)
    observation.accuracy[..., 2, 0] = metres
    with pytest.raises(BodysenseError, match=rf"mine: the accuracy of 'head' at frame 2 is {metres:g}; give the exp"):
        check_observation(observation, "mine")


def test_far_positions_are_refused() -> None:
    observation = example()
    observation.position[2, 0] = [0.0, 1.5, -1600.0]
    with pytest.raises(BodysenseError, match=r"mine: 'head' is 1600 m from the origin at frame 2, but at most 1000 m"):
        check_observation(observation, "mine")
    check_observation(observation, "mine", farthest=np.inf)
    observation.has_position[2, 0] = False
    check_observation(observation)


def test_unix_times_are_valid() -> None:
    check_observation(replace(example(), time=1.7e9 + np.arange(4) / 90))
    with pytest.raises(BodysenseError, match=r"time goes from 1700000000 s to 1699999999\.98889 s"):
        check_observation(replace(example(), time=1.7e9 - np.arange(4) / 90))


@pytest.mark.parametrize("before", [None, np.nan])
def test_frames_come_in_order(before: float | None) -> None:
    check_order(-3.0, before, "mine")
    check_order(1.7e9 + 1e-3, 1.7e9, "mine")
    for time, last, text in (
        (1.0, 1.0, "mine: a frame at 1 s came after one at 1 s; give frames in order of time, in seconds"),
        (1.7e9, 1.7e9 + 0.01, "mine: a frame at 1700000000 s came after one at 1700000000.01 s; give"),
        (np.nan, 0.5, "mine: a frame at nan s came after one at 0.5 s; give"),
        (np.inf, before, "mine: a frame at inf s; give"),
    ):
        with pytest.raises(BodysenseError, match=re.escape(text)):
            check_order(time, last, "mine")


def test_usual_accuracies() -> None:
    names = ("head", "left_controller", "left_glove_thumb_tip", "pelvis")
    expected = [HEADSET_ACCURACY, HEADSET_ACCURACY, OPTICAL_ACCURACY, TRACKER_ACCURACY]
    np.testing.assert_array_equal(usual_accuracy(names), expected)
    mask = np.zeros((2, 5, 4), dtype=bool)
    np.testing.assert_array_equal(accuracy_like(mask, usual_accuracy(names)), np.tile(expected, (2, 5, 1)))
    accuracy_like(mask, 0.01)[0, 0, 0] = 1.0  # its own memory


def test_a_slice_selects_frames() -> None:
    observation = example(frames=6)
    part = observation[2:5]
    assert len(part) == 3 and len(observation) == 6
    np.testing.assert_array_equal(part.time, observation.time[2:5])
    np.testing.assert_array_equal(part.position, observation.position[2:5])
    check_observation(part)


@pytest.mark.parametrize("batch", [(), (3, 1, 2)])
def test_points_are_put_in_the_order_of_the_skeleton(batch: tuple[int, ...]) -> None:
    observation = example(batch)
    position, rotation, has_position, has_rotation = observed_points(observation, SKELETON)
    assert position.shape == (*batch, 4, len(SKELETON.points), 3)
    head, wrist = SKELETON.indices(observation.points)
    np.testing.assert_array_equal(position[..., [head, wrist], :], observation.position)
    np.testing.assert_array_equal(rotation[..., [head, wrist], :], observation.rotation)
    np.testing.assert_array_equal(has_position[..., [head, wrist]], observation.has_position)
    others = np.setdiff1d(np.arange(len(SKELETON.points)), [head, wrist])
    assert not has_position[..., others].any() and not has_rotation[..., others].any()
    assert np.isnan(position[..., others, :]).all() and np.isnan(rotation[..., others, :]).all()
    assert has_rotation.sum() == observation.has_rotation.sum()


def test_the_estimate_of_one_of_several_people() -> None:
    people, frames, count = 3, 4, len(SKELETON.points)
    rng = np.random.default_rng(0)
    size = rng.uniform(0.8, 1.2, (people, 1, 1, 1))
    pose = rest_pose(SKELETON, (people, frames))
    offset = np.broadcast_to(size * SKELETON.rest_offset, (people, frames, count, 3))
    estimate = Estimate(
        pose=pose,
        points=np.asarray(forward_kinematics(pose, offset)[0]),
        measured=rng.random((people, frames, count)) < 0.5,
        confidence=rng.random((people, frames, count)),
        bound=rng.random((people, frames, count)),
        contact=rng.random((people, frames, 4)),
        rest_offset=offset,
    )
    one = estimate.of(2)
    np.testing.assert_allclose(one.pose.skeleton.rest_offset, size[2, 0] * SKELETON.rest_offset)
    np.testing.assert_allclose(forward_kinematics(one.pose)[0], one.points)
    for name in ("points", "measured", "confidence", "bound", "contact", "rest_offset"):
        np.testing.assert_array_equal(getattr(one, name), getattr(estimate, name)[2])


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("Head", r"did you mean head\?"),
        ("left_wirst", "did you mean left_wrist"),
        ("left controler", "did you mean left_controller"),
        ("nose", "points are those of bs.default_skeleton"),
    ],
)
@pytest.mark.parametrize("unit", [None, "m"])
def test_observe_refuses_unknown_points(name: str, answer: str, unit: str | None) -> None:
    poses = {"head": ([0.0, 1.6, 0.0], None), name: ([0.1, 1.5, 0.0], None)}
    with pytest.raises(BodysenseError, match=f"observe: unknown point {name!r}; {answer}"):
        observe(0.0, poses, unit=unit)


def test_a_point_that_the_skeleton_lacks_is_refused() -> None:
    with pytest.raises(BodysenseError, match=r"unknown joint 'left_wirst'; this skeleton has left_wrist"):
        observed_points(replace(example(), points=("head", "left_wirst")), SKELETON)


def test_a_frame_of_named_poses_is_an_observation() -> None:
    poses = {
        "head": ([0.0, 1.6, 0.0], [1.0, 0.0, 0.0, 0.0]),
        "left_wrist": (None, None),
        "left_knee": (None, np.array([0.0, 1.0, 0.0, 0.0])),
        "pelvis": ((0.0, 1.0, 0.0), None),
    }
    seen = observe(2.0, poses)
    assert seen.points == tuple(poses)
    assert seen.has_position.tolist() == [[True, False, False, True]]
    assert seen.has_rotation.tolist() == [[True, False, True, False]]
    assert seen.accuracy.tolist() == [[HEADSET_ACCURACY, HEADSET_ACCURACY, TRACKER_ACCURACY, TRACKER_ACCURACY]]
    assert observe(2.0, poses, accuracy=0.02).accuracy.tolist() == [[0.02] * 4]
    assert len(observe(0.0, {})) == 1


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (([0.0, 1.6], None), r"head: its position has shape \(2,\); give 3 numbers, or None"),
        ((None, [1.0, 0.0, 0.0]), r"head: its rotation has shape \(3,\); give 4 numbers, or None"),
        (([0.0, np.nan, 0.0], None), "its position is not finite"),
        ((None, [1.0, 1.0, 0.0, 0.0]), "give unit quaternions"),
    ],
)
def test_invalid_poses_are_refused(pose: tuple, message: str) -> None:
    with pytest.raises(BodysenseError, match=message):
        observe(0.0, {"head": pose})


def test_accelerations_follow_points_and_frames() -> None:
    good = example((2,))
    felt = np.random.default_rng(1).normal(size=good.position.shape)
    felt[..., 0, 1, :] = np.nan
    measured = replace(good, acceleration=felt)
    assert check_observation(measured) is measured
    part = measured[1:3].acceleration
    assert part is not None and np.array_equal(part, felt[..., 1:3, :, :])
    chosen = chosen_points(measured, [1]).acceleration
    assert chosen is not None and np.array_equal(chosen, felt[..., 1:, :], equal_nan=True)
    assert good[1:].acceleration is None and chosen_points(good, [0]).acceleration is None


def test_joined_points_keep_their_accelerations() -> None:
    bare = example(())
    felt = np.random.default_rng(2).normal(size=bare.position.shape)
    measured = chosen_points(replace(bare, acceleration=felt), [0])
    other = chosen_points(bare, [1])
    assert joined_points(other, chosen_points(bare, [0])).acceleration is None
    for parts, count in (((measured, other), 0), ((other, measured), 1)):
        found = joined_points(*parts).acceleration
        assert found is not None
        assert np.array_equal(found[:, count], felt[:, 0]) and np.isnan(found[:, 1 - count]).all()


def test_impossible_accelerations_are_refused() -> None:
    good = example()
    for broken, text in ((np.inf, "inf m/s²"), (-2000.0, "2000 m/s², but at most 1000")):
        felt = np.zeros(good.position.shape)
        felt[2, 1, 0] = broken
        with pytest.raises(BodysenseError, match=f"acceleration of 'left_wrist' at frame 2 is {text}"):
            check_observation(replace(good, acceleration=felt))
    with pytest.raises(BodysenseError, match="acceleration has shape"):
        check_observation(replace(good, acceleration=np.zeros((4, 2))))


@given(st.lists(st.sampled_from(["head", "left_wrist", "pelvis", "left_index1"]), max_size=4, unique=True), st.data())
@settings(max_examples=60, deadline=None)
def test_a_plain_frame_equals_one_of_arrays(points: list[str], data: st.DataObject) -> None:
    """Numbers of one person take a path without arrays; a batch of one does not."""
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    kinds = data.draw(st.lists(st.sampled_from(["place", "turn", "both", "none"]), min_size=4, max_size=4))
    poses: dict[str, tuple[list[float] | None, list[float] | None]] = {}
    for point, kind in zip(points, kinds, strict=False):
        turn = rng.normal(size=4)
        turn /= np.linalg.norm(turn)
        place = rng.normal([0.0, 1.2, 0.0], 0.3).tolist()
        poses[point] = (
            place if kind in ("place", "both") else None,
            turn.tolist() if kind in ("turn", "both") else None,
        )
    accuracy = data.draw(st.sampled_from([None, 0.02]))
    if not any(value is not None for pose in poses.values() for value in pose):
        return
    one = observe(2.5, poses, accuracy)
    many = {name: tuple(None if v is None else np.array([v]) for v in pose) for name, pose in poses.items()}
    other = observe(2.5, many, accuracy)  # pyright: ignore[reportArgumentType]
    assert one.points == other.points and one.time == other.time
    for name in ("position", "rotation", "has_position", "has_rotation", "accuracy"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name)[0])


@pytest.mark.parametrize("accuracy", [0.0, -1.0, np.nan, np.inf])
def test_a_frame_without_a_possible_accuracy_is_refused(accuracy: float) -> None:
    with pytest.raises(BodysenseError, match="accuracy of 'head'"):
        observe(0.0, {"head": ([0.0, 1.6, 0.0], None)}, accuracy)
