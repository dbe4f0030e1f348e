"""Network files of gloves: one network fills markers, one predicts joint angles (two-hands, Tables 1 and 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np

from bodysense.body.hands.glove import Glove, default_glove, hand_size, template
from bodysense.body.hands.hand import hand_skeleton
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.weights.formats import NetworkFormat
from bodysense.weights.network import Network

MARKER_FORMAT = "bodysense glove markers 2"
JOINT_FORMAT = "bodysense glove joints 2"
MARKER_NETWORK = "glove_markers.onnx"
JOINT_NETWORK = "glove_joints.onnx"
_COMMAND = "bodysense train gloves"
_TOLERANCE = 1e-4  # m, or share of a size; hands that differ less are equal


class HandNetwork(Protocol):
    """A network for hands: markers (H, 27) and shapes (H, 87) in, markers (H, 27) or angles (H, 26) out."""

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        """Predict for H hands at the default size.

        The marker network's input is markers registered onto the template, 0 where hidden; the joint network's is all
        markers in the hand's axes by its alignment markers, from the wrist.
        """
        ...


@dataclass(frozen=True, eq=False)
class GloveNetwork:
    """A glove network from a file."""

    network: Network

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        """See `HandNetwork`; inputs and outputs have single precision."""
        (answer,) = self.network.run({"markers": markers, "hand": hand}).values()
        return answer


def load_marker_network(path: str | Path | None = None) -> GloveNetwork:
    """Load the network that fills markers from a path, or the packaged one. Raises BodysenseError for other files."""
    form = NetworkFormat(MARKER_FORMAT, "glove marker network", _COMMAND, packaged=MARKER_NETWORK)
    return GloveNetwork(Network.open(path, form))


def load_joint_network(path: str | Path | None = None) -> GloveNetwork:
    """Load the network of joint angles from a path, or the packaged one. Raises BodysenseError for other files."""
    form = NetworkFormat(JOINT_FORMAT, "glove joint network", _COMMAND, packaged=JOINT_NETWORK)
    return GloveNetwork(Network.open(path, form))


def size_ratios(hands: Sequence[Skeleton]) -> np.ndarray:
    """Return sizes (H,) relative to the default hand. Networks see all hands at the default size."""
    return np.array([hand_size(hand) for hand in hands]) / default_glove().size


def known_shapes(hands: Sequence[Skeleton], gloves: Sequence[Glove]) -> np.ndarray:
    """Return (H, 87), single precision: each hand's resting offsets and template, at the default size.

    They are zeros for the default hand at another size than its own, which represents hands with only a measured size.
    At its own size it is the most likely hand.
    """
    shapes = np.stack([_shape(hand, glove) for hand, glove in zip(hands, gloves, strict=True)])
    resized = abs(size_ratios(hands) - 1) > _TOLERANCE
    unmeasured = resized & (abs(shapes - _default_shape()) < _TOLERANCE).all(axis=1)
    return np.where(unmeasured[:, None], 0.0, shapes).astype(np.float32)


def _shape(hand: Skeleton, glove: Glove) -> np.ndarray:
    """Return the shape (87,) m of one hand at the default size."""
    values = np.concatenate([hand.rest_offset[1:].ravel(), template(glove, hand).ravel()])
    return values / size_ratios([hand])


@lru_cache(maxsize=1)
def _default_shape() -> np.ndarray:
    return _shape(hand_skeleton(default_skeleton(), "left"), default_glove())
