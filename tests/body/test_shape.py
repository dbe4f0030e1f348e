"""The shape space: whole, symmetric bodies of plausible proportions, and the likeliest one given lengths."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.body.shape import SPLITS, Measured, Split, sample_bodies, shape_space, stature
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError

SKELETON = default_skeleton()
SPACE = shape_space()
LIMBS = (
    *(("left_hip", "left_knee"), ("left_knee", "left_ankle"), ("left_hip", "left_ankle"), ("left_hip", "right_hip")),
    *(("left_shoulder", "left_elbow"), ("left_elbow", "left_wrist"), ("left_shoulder", "right_shoulder")),
)


def positions(offsets: np.ndarray) -> np.ndarray:
    return SKELETON.path @ offsets + offsets[..., :1, :]


def distance(offsets: np.ndarray, start: str, end: str) -> np.ndarray:
    position = positions(offsets)
    return np.linalg.norm(position[..., SKELETON.index(start), :] - position[..., SKELETON.index(end), :], axis=-1)


def somebody(seed: int) -> np.ndarray:
    return np.clip(np.random.default_rng(seed).standard_normal(SPACE.size), -2, 2)


def test_the_space_is_symmetric_to_the_last_bit() -> None:
    for values in (SPACE.mean, SPACE.components):
        np.testing.assert_array_equal(values, values[..., SKELETON.mirror, :] * [-1, 1, 1])
    assert 0.99 < SPACE.share.sum() <= 1
    assert (np.diff(SPACE.share) < 0).all()


@pytest.mark.parametrize("split", SPLITS)
def test_samples_stand_in_a_t_pose(split: Split) -> None:
    offsets = sample_bodies(split, 500)
    assert offsets.shape == (500, 65, 3)
    assert offsets.dtype == np.float64
    np.testing.assert_allclose(offsets, offsets[:, SKELETON.mirror] * [-1, 1, 1], atol=1e-15)
    position = positions(offsets)
    at = {name: position[:, index] for index, name in enumerate(SKELETON.points)}
    np.testing.assert_array_equal(at["pelvis"][:, [0, 2]], 0)  # over the origin
    lowest = position[..., 1].min(axis=1)
    assert (lowest > 0.005).all()  # the points of the toes are inside them
    assert (lowest < 0.025).all()
    for upper, lower in (("hip", "knee"), ("knee", "ankle")):
        bone = at[f"left_{lower}"] - at[f"left_{upper}"]
        np.testing.assert_allclose(bone[:, [0, 2]], 0, atol=1e-12)
        assert (bone[:, 1] < -0.25).all()
    for inner, outer in (("shoulder", "elbow"), ("elbow", "wrist")):
        bone = at[f"left_{outer}"] - at[f"left_{inner}"]
        np.testing.assert_allclose(bone[:, 1:], 0, atol=1e-12)
        assert (bone[:, 0] > 0.15).all()
    assert (at["left_toe"][:, 2] > at["left_ankle"][:, 2] + 0.1).all()  # facing +Z
    column = np.stack([at[name][:, 1] for name in ("left_hip", "spine1", "spine2", "spine3", "neck", "head")])
    assert (np.diff(column, axis=0) > 0.02).all()


def test_splits_are_disjoint_and_longer_draws_begin_alike() -> None:
    bodies = {split: sample_bodies(split, 300) for split in SPLITS}
    everybody = np.concatenate(list(bodies.values())).reshape(900, -1)
    assert len(np.unique(everybody, axis=0)) == 900
    for split in SPLITS:
        np.testing.assert_array_equal(sample_bodies(split, 900)[:300], bodies[split])
        assert not np.array_equal(sample_bodies(split, 300, seed=1), bodies[split])
    assert sample_bodies("train", 0).shape == (0, 65, 3)


def test_proportions_are_those_of_adults() -> None:
    offsets = sample_bodies("train", 3000)
    tall = stature(offsets)
    assert tall.min() >= 1.45
    assert tall.max() <= 2.05
    np.testing.assert_allclose(np.quantile(tall, [0.05, 0.5, 0.95]), [1.545, 1.695, 1.845], atol=0.015)
    legs = positions(offsets)[:, SKELETON.index("left_hip"), 1] / tall
    span = distance(offsets, "left_middle_tip", "right_middle_tip") / tall
    shoulders = distance(offsets, "left_shoulder", "right_shoulder") / tall
    for share, mean, deviation in ((legs, 0.533, 0.0145), (span, 1.015, 0.033), (shoulders, 0.201, 0.0105)):
        assert share.mean() == pytest.approx(mean, rel=0.01)
        assert share.std() == pytest.approx(deviation, rel=0.2)


@pytest.mark.parametrize("seed", range(2))
def test_the_likeliest_body_has_the_known_lengths(seed: int) -> None:
    truth = SPACE.offsets(somebody(seed))
    known = {pair: Measured(float(distance(truth, *pair)), 0.001) for pair in LIMBS}
    found = SPACE.likeliest(known, Measured(float(stature(truth)), 0.001))
    offsets = SPACE.offsets(found.coefficients)
    for pair in LIMBS:
        assert distance(offsets, *pair) == pytest.approx(distance(truth, *pair), abs=1e-3)
    assert stature(offsets) == pytest.approx(stature(truth), abs=1e-3)


@pytest.mark.parametrize("height", [1.45, 1.6, 1.8, 2.05])
def test_stature_equals_the_known_height(height: float) -> None:
    found = SPACE.likeliest(height=Measured(height, 0.001))
    assert SPACE.stature(found.coefficients) == pytest.approx(height, abs=2e-3)
    np.testing.assert_array_equal(found.skeleton.rest_offset, SPACE.offsets(found.coefficients))


def test_known_lengths_reduce_the_remaining_uncertainty() -> None:
    truth = SPACE.offsets(somebody(1))
    estimates = [SPACE.likeliest()]
    np.testing.assert_array_equal(estimates[0].coefficients, 0)
    np.testing.assert_array_equal(estimates[0].deviation, 1)
    for count in range(1, len(LIMBS) + 1):
        lengths = {pair: Measured(float(distance(truth, *pair)), 0.01) for pair in LIMBS[:count]}
        estimates.append(SPACE.likeliest(lengths))
    for before, after in pairwise(estimates):
        assert (after.deviation <= before.deviation + 1e-3).all()  # about: bones turn a little with the shape
        assert np.linalg.slogdet(after.covariance)[1] < np.linalg.slogdet(before.covariance)[1]
    knee, elbow = SKELETON.index("left_knee"), SKELETON.index("left_elbow")
    assert estimates[1].bone_deviation[knee] < 0.01
    assert estimates[0].bone_deviation[knee] > 0.02
    assert estimates[-1].bone_deviation[elbow] < 0.6 * estimates[0].bone_deviation[elbow]


def test_deviations_predict_the_errors_of_bones() -> None:
    """Over people and noise, the ratio of bone errors to deviations is about 1."""
    rng = np.random.default_rng(5)
    ratios = []
    for coefficients in rng.standard_normal((200, SPACE.size)):
        truth = SPACE.offsets(coefficients)
        noisy = {pair: float(distance(truth, *pair)) + 0.01 * rng.standard_normal() for pair in LIMBS}
        found = SPACE.likeliest({pair: Measured(value, 0.01) for pair, value in noisy.items()})
        error = found.skeleton.bone_length - np.linalg.norm(truth, axis=1)
        ratios.append(error[1:] / found.bone_deviation[1:])
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1, abs=0.1)


@given(st.lists(st.floats(0.05, 1.5), min_size=7, max_size=7), st.floats(1.0, 2.3))
def test_any_measurements_give_a_finite_body(values: list[float], height: float) -> None:
    lengths = {pair: Measured(value, 0.01) for pair, value in zip(LIMBS, values, strict=True)}
    found = SPACE.likeliest(lengths, Measured(height, 0.01))
    assert np.isfinite(found.coefficients).all()
    assert np.isfinite(found.bone_deviation).all()


def test_batches_and_single_shapes_agree() -> None:
    shapes = np.random.default_rng(0).standard_normal((4, 3, SPACE.size))
    offsets = SPACE.offsets(shapes)
    assert offsets.shape == (4, 3, 65, 3)
    np.testing.assert_allclose(offsets[2, 1], SPACE.offsets(shapes[2, 1]), atol=1e-14)
    np.testing.assert_allclose(SPACE.stature(shapes)[2, 1], SPACE.stature(shapes[2, 1]))
    skeleton = SPACE.skeleton_of(shapes[0, 0])
    assert skeleton.points == SKELETON.points
    assert SPACE.stature(shapes[0, 0]) == pytest.approx(skeleton.height, abs=0.025)


def test_invalid_measurements_are_refused() -> None:
    with pytest.raises(BodysenseError, match="split 'tset' of bodies is unknown; give 'train', 'validation', 'test'"):
        sample_bodies("tset", 1)  # pyright: ignore[reportArgumentType]
    with pytest.raises(BodysenseError, match="-1 bodies cannot be drawn; give a count"):
        sample_bodies("train", -1)
    with pytest.raises(BodysenseError, match=r"\(3,\) coefficients: the last axis must hold 16"):
        SPACE.offsets(np.zeros(3))
    with pytest.raises(BodysenseError, match="unknown joint 'left_hipp'; this skeleton has left_hip"):
        SPACE.likeliest({("left_hipp", "left_knee"): Measured(0.4, 0.01)})
    with pytest.raises(BodysenseError, match="distance of 'head' from itself is no length"):
        SPACE.likeliest({("head", "head"): Measured(0.4, 0.01)})
    for value in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(BodysenseError, match="must be positive and finite; give"):
            Measured(value, 0.01)
        with pytest.raises(BodysenseError, match=r"must be positive and finite; give 0\.001"):
            Measured(0.4, value)
