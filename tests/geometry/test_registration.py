from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bodysense.geometry.registration import register, to_hand, to_world


def test_equals_scipy_on_noisy_markers() -> None:
    rng = np.random.default_rng(0)
    template, truth = (
        rng.normal(scale=0.05, size=(20, 9, 3)),
        Rotation.from_quat(np.random.default_rng(1).normal(size=(20, 4))),
    )
    known = rng.random((20, 9)) < 0.7
    known[:, :3] = True
    markers = np.einsum("hij,hmj->hmi", truth.as_matrix(), template) + rng.normal(size=(20, 1, 3))
    markers += rng.normal(scale=0.004, size=markers.shape)
    rotation, translation = register(template, np.where(known[..., None], markers, np.nan), known)
    for k in range(20):
        a, b = template[k, known[k]], markers[k, known[k]]
        oracle = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))[0]
        np.testing.assert_allclose(rotation[k], oracle.as_matrix(), atol=2e-5)  # the pull toward the last rotation
        np.testing.assert_allclose(translation[k], b.mean(axis=0) - rotation[k] @ a.mean(axis=0), atol=1e-12)


def test_of_mirrored_markers_the_best_proper_rotation() -> None:
    rng = np.random.default_rng(2)
    template = rng.normal(size=(9, 3))
    markers = template * [-1, 1, 1]
    known = np.ones((1, 9), dtype=bool)
    rotation, _ = register(template, markers[None], known)
    assert np.linalg.det(rotation[0]) == pytest.approx(1)
    oracle = Rotation.align_vectors(markers - markers.mean(axis=0), template - template.mean(axis=0))[0]
    np.testing.assert_allclose(rotation[0], oracle.as_matrix(), atol=1e-6)


@settings(max_examples=30)
@given(st.lists(st.booleans(), min_size=9, max_size=9), st.integers(0, 1000), st.sampled_from(["space", "line", "one"]))
def test_any_markers_make_a_rotation(mask: list[bool], seed: int, shape: str) -> None:
    rng = np.random.default_rng(seed)
    template = rng.normal(scale=0.1, size=(9, 3))
    template = {"space": template, "line": template[:, :1] * np.ones(3), "one": 0 * template}[shape]
    known = np.array([mask])
    last = Rotation.from_quat(np.random.default_rng(seed).normal(size=(1, 4))).as_matrix(), rng.normal(size=(1, 3))
    markers = np.where(known[..., None], rng.normal(size=(1, 9, 3)), np.nan)
    rotation, translation = register(template, markers, known, last)
    np.testing.assert_allclose(rotation[0] @ rotation[0].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation[0]) == pytest.approx(1)
    assert np.isfinite(translation).all()


def test_what_is_left_open_is_as_before() -> None:
    template = np.random.default_rng(3).normal(scale=0.05, size=(9, 3))
    last = Rotation.from_rotvec([[0.3, -0.2, 0.9]]).as_matrix(), np.array([[1.0, 2.0, 3.0]])
    markers = to_world(template[None], *last)
    nothing = np.zeros((1, 9), dtype=bool)
    rotation, translation = register(template, np.full((1, 9, 3), np.nan), nothing, last)
    np.testing.assert_allclose(rotation, last[0], atol=1e-9)
    np.testing.assert_array_equal(translation, last[1])
    one = nothing.copy()
    one[0, 4] = True
    rotation, translation = register(template, markers + 0.1, one, last)
    np.testing.assert_allclose(rotation, last[0], atol=1e-9)
    np.testing.assert_allclose(translation, last[1] + 0.1, atol=1e-9)
    two = one.copy()
    two[0, 7] = True
    turn = Rotation.from_rotvec([0.0, 0.4, 0.0]).as_matrix()
    rotation, _ = register(template, markers @ turn.T, two, last)
    line = template[4] - template[7]
    np.testing.assert_allclose(rotation[0] @ line, turn @ last[0][0] @ line, atol=1e-6)
    # About the line it turns no more than the shortest arc does.
    axis = turn @ last[0][0] @ line
    extra = Rotation.from_matrix(rotation[0] @ last[0][0].T).as_rotvec()
    assert abs(extra @ axis) / np.linalg.norm(axis) < 1e-6


def test_there_and_back() -> None:
    rng = np.random.default_rng(4)
    points, rotation = rng.normal(size=(5, 9, 3)), Rotation.from_quat(np.random.default_rng(4).normal(size=(5, 4)))
    translation = rng.normal(size=(5, 3))
    there = to_world(points, rotation.as_matrix(), translation)
    np.testing.assert_allclose(to_hand(there, rotation.as_matrix(), translation), points, atol=1e-12)
