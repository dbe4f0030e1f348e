"""The two networks of gloves as files: one fills markers, one predicts joint angles (two-hands, Tables 1 and 2)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Protocol

import numpy as np

from bodysense.body.glove import Glove, default_glove, hand_size, template
from bodysense.body.hand import hand_skeleton
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.completion.network import Network, NetworkFormat

_VARINT, _BYTES, _WIDE, _NARROW = 0, 2, 1, 5  # wire types of protocol buffers
_TYPES = {1: np.dtype("<f4"), 10: np.dtype("<f2")}  # of ONNX tensors: single and half precision
# Numbers of fields: https://github.com/onnx/onnx/blob/main/onnx/onnx.proto3
_GRAPH, _NODE, _TENSOR, _INPUT, _KIND, _DIMENSION, _TYPE, _NAME, _RAW = 7, 1, 5, 1, 4, 1, 2, 8, 9
_OUTPUT = 2


@dataclass(frozen=True, eq=False)
class DenseLayers:
    """Layers x → max(x · weight + bias, 0), the last without the maximum."""

    weights: tuple[np.ndarray, ...]  # (inputs, outputs) each
    biases: tuple[np.ndarray, ...]  # (outputs,) each; the first also (H, outputs)

    @property
    def width(self) -> int:
        """Number of inputs."""
        return len(self.weights[0])

    def run(self, values: np.ndarray) -> np.ndarray:
        """Map (H, width) to (H, outputs), single precision."""
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values = values.dot(weight)
            values += bias
            np.maximum(values, 0.0, out=values)
        return values.dot(self.weights[-1]) + self.biases[-1]


def read_dense(file: bytes) -> DenseLayers | None:
    """Return the layers of an ONNX file that ends in Gemm, Relu, Gemm, …, Gemm; None for any other file."""
    graph = next((value for number, value in _fields(file) if number == _GRAPH), b"")
    fields = list(_fields(graph))
    tensors = dict(_tensor(value) for number, value in fields if number == _TENSOR)
    nodes = [_node(value) for number, value in fields if number == _NODE]
    chain = [node for node in nodes if node[0] in ("Gemm", "Relu")]
    expected = ["Gemm" if place % 2 == 0 else "Relu" for place in range(len(chain))]
    for kind, inputs, outputs in nodes:
        if kind == "Cast" and inputs[0] in tensors:
            tensors[outputs[0]] = tensors[inputs[0]]
    whole = all(name in tensors for kind, inputs, _ in chain if kind == "Gemm" for name in inputs[1:])
    joined = all(after[1][0] == before[2][0] for before, after in pairwise(chain))
    if not chain or len(chain) % 2 == 0 or [node[0] for node in chain] != expected or not (whole and joined):
        return None
    layers = [inputs[1:] for kind, inputs, _ in chain if kind == "Gemm"]
    weights = tuple(np.ascontiguousarray(tensors[weight].T, dtype=np.float32) for weight, _ in layers)
    return DenseLayers(weights, tuple(tensors[bias].astype(np.float32) for _, bias in layers))


def _node(message: bytes) -> tuple[str, list[str], list[str]]:
    """Return kind, names of inputs and of outputs."""
    fields = list(_fields(message))
    kind = next(value.decode() for number, value in fields if number == _KIND)
    inputs, outputs = ([value.decode() for number, value in fields if number == which] for which in (_INPUT, _OUTPUT))
    return kind, inputs, outputs


def _tensor(message: bytes) -> tuple[str, np.ndarray]:
    """Return name and values; empty if they are of another type or storage."""
    name, shape, kind, raw = "", [], 0, b""
    for number, value in _fields(message):
        if number == _NAME:
            name = value.decode()
        elif number == _RAW:
            raw = value
        elif number == _TYPE:
            kind = int.from_bytes(value, "little")
        elif number == _DIMENSION:
            shape.append(int.from_bytes(value, "little"))
    if kind not in _TYPES or len(raw) != int(np.prod(shape)) * _TYPES[kind].itemsize:
        return name, np.empty(0)
    return name, np.frombuffer(raw, dtype=_TYPES[kind]).reshape(shape)


def _fields(message: bytes) -> Iterator[tuple[int, bytes]]:
    """Iterate over number and value of every field of a protocol buffer; numbers as little-endian bytes."""
    place = 0
    while place < len(message):
        key, place = _varint(message, place)
        wire = key & 7
        if wire == _VARINT:
            value, place = _varint(message, place)
            yield key >> 3, value.to_bytes(10, "little")
            continue
        size, place = _varint(message, place) if wire == _BYTES else ({_WIDE: 8, _NARROW: 4}[wire], place)
        yield key >> 3, message[place : place + size]
        place += size


def _varint(message: bytes, place: int) -> tuple[int, int]:
    value, shift = 0, 0
    while True:
        byte = message[place]
        value |= (byte & 0x7F) << shift
        place += 1
        if byte < 0x80:
            return value, place
        shift += 7


MARKER_FORMAT = "bodysense glove markers 2"
JOINT_FORMAT = "bodysense glove joints 2"
MARKER_NETWORK = "glove_markers.onnx"
JOINT_NETWORK = "glove_joints.onnx"
_COMMAND = "bodysense train gloves"
_ALIKE = 1e-4  # m, or share of a size; hands that differ less are equal


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
    """A network of gloves, and its layers if it has only dense ones."""

    network: Network
    layers: DenseLayers | None = None

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        """See `HandNetwork`; single precision."""
        if self.layers is None:
            (answer,) = self.network.run({"markers": markers, "hand": hand}).values()
            return answer
        if self.layers.width == 27:
            return self.layers.run(markers)
        read = [markers]
        if self.layers.width in (36, 124):  # also which markers are known, as in models/glove.py
            read.append(np.logical_or.reduce(markers.reshape(len(markers), 9, 3), axis=2))
        if self.layers.width in (115, 124):
            read.append(_told(hand))
        return self.layers.run(np.concatenate(read, axis=1))


def for_hands(network: HandNetwork, hand: np.ndarray, known: np.ndarray | None = None) -> HandNetwork:
    """Return the network for hands of these shapes (H, 87), or (1, 87) for all, and known markers (H, 9), if given.

    Their contribution to the first dense layer is added once; `run` then ignores its own argument.
    """
    layers = network.layers if isinstance(network, GloveNetwork) else None
    if not isinstance(network, GloveNetwork) or layers is None:
        return network
    (weight, *weights), (bias, *biases) = layers.weights, layers.biases
    if len(weight) in (115, 124):
        weight, of_shape = weight[:-88], weight[-88:]
        bias = bias + _told(hand) @ of_shape
    if len(weight) == 36 and known is not None:
        weight, of_known = weight[:27], weight[27:]
        bias = bias + known.astype(np.float32) @ of_known
    return replace(network, layers=DenseLayers((weight, *weights), (bias, *biases)))


def _told(hand: np.ndarray) -> np.ndarray:
    """Return (H, 88) single precision: shapes (H, 87), and whether they are known."""
    return np.concatenate([hand, hand.any(axis=1, keepdims=True)], axis=1, dtype=np.float32)


def load_marker_network(path: str | Path | None = None) -> GloveNetwork:
    """Load the network that fills markers: a path, or None for the packaged one. Raises BodysenseError for others."""
    return _load(path, NetworkFormat(MARKER_FORMAT, "glove marker network", _COMMAND, packaged=MARKER_NETWORK))


def load_joint_network(path: str | Path | None = None) -> GloveNetwork:
    """Load the network of joint angles: a path, or None for the packaged one. Raises BodysenseError for others."""
    return _load(path, NetworkFormat(JOINT_FORMAT, "glove joint network", _COMMAND, packaged=JOINT_NETWORK))


def _load(path: str | Path | None, format: NetworkFormat) -> GloveNetwork:
    network = Network.open(path, format)
    slow, fast = GloveNetwork(network), GloveNetwork(network, read_dense(network.source.read_bytes()))
    return fast if fast.layers is not None and _agree(fast, slow) else slow


def _agree(fast: GloveNetwork, slow: GloveNetwork) -> bool:
    """Whether both give equal results for hands with all markers and with some hidden."""
    rng = np.random.default_rng(0)
    markers, hand = rng.normal(scale=0.1, size=(8, 27)), rng.uniform(0.02, 0.1, size=(8, 87))
    markers.reshape(8, 9, 3)[rng.random((8, 9)) < 0.3] = 0.0
    hand[:2] = 0.0
    given = markers.astype(np.float32), hand.astype(np.float32)
    if fast.layers is None or fast.layers.width not in (27, 36, 115, 124):
        return False
    return bool(np.allclose(fast.run(*given), slow.run(*given), rtol=1e-4, atol=1e-4))


def size_ratios(hands: Sequence[Skeleton]) -> np.ndarray:
    """Return (H,) sizes relative to the default hand: networks see all hands at one size."""
    return np.array([hand_size(hand) for hand in hands]) / default_glove().size


def known_shapes(hands: Sequence[Skeleton], gloves: Sequence[Glove]) -> np.ndarray:
    """Return (H, 87) single precision: each hand's resting offsets and template, at one size.

    Zeros for the default hand at another size than its own: it represents hands of which only the size was measured.
    At its own size it is the likeliest hand.
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
