"""Rewriting an exported graph: fewer operations, smaller constants, the same function; plain ONNX operators only."""

from __future__ import annotations

from collections import Counter
from functools import partial
from typing import NamedTuple

import numpy as np
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper

LARGE = 2**18  # weights of a product that is quicker in whole numbers
_SMALL = 1e-9  # what a length is kept above only so that nothing is divided by zero
_SOFTPLUS_IS_LINEAR = 20.0
_LEAST_STORED = 256  # values: smaller constants stay as they are
_SHAPING = ("Reshape", "Unsqueeze", "Squeeze")


class Graph:
    """A graph's nodes by what they make, and who reads it."""

    def __init__(self, model: ModelProto) -> None:
        self.graph = model.graph
        self.made = {output: node for node in self.graph.node for output in node.output}
        self.constants = {each.name: each for each in self.graph.initializer}
        self.readers = Counter(name for node in self.graph.node for name in node.input)
        self.readers.update(value.name for value in self.graph.output)

    def maker(self, name: str, kind: str) -> NodeProto | None:
        """The node of a kind that makes a value, if one does."""
        node = self.made.get(name)
        return node if node is not None and node.op_type == kind else None

    def number(self, name: str) -> float | None:
        """A constant's value, if it is a single number."""
        if name not in self.constants:
            return None
        values = numpy_helper.to_array(self.constants[name])
        return float(values.reshape(())) if values.size == 1 else None


def shortened(model: ModelProto, large: int = LARGE) -> ModelProto:
    """The model with patterns of several operations in the place of which there is one.

    Recurrent layers of `large` weights or more stay spelled out, for `whole_products`.
    """
    for rewrite in (partial(_recurrent_layers, large=large), _undone, _unit_vectors, _softplus, _reshapes):
        rewrite(Graph(model))
        _swept(model)
    return model


class Cell(NamedTuple):
    """A GRU's cell, spelled out for a single frame."""

    output: NodeProto
    given: NodeProto  # the product with its input
    kept: NodeProto  # the product with its state


def cells(graph: Graph) -> list[Cell]:
    """All of a graph."""
    found = (_cell(graph, node) for node in graph.graph.node if node.op_type == "Tanh")
    return [cell for cell in found if cell is not None]


def _cell(graph: Graph, new: NodeProto) -> Cell | None:
    """The cell whose candidate is `new`, if it is one's."""
    inside = graph.maker(new.input[0], "Add")
    scaled = graph.maker(inside.input[1], "Mul") if inside is not None else None
    if inside is None or scaled is None:
        return None
    products = [graph.maker(name, "Split") for name in (inside.input[0], scaled.input[1])]
    given, kept = (graph.maker(split.input[0], "Gemm") if split is not None else None for split in products)
    outputs = [node for node in graph.graph.node if node.op_type == "Add" and node.input[0] == new.output[0]]
    if given is None or kept is None or len(outputs) != 1:
        return None
    return Cell(outputs[0], given, kept)


def _recurrent_layers(graph: Graph, large: int) -> None:
    """A small cell → GRU."""
    squeezed = numpy_helper.from_array(np.array([0]), "of_one_frame")
    for output, given, kept in cells(graph):
        # The gates are reset, update, new in PyTorch and update, reset, new in ONNX.
        parts = [numpy_helper.to_array(graph.constants[name]) for name in (*given.input[1:], *kept.input[1:])]
        if parts[0].size >= large:
            continue
        size = len(parts[1]) // 3
        of_input, input_bias, of_state, state_bias = (
            np.concatenate([part[size : 2 * size], part[:size], part[2 * size :]]) for part in parts
        )
        name = output.output[0]
        bias = np.concatenate([input_bias, state_bias])
        gates = [f"{each}_gates" for each in (given.input[1], kept.input[1], given.input[2])]
        for kind, values in zip(gates, (of_input, of_state, bias), strict=True):
            graph.graph.initializer.append(numpy_helper.from_array(values[None], kind))
        if squeezed.name not in graph.constants:
            graph.graph.initializer.append(squeezed)
            graph.constants[squeezed.name] = squeezed
        place = list(graph.graph.node).index(output)
        graph.graph.node.remove(output)
        for node in (
            helper.make_node("Squeeze", [f"{name}_after", squeezed.name], [name]),
            helper.make_node(
                "GRU",
                [f"{name}_frame", *gates, "", f"{name}_before"],
                ["", f"{name}_after"],
                hidden_size=size,
                linear_before_reset=1,
            ),
            helper.make_node("Unsqueeze", [kept.input[0], squeezed.name], [f"{name}_before"]),
            helper.make_node("Unsqueeze", [given.input[0], squeezed.name], [f"{name}_frame"]),
        ):
            graph.graph.node.insert(place, node)


def _unit_vectors(graph: Graph) -> None:
    """x / max(‖x‖, tiny) → LpNormalization(x)."""
    for node in graph.graph.node:
        if node.op_type != "Div":
            continue
        kept = graph.maker(node.input[1], "Clip")
        norm = graph.maker(kept.input[0], "ReduceL2") if kept is not None else None
        if kept is None or norm is None or norm.input[0] != node.input[0]:
            continue
        least, axes = graph.number(kept.input[1]), graph.number(norm.input[1])
        if least is not None and least < _SMALL and axes == -1:
            normalised = helper.make_node("LpNormalization", [node.input[0]], list(node.output), axis=-1, p=2)
            node.CopyFrom(normalised)


def _softplus(graph: Graph) -> None:
    """Softplus that PyTorch calls linear from 20 on: as single precision does by itself."""
    for node in graph.graph.node:
        if node.op_type != "Where":
            continue
        large, soft = graph.maker(node.input[0], "Greater"), graph.maker(node.input[2], "Softplus")
        if large is None or soft is None or soft.input[0] != node.input[1]:
            continue
        if large.input[0] == node.input[1] and graph.number(large.input[1]) == _SOFTPLUS_IS_LINEAR:
            node.CopyFrom(helper.make_node("Softplus", [node.input[1]], list(node.output)))


def _reshapes(graph: Graph) -> None:
    """A change of shape before a Reshape is for nothing."""
    for node in graph.graph.node:
        if node.op_type != "Reshape":
            continue
        before = graph.made.get(node.input[0])
        while before is not None and before.op_type in _SHAPING:
            node.input[0] = before.input[0]
            before = graph.made.get(node.input[0])


def _undone(graph: Graph) -> None:
    """An Unsqueeze of what a Squeeze has made of it is for nothing."""
    for node in graph.graph.node:
        if node.op_type != "Unsqueeze":
            continue
        before = graph.maker(node.input[0], "Squeeze")
        if before is not None and before.input[1] == node.input[1]:
            for reader in graph.graph.node:
                for place, name in enumerate(reader.input):
                    if name == node.output[0]:
                        reader.input[place] = before.input[0]


def _swept(model: ModelProto) -> None:
    """Remove nodes and constants that nobody reads."""
    graph = model.graph
    while True:
        read = {name for node in graph.node for name in node.input} | {value.name for value in graph.output}
        idle = [node for node in graph.node if not read.intersection(node.output)]
        if not idle:
            break
        for node in idle:
            graph.node.remove(node)
    for constant in [each for each in graph.initializer if each.name not in read]:
        graph.initializer.remove(constant)
    del graph.value_info[:]


def stored_small(model: ModelProto) -> ModelProto:
    """Store constants in the smallest type that holds them exactly; they are cast back when the file is loaded.

    That is a byte for whole numbers and for whole multiples of what each row counts in, and half precision.
    """
    graph = model.graph
    casts = []
    places = {node.input[1] for node in graph.node if node.op_type == "Gather"}
    for constant in list(graph.initializer):
        values = numpy_helper.to_array(constant)
        if constant.name in places:
            constant.CopyFrom(numpy_helper.from_array(values.astype(np.int32), constant.name))
        if values.dtype != np.float32 or values.size < _LEAST_STORED:
            continue
        name, step = constant.name, row_step(values)
        multiples = np.round(values / step)
        small = f"{name}_small"
        with np.errstate(over="ignore"):
            half = values.astype(np.float16)
        if (values == np.round(values).clip(-127, 127)).all():
            stored, back = values.astype(np.int8), [_cast(small, name)]
        elif (values == multiples * step).all():
            stored = multiples.astype(np.int8)
            graph.initializer.append(numpy_helper.from_array(step, f"{name}_step"))
            back = [_cast(small, f"{name}_whole"), helper.make_node("Mul", [f"{name}_whole", f"{name}_step"], [name])]
        elif (values == half).all():
            stored, back = half, [_cast(small, name)]
        else:
            continue
        graph.initializer.remove(constant)
        graph.initializer.append(numpy_helper.from_array(stored, small))
        casts += back
    for cast in reversed(casts):
        graph.node.insert(0, cast)
    return model


def row_step(values: np.ndarray) -> np.ndarray:
    """(..., 1) float32: in what each row of values counts in bytes.

    It has few digits, so that its multiples are exact: values that were rounded to them are found to be such again.
    """
    largest = np.abs(values).max(axis=-1, keepdims=True, initial=0.0).astype(np.float64)
    digits, exponent = np.frexp(np.where(largest > 0, largest, 1.0) / 127)
    return np.ldexp(np.ceil(digits * 2048) / 2048, exponent).astype(np.float32)


def _cast(name: str, to: str) -> NodeProto:
    return helper.make_node("Cast", [name], [to], to=TensorProto.FLOAT)
