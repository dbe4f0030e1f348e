"""Large products in whole numbers, with plain ONNX operators: weights in bytes, what they multiply in a few bytes each.

A step reads all weights for one wearer; in bytes they are a quarter of what single precision has, and processors
multiply bytes several times as fast. What is multiplied is split into a coarse byte and finer ones: a memory of one
byte would tremble, and runtimes that round otherwise would differ.
"""

from __future__ import annotations

import numpy as np
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper

from bodysense_lab.completion.rewriting import LARGE, Graph, cells, row_step

REACH = 16.0  # features that are larger, in metres or their own units, count as this
_STATE_REACH = 1.0  # of memories, between the values of tanh
_BYTES, _STATE_BYTES = 3, 2  # features, and memories, are split into so many
_SHARE = 254.0  # of a byte's unit in that of the next: what is left, half a unit either way, fits
_ZERO, _FINER = "zero_of_bytes", "finer"


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
        reach, parts = (_STATE_REACH, _STATE_BYTES) if source in states else (REACH, _BYTES)
        constants = {f"{name}_bytes": counts.T.astype(np.int8), f"{name}_step": step[:, 0]}
        if not split:
            constants |= {_ZERO: np.array(128, np.uint8), _FINER: np.array(_SHARE, np.float32)}
        nodes = _multiplied(product, name, parts)
        if source not in split:
            split.add(source)
            units = reach / 128 / _SHARE ** np.arange(parts, dtype=np.float32)
            constants |= {f"{source}_unit{part}": unit for part, unit in enumerate(units)}
            nodes = _split(source, parts) + nodes
        graph.graph.initializer.remove(weights)
        graph.graph.initializer.extend(numpy_helper.from_array(value, key) for key, value in constants.items())
        place = list(graph.graph.node).index(product)
        graph.graph.node.remove(product)
        for node in reversed(nodes):
            graph.graph.node.insert(place, node)
    return model


def _split(source: str, parts: int) -> list[NodeProto]:
    """(N, K) → (parts · N, K) bytes: the coarse ones, then finer and finer ones of what is left."""
    nodes, rest = list[NodeProto](), source
    for part in range(parts):
        unit, byte = [f"{source}_unit{part}", _ZERO], f"{source}_byte{part}"
        nodes.append(helper.make_node("QuantizeLinear", [rest, *unit], [byte]))
        if part + 1 < parts:
            nodes.append(helper.make_node("DequantizeLinear", [byte, *unit], [f"{byte}_rounded"]))
            nodes.append(helper.make_node("Sub", [rest, f"{byte}_rounded"], [f"{byte}_rest"]))
            rest = f"{byte}_rest"
    names = [f"{source}_byte{part}" for part in range(parts)]
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
