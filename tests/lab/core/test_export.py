"""Export of networks: large weights are stored in fewer bytes, and outputs change within their resolution."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import ModelProto, TensorProto, helper, numpy_helper

from bodysense_lab.core.export import store_as_float16, store_as_int8, strip_metadata

SHAPE = (80, 60, 3)


@pytest.mark.parametrize(
    ("shrink", "share", "error"),
    [
        (store_as_float16, 0.55, 2**-11),
        (store_as_int8, 0.3, 0.5 / 127),
        (partial(store_as_int8, most=63), 0.3, 0.5 / 63),
    ],
)
def test_large_weights_are_compressed_and_small_ones_are_not(
    shrink: Callable[[ModelProto], ModelProto], share: float, error: float
) -> None:
    rng = np.random.default_rng(0)
    large, small = rng.normal(size=SHAPE).astype(np.float32), rng.normal(size=3).astype(np.float32)
    large[0] = 0  # a row without a unit
    before = model_of(large, small)
    size = len(before.SerializeToString())
    after = strip_metadata(shrink(before))
    onnx.checker.check_model(after)
    assert len(after.SerializeToString()) < share * size
    given = onnxruntime.InferenceSession(after.SerializeToString(), providers=["CPUExecutionProvider"])
    found = np.asarray(given.run(None, {"x": np.zeros(SHAPE, dtype=np.float32)})[0])
    largest = np.abs(large).max(axis=(1, 2), keepdims=True)
    assert (np.abs(found - large - small) <= error * largest + 1e-6).all()


def test_metadata_of_operations_is_dropped() -> None:
    model = model_of(np.zeros(SHAPE, dtype=np.float32), np.zeros(3, dtype=np.float32))
    for node in model.graph.node:
        node.doc_string = "somewhere"
        node.metadata_props.add(key="stack", value="somewhere")
    assert b"somewhere" not in strip_metadata(model).SerializeToString()


def model_of(large: np.ndarray, small: np.ndarray) -> ModelProto:
    """Return a model that computes y = x + large + small."""
    nodes = [helper.make_node("Add", ["x", "large"], ["z"]), helper.make_node("Add", ["z", "small"], ["y"])]
    inputs, outputs = ([helper.make_tensor_value_info(name, TensorProto.FLOAT, SHAPE)] for name in "xy")
    constants = [numpy_helper.from_array(large, "large"), numpy_helper.from_array(small, "small")]
    graph = helper.make_graph(nodes, "sum", inputs, outputs, constants)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
