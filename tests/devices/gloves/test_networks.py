"""Network files of gloves, and the shapes of hands that they receive."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.hands.glove import default_glove
from bodysense.body.hands.hand_family import COUNT, hand_of
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.networks import known_shapes, load_joint_network, load_marker_network, size_ratios
from bodysense.errors import BodysenseError

OTHER = Path(str(files("bodysense.weights").joinpath("body_vae.onnx")))


def test_packaged_networks_are_small() -> None:
    for name in ("glove_markers.onnx", "glove_joints.onnx"):
        assert len(files("bodysense.weights").joinpath(name).read_bytes()) <= 1_000_000


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match="no such model file"):
        load_marker_network(tmp_path / "none.onnx")
    with pytest.raises(BodysenseError, match="not a bodysense glove joint network"):
        load_joint_network(OTHER)


def test_shapes_are_independent_of_size(hand: Skeleton) -> None:
    bigger = hand.with_offsets(1.3 * hand.rest_offset)
    np.testing.assert_allclose(size_ratios([hand, bigger]), [1.0, 1.3])
    drawn = hand_of(np.random.default_rng(1).standard_normal(COUNT))
    twice = drawn.skeleton.with_offsets(2 * drawn.skeleton.rest_offset)
    shapes = known_shapes([drawn.skeleton, twice], [drawn.glove] * 2)
    np.testing.assert_allclose(shapes[0], shapes[1], atol=1e-7)
    assert shapes.any(axis=1).all()


def test_the_default_hand_at_another_size_has_an_unknown_shape(hand: Skeleton) -> None:
    bigger = hand.with_offsets(1.3 * hand.rest_offset)
    own, resized = known_shapes([hand, bigger], [default_glove()] * 2)
    assert own.any() and not resized.any()
