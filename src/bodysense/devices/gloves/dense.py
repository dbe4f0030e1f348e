"""A network of dense layers, read from its ONNX file and computed with NumPy.

At a few tens of thousands of weights the call of ONNX Runtime takes twice as long as the sums. ONNX Runtime is the slow
twin: what is read here must answer as it does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

_VARINT, _BYTES, _WIDE, _NARROW = 0, 2, 1, 5  # wire types of protocol buffers
_TYPES = {1: np.dtype("<f4"), 10: np.dtype("<f2")}  # of ONNX tensors: single and half precision
# Numbers of fields: https://github.com/onnx/onnx/blob/main/onnx/onnx.proto3
_GRAPH, _NODE, _TENSOR, _INPUT, _KIND, _DIMENSION, _TYPE, _NAME, _RAW = 7, 1, 5, 1, 4, 1, 2, 8, 9
_OUTPUT = 2


@dataclass(frozen=True, eq=False)
class DenseLayers:
    """Layers x → max(x · weight + bias, 0), the last without the maximum."""

    weights: tuple[np.ndarray, ...]  # (inputs, outputs) each
    biases: tuple[np.ndarray, ...]

    @property
    def width(self) -> int:
        """Of what is read."""
        return len(self.weights[0])

    def run(self, values: np.ndarray) -> np.ndarray:
        """(H, width) → (H, outputs), single precision."""
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            values = values.dot(weight)
            values += bias
            np.maximum(values, 0.0, out=values)
        return values.dot(self.weights[-1]) + self.biases[-1]


def read_dense(file: bytes) -> DenseLayers | None:
    """The layers of an ONNX file that ends in Gemm, Relu, Gemm, …, Gemm; None for one that is not of that kind."""
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
    """Kind, names of inputs and of outputs."""
    fields = list(_fields(message))
    kind = next(value.decode() for number, value in fields if number == _KIND)
    inputs, outputs = ([value.decode() for number, value in fields if number == which] for which in (_INPUT, _OUTPUT))
    return kind, inputs, outputs


def _tensor(message: bytes) -> tuple[str, np.ndarray]:
    """Name and values; empty where they are of another type or stored in another way."""
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
    """Number and value of every field of a protocol buffer; numbers as bytes, the least first."""
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
