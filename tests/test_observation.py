"""The waist: what an observation must agree on, and how its points find their place on a skeleton."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.observation import Observation, check_observation, observed_points

SKELETON = default_skeleton()


def example(batch: tuple[int, ...] = (), frames: int = 4) -> Observation:
    """Two points, of which the second is hidden in the first frame; the first is turned by nothing."""
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
        time=np.arange(frames) / 30,
    )


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2)])
def test_what_agrees_passes(batch: tuple[int, ...]) -> None:
    observation = example(batch)
    assert check_observation(observation) is observation


@pytest.mark.parametrize("batch", [(), (2,)])
@pytest.mark.parametrize("field", ["position", "rotation", "has_position", "has_rotation"])
def test_shapes_that_do_not_agree_are_refused(batch: tuple[int, ...], field: str) -> None:
    good = example(batch)
    value = getattr(good, field)
    for bad in (value[..., :1], np.concatenate([value, value]), value[None], np.zeros(())):
        with pytest.raises(
            BodysenseError, match=r"mine: (position|has_position|rotation|has_rotation) has shape \(.*need"
        ):
            check_observation(replace(good, **{field: bad}), "mine")


def test_times_are_a_list() -> None:
    with pytest.raises(BodysenseError, match=r"mine: time has shape \(4, 1\); give one number a frame, in seconds"):
        check_observation(replace(example(), time=np.arange(4.0)[:, None]), "mine")


@pytest.mark.parametrize("batch", [(), (3, 1, 2)])
@pytest.mark.parametrize("length", [0.0, 1.5, 1e200])
def test_rotations_are_unit_quaternions(batch: tuple[int, ...], length: float) -> None:
    observation = example(batch)
    observation.rotation[..., 2, 0, 0] = length
    with pytest.raises(
        BodysenseError, match=r"the rotation of 'head' at frame 2 has length (0|1\.5|inf); give unit quat"
    ):
        check_observation(observation)
    observation.has_rotation[..., 2, 0] = False
    check_observation(observation)


def test_a_slice_is_of_frames() -> None:
    observation = example(frames=6)
    part = observation[2:5]
    assert len(part) == 3 and len(observation) == 6
    np.testing.assert_array_equal(part.time, observation.time[2:5])
    np.testing.assert_array_equal(part.position, observation.position[2:5])
    check_observation(part)


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2)])
def test_points_find_their_place(batch: tuple[int, ...]) -> None:
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


def test_a_point_that_the_skeleton_lacks_is_refused() -> None:
    with pytest.raises(BodysenseError, match=r"unknown joint 'left_wirst'; this skeleton has left_wrist"):
        observed_points(replace(example(), points=("head", "left_wirst")), SKELETON)
