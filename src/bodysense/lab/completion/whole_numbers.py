"""Large products in whole numbers, with plain ONNX operators: weights in bytes, what they multiply in two bytes.

A step reads all weights for one wearer; in bytes they are a quarter of what single precision has, and processors
multiply bytes several times as fast. What is multiplied is split into a coarse and a fine byte: a memory of one byte
would tremble.
"""

from __future__ import annotations

import numpy as np
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper

from bodysense.lab.completion.rewriting import LARGE, Graph, cells, row_step

REACH = 16.0  # features that are larger, in metres or their own units, count as this
_STATE_REACH = 1.0  # of memories, between the values of tanh
_ZERO, _COARSE, _SHARE = "zero_of_bytes", "coarse_in_fine", 256.0


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
        reach = _STATE_REACH if source in states else REACH
        constants = {f"{name}_bytes": counts.T.astype(np.int8), f"{name}_step": step[:, 0]}
        if not split:
            constants |= {_ZERO: np.array(128, np.uint8), _COARSE: np.array(_SHARE, np.float32)}
        nodes = _multiplied(product, name)
        if source not in split:
            split.add(source)
            coarse = np.array(reach / 128, np.float32)
            constants |= {f"{source}_coarse_unit": coarse, f"{source}_fine_unit": coarse / np.float32(_SHARE)}
            nodes = _split(source) + nodes
        graph.graph.initializer.remove(weights)
        graph.graph.initializer.extend(numpy_helper.from_array(value, key) for key, value in constants.items())
        place = list(graph.graph.node).index(product)
        graph.graph.node.remove(product)
        for node in reversed(nodes):
            graph.graph.node.insert(place, node)
    return model


def _split(source: str) -> list[NodeProto]:
    """(N, K) → (2 N, K) bytes: what is coarse of it, then what is fine."""
    coarse, fine = [f"{source}_coarse_unit", _ZERO], [f"{source}_fine_unit", _ZERO]
    return [
        helper.make_node("QuantizeLinear", [source, *coarse], [f"{source}_coarse"]),
        helper.make_node("DequantizeLinear", [f"{source}_coarse", *coarse], [f"{source}_rounded"]),
        helper.make_node("Sub", [source, f"{source}_rounded"], [f"{source}_rest"]),
        helper.make_node("QuantizeLinear", [f"{source}_rest", *fine], [f"{source}_fine"]),
        helper.make_node("Concat", [f"{source}_coarse", f"{source}_fine"], [f"{source}_split"], axis=0),
    ]


def _multiplied(product: NodeProto, name: str) -> list[NodeProto]:
    """The product of what was split with weights in bytes, put together again."""
    source, _, *bias = product.input
    (output,) = product.output
    added = [helper.make_node("Add", [f"{name}_scaled", each], [output]) for each in bias]
    return [
        helper.make_node("MatMulInteger", [f"{source}_split", f"{name}_bytes", _ZERO], [f"{name}_products"]),
        helper.make_node("Cast", [f"{name}_products"], [f"{name}_sums"], to=TensorProto.FLOAT),
        helper.make_node("Split", [f"{name}_sums"], [f"{name}_coarse", f"{name}_fine"], axis=0, num_outputs=2),
        helper.make_node("Mul", [f"{name}_coarse", _COARSE], [f"{name}_raised"]),
        helper.make_node("Add", [f"{name}_raised", f"{name}_fine"], [f"{name}_both"]),
        # Both are constant: it is done when the file is loaded.
        helper.make_node("Mul", [f"{name}_step", f"{source}_fine_unit"], [f"{name}_unit"]),
        helper.make_node("Mul", [f"{name}_both", f"{name}_unit"], [f"{name}_scaled" if added else output]),
        *added,
    ]
