"""Large products in whole numbers, with plain ONNX operators: weights in bytes, their inputs in a few digits each.

A step reads all weights for one wearer; in bytes they are a quarter of what single precision has, and processors
multiply bytes several times as fast. What is multiplied is split into a coarse digit and finer ones: a memory of one
digit would tremble, and runtimes that round otherwise would differ.

Digits have seven bits. Processors without VNNI add the products of two unsigned with two signed bytes in 16 bits, which
saturate beyond 32767: 2 * 255 * 127 would, 2 * 127 * 127 does not. So every processor computes the same products.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper

from bodysense_lab.completion.rewriting import LARGE, Graph, cells, row_step

REACH = 16.0  # features that are larger, in metres or their own units, count as this
_STATE_REACH = 1.0  # of memories, between the values of tanh
_DIGITS, _STATE_DIGITS = 3, 2  # features, and memories, are split into so many
_MIDDLE = 64  # the digit that stands for 0: digits are 1 to 127
_LARGEST = 63.0  # units either way that a digit counts
_SHARE = 126.0  # units of the next digit in one: the rest, half a unit either way, fits
_ZERO, _FINER = "zero_of_digits", "finer"


def whole_products(model: ModelProto, large: int = LARGE) -> ModelProto:
    """The model with products in whole numbers where `large` weights or more are whole multiples in each row."""
    graph = Graph(model)
    states = {name for cell in cells(graph) for name in (cell.output.output[0], cell.kept.input[0])}
    split: set[str] = set()
    for product in [node for node in graph.graph.node if node.op_type == "Gemm"]:
        weights = graph.constants.get(product.input[1])
        if weights is None:
            continue
        values = numpy_helper.to_array(weights)
        step = row_step(values)
        counts = np.round(values / step)
        if values.size < large or not (counts * step == values).all():
            continue
        source, name = product.input[0], product.input[1]
        reach, parts = (_STATE_REACH, _STATE_DIGITS) if source in states else (REACH, _DIGITS)
        constants = {f"{name}_bytes": counts.T.astype(np.int8), f"{name}_step": step[:, 0]}
        if not split:
            constants |= {_ZERO: np.array(_MIDDLE, np.uint8), _FINER: np.array(_SHARE, np.float32)}
        nodes = _multiplied(product, name, parts)
        if source not in split:
            split.add(source)
            units = reach / _LARGEST / _SHARE ** np.arange(parts, dtype=np.float32)
            constants |= {f"{source}_unit{part}": unit for part, unit in enumerate(units)}
            bounds = ()
            if source not in states:  # which never reach further
                bounds = (f"{source}_least", f"{source}_most")
                constants |= {bounds[0]: np.array(-reach, np.float32), bounds[1]: np.array(reach, np.float32)}
            nodes = _split(source, parts, bounds) + nodes
        graph.graph.initializer.remove(weights)
        graph.graph.initializer.extend(numpy_helper.from_array(value, key) for key, value in constants.items())
        place = list(graph.graph.node).index(product)
        graph.graph.node.remove(product)
        for node in reversed(nodes):
            graph.graph.node.insert(place, node)
    return model


def _split(source: str, parts: int, bounds: Sequence[str]) -> list[NodeProto]:
    """(N, K) → (parts · N, K) digits: the coarse ones, then finer and finer ones of the rest; cut at bounds, if any."""
    nodes, rest = list[NodeProto](), source
    if bounds:
        rest = f"{source}_within"
        nodes.append(helper.make_node("Clip", [source, *bounds], [rest]))
    for part in range(parts):
        unit, digit = [f"{source}_unit{part}", _ZERO], f"{source}_digit{part}"
        nodes.append(helper.make_node("QuantizeLinear", [rest, *unit], [digit]))
        if part + 1 < parts:
            nodes.append(helper.make_node("DequantizeLinear", [digit, *unit], [f"{digit}_rounded"]))
            nodes.append(helper.make_node("Sub", [rest, f"{digit}_rounded"], [f"{digit}_rest"]))
            rest = f"{digit}_rest"
    names = [f"{source}_digit{part}" for part in range(parts)]
    return [*nodes, helper.make_node("Concat", names, [f"{source}_split"], axis=0)]


def _multiplied(product: NodeProto, name: str, parts: int) -> list[NodeProto]:
    """The product of what was split with weights in bytes, put together again."""
    source, _, *bias = product.input
    (output,) = product.output
    sums = [f"{name}_sum{part}" for part in range(parts)]
    nodes = [
        helper.make_node("MatMulInteger", [f"{source}_split", f"{name}_bytes", _ZERO], [f"{name}_products"]),
        helper.make_node("Cast", [f"{name}_products"], [f"{name}_sums"], to=TensorProto.FLOAT),
        helper.make_node("Split", [f"{name}_sums"], sums, axis=0, num_outputs=parts),
    ]
    whole = sums[0]
    for finer in sums[1:]:
        nodes.append(helper.make_node("Mul", [whole, _FINER], [f"{finer}_raised"]))
        nodes.append(helper.make_node("Add", [f"{finer}_raised", finer], [f"{finer}_whole"]))
        whole = f"{finer}_whole"
    # Both are constant: it is done when the file is loaded.
    nodes.append(helper.make_node("Mul", [f"{name}_step", f"{source}_unit{parts - 1}"], [f"{name}_unit"]))
    nodes.append(helper.make_node("Mul", [whole, f"{name}_unit"], [f"{name}_scaled" if bias else output]))
    return nodes + [helper.make_node("Add", [f"{name}_scaled", each], [output]) for each in bias]
