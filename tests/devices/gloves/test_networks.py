from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.glove import default_glove
from bodysense.body.hand_family import COUNT, hand_of
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.hands import load_glove_models
from bodysense.devices.gloves.networks import (
    for_hands,
    known_shapes,
    load_joint_network,
    load_marker_network,
    read_dense,
    size_ratios,
)
from bodysense.errors import BodysenseError

OTHER = Path(str(files("bodysense.weights").joinpath("body_vae.onnx")))


@pytest.mark.parametrize("hands", [1, 50])
def test_layers_answer_as_onnx_runtime_does(hands: int) -> None:
    models = load_glove_models()
    rng = np.random.default_rng(hands)
    markers = rng.normal(scale=0.1, size=(hands, 9, 3)).astype(np.float32)
    markers[rng.random((hands, 9)) < 0.3] = 0.0
    shapes = rng.uniform(0.02, 0.1, size=(hands, 87)).astype(np.float32)
    shapes[0] = 0.0
    for network in (models.markers, models.joints):
        assert network.layers is not None  # type: ignore[attr-defined]
        given = markers.reshape(hands, 27), shapes
        slow = replace(network, layers=None).run(*given)  # type: ignore[type-var]
        fast = network.run(*given)
        assert fast.shape == (hands, 27 if network is models.markers else 26)
        np.testing.assert_allclose(fast, slow, atol=1e-5)


@pytest.mark.parametrize("told", [1, 3])
def test_what_is_known_of_hands_is_added_once(told: int) -> None:
    models, rng = load_glove_models(), np.random.default_rng(told)
    markers = rng.normal(scale=0.1, size=(3, 9, 3)).astype(np.float32)
    known = rng.random((3, 9)) < 0.7
    markers[~known] = 0.0
    shapes = rng.uniform(0.02, 0.1, size=(told, 87)).astype(np.float32)
    shapes[0] = 0.0
    for network in (models.markers, models.joints):
        slow = network.run(markers.reshape(3, 27), np.broadcast_to(shapes, (3, 87)))
        for some in (None, known):
            fast = for_hands(network, shapes, some).run(markers.reshape(3, 27), np.full((3, 87), np.nan))
            np.testing.assert_allclose(fast, slow, atol=1e-5)
    whole = replace(models.markers, layers=None)  # type: ignore[type-var]
    assert for_hands(whole, shapes, known) is whole


def test_other_networks_and_files_are_not_read_as_layers() -> None:
    assert read_dense(OTHER.read_bytes()) is None
    assert read_dense(b"") is None


def test_packaged_networks_are_small() -> None:
    for name in ("glove_markers.onnx", "glove_joints.onnx"):
        assert len(files("bodysense.weights").joinpath(name).read_bytes()) <= 1_000_000


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match="no such model file"):
        load_marker_network(tmp_path / "none.onnx")
    with pytest.raises(BodysenseError, match="not a bodysense glove joint network"):
        load_joint_network(OTHER)


def test_networks_see_hands_at_one_size(hand: Skeleton) -> None:
    bigger = hand.with_offsets(1.3 * hand.rest_offset)
    np.testing.assert_allclose(size_ratios([hand, bigger]), [1.0, 1.3])
    worn = hand_of(np.random.default_rng(1).standard_normal(COUNT))
    twice = worn.skeleton.with_offsets(2 * worn.skeleton.rest_offset)
    shapes = known_shapes([worn.skeleton, twice], [worn.glove] * 2)
    np.testing.assert_allclose(shapes[0], shapes[1], atol=1e-7)
    assert shapes.any(axis=1).all()


def test_nothing_is_known_of_the_default_hand_at_another_size(hand: Skeleton) -> None:
    bigger = hand.with_offsets(1.3 * hand.rest_offset)
    own, resized = known_shapes([hand, bigger], [default_glove()] * 2)
    assert own.any() and not resized.any()
