"""The two networks of gloves as files: one fills markers, one tells joint angles (two-hands, Tables 1 and 2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from bodysense.body.glove import Glove, default_glove, hand_size, template
from bodysense.body.hand import hand_skeleton
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.completion.network import Network, NetworkFormat
from bodysense.devices.gloves.dense import DenseLayers, read_dense

MARKER_FORMAT = "bodysense glove markers 2"
JOINT_FORMAT = "bodysense glove joints 2"
MARKER_NETWORK = "glove_markers.onnx"
JOINT_NETWORK = "glove_joints.onnx"
_COMMAND = "bodysense train gloves"
_ALIKE = 1e-4  # m, or share of a size, by which two hands differ that are the same one


class HandNetwork(Protocol):
    """What answers for hands: markers (H, 27) and shapes (H, 87) in, markers (H, 27) or angles (H, 26) out."""

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        """Answer for H hands at the default size.

        The marker network sees markers registered onto the template, 0 where hidden; the joint network all of them, in
        the hand's axes by its alignment markers, from the wrist.
        """
        ...


@dataclass(frozen=True, eq=False)
class GloveNetwork:
    """A network of gloves, and its layers if it is made of dense ones alone."""

    network: Network
    layers: DenseLayers | None = None

    @property
    def name(self) -> str:
        """Its file's name."""
        return self.network.name

    @property
    def card(self) -> Mapping[str, Any]:
        """What its file says of it."""
        return self.network.card

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        """See `HandNetwork`; single precision."""
        if self.layers is None:
            (answer,) = self.network.run({"markers": markers, "hand": hand}).values()
            return answer
        read = [markers]
        if self.layers.width in (36, 124):  # also which markers are known, as in models/glove.py
            read.append(np.logical_or.reduce(markers.reshape(len(markers), 9, 3), axis=2).astype(np.float32))
        if self.layers.width in (115, 124):
            read += [hand, hand.any(axis=1, keepdims=True).astype(np.float32)]
        return self.layers.run(np.concatenate(read, axis=1))


def load_marker_network(path: str | Path | None = None) -> GloveNetwork:
    """The network that fills markers: a path, or None for the packaged one. BodysenseError for a file not ours."""
    return _load(path, NetworkFormat(MARKER_FORMAT, "glove marker network", _COMMAND, packaged=MARKER_NETWORK))


def load_joint_network(path: str | Path | None = None) -> GloveNetwork:
    """The network that tells joint angles: a path, or None for the packaged one. BodysenseError for a file not ours."""
    return _load(path, NetworkFormat(JOINT_FORMAT, "glove joint network", _COMMAND, packaged=JOINT_NETWORK))


def _load(path: str | Path | None, format: NetworkFormat) -> GloveNetwork:
    network = Network.open(path, format)
    slow, fast = GloveNetwork(network), GloveNetwork(network, read_dense(network.source.read_bytes()))
    return fast if fast.layers is not None and _agree(fast, slow) else slow


def _agree(fast: GloveNetwork, slow: GloveNetwork) -> bool:
    """Whether both answer the same, whatever the file is: of hands with all markers and with some hidden."""
    rng = np.random.default_rng(0)
    markers, hand = rng.normal(scale=0.1, size=(8, 27)), rng.uniform(0.02, 0.1, size=(8, 87))
    markers.reshape(8, 9, 3)[rng.random((8, 9)) < 0.3] = 0.0
    hand[:2] = 0.0
    given = markers.astype(np.float32), hand.astype(np.float32)
    if fast.layers is None or fast.layers.width not in (27, 36, 115, 124):
        return False
    return bool(np.allclose(fast.run(*given), slow.run(*given), rtol=1e-4, atol=1e-4))


def size_ratios(hands: Sequence[Skeleton]) -> np.ndarray:
    """(H,) how many times as long as the default hand each one is: networks see all hands at one size."""
    return np.array([hand_size(hand) for hand in hands]) / default_glove().size


def known_shapes(hands: Sequence[Skeleton], gloves: Sequence[Glove]) -> np.ndarray:
    """(H, 87) single precision: what networks know of each hand, resting offsets and template, at one size.

    Zeros, nothing, of the default hand at another size than its own: it stands in for hands of which the size alone was
    measured. At its own size it is the likeliest hand.
    """
    shapes = np.stack([_shape(*worn) for worn in zip(hands, gloves, strict=True)])
    resized = abs(size_ratios(hands) - 1) > _ALIKE
    unmeasured = resized & (abs(shapes - _default_shape()) < _ALIKE).all(axis=1)
    return np.where(unmeasured[:, None], 0.0, shapes).astype(np.float32)


def _shape(hand: Skeleton, glove: Glove) -> np.ndarray:
    """(87,) m."""
    values = np.concatenate([hand.rest_offset[1:].ravel(), template(glove, hand).ravel()])
    return values / size_ratios([hand])


@lru_cache(maxsize=1)
def _default_shape() -> np.ndarray:
    return _shape(hand_skeleton(default_skeleton(), "left"), default_glove())
