"""Products in whole numbers: as near as three bytes are, each row by itself, larger values cut; read back as stored."""

from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from bodysense.completion.model import FORMAT
from bodysense.errors import BodysenseError
from bodysense_lab.completion.rewriting import row_step
from bodysense_lab.completion.stored import read_networks
from bodysense_lab.completion.whole_numbers import REACH, whole_products

INPUTS, OUTPUTS = 19, 7


def weights_and_bias() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(OUTPUTS, INPUTS)).astype(np.float32)
    step = row_step(values)
    return np.round(values / step) * step, rng.normal(size=OUTPUTS).astype(np.float32)


@lru_cache
def session() -> onnxruntime.InferenceSession:
    weights, bias = weights_and_bias()
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["x", "weights", "bias"], ["y"], transB=1)],
        "product",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, ["batch", INPUTS])],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, ["batch", OUTPUTS])],
        [numpy_helper.from_array(weights, "weights"), numpy_helper.from_array(bias, "bias")],
    )
    model = whole_products(
        helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10), large=100
    )
    assert "MatMulInteger" in [node.op_type for node in model.graph.node]
    return onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])


def multiplied(x: np.ndarray) -> np.ndarray:
    return np.asarray(session().run(None, {"x": x.astype(np.float32)})[0])


@given(st.integers(1, 9), st.sampled_from([1e-3, 1.0, 4.0]), st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_products_are_as_near_as_three_bytes(rows: int, size: float, seed: int) -> None:
    x = np.clip(size * np.random.default_rng(seed).normal(size=(rows, INPUTS)), -0.99 * REACH, 0.99 * REACH)
    weights, bias = weights_and_bias()
    got = multiplied(x)
    bound = np.abs(weights).sum(axis=1) * REACH / 2**21
    assert (np.abs(got - (x @ weights.T + bias)) < bound).all()
    for row, alone in zip(x, got, strict=True):
        assert (multiplied(row[None])[0] == alone).all()


def test_what_reaches_further_is_cut() -> None:
    far, edge = (np.full((1, INPUTS), value, np.float32) for value in (1000.0, REACH))
    weights, bias = weights_and_bias()
    np.testing.assert_allclose(multiplied(far), edge @ weights.T + bias, atol=0.02 * REACH)


def test_the_packaged_networks_are_read_back() -> None:
    with as_file(files("bodysense.weights") / "completion.onnx") as path:
        body, fingers = read_networks(path)
    hidden = torch.zeros(body.config.layers, 1, body.config.hidden)
    assert sum(parameter.numel() for parameter in (*body.parameters(), *fingers.parameters())) == 4117170
    assert all(parameter.abs().max() > 0 for parameter in (*body.parameters(), *fingers.parameters()))
    (turned, _), _ = body.predict(torch.zeros(1, 1, body.features), hidden)
    assert turned.isfinite().all()


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match="no such file"):
        read_networks(tmp_path / "none.onnx")
    graph = helper.make_graph([], "empty", [], [])
    other = tmp_path / "other.onnx"
    other.write_bytes(helper.make_model(graph).SerializeToString())
    with pytest.raises(BodysenseError, match=FORMAT):
        read_networks(other)
