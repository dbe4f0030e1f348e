"""Products in whole numbers: as near as three digits are, each row by itself, larger values cut; read back as stored.

Processors with VNNI add the four products of bytes in 32 bits. Those without add two in 16 bits, which saturate. Both
must give the same bodies, so what the others do is simulated here.
"""

from collections.abc import Callable
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from bodysense.body.person import Person
from bodysense.completion.model import load_completion
from bodysense.demo import performance_of_stranger
from bodysense.devices.simulated.sensors import SENSOR_SETS, observe
from bodysense.errors import BodysenseError
from bodysense.tracker import Tracker
from bodysense_lab.completion.rewriting import row_step
from bodysense_lab.completion.stored import FORMAT, read_networks
from bodysense_lab.completion.whole_numbers import REACH, whole_products

INPUTS, OUTPUTS = 19, 7
PACKAGED = Path(str(files("bodysense.weights") / "completion.onnx"))


def weights_and_bias() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(OUTPUTS, INPUTS)).astype(np.float32)
    step = row_step(values)
    return np.round(values / step) * step, rng.normal(size=OUTPUTS).astype(np.float32)


def without_vnni(model: onnx.ModelProto) -> onnx.ModelProto:
    """The model as processors without VNNI compute it: products of two neighbours are added in 16 bits, saturating."""
    graph = model.graph
    constants = {each.name: numpy_helper.to_array(each) for each in graph.initializer}
    for product in [node for node in graph.node if node.op_type == "MatMulInteger"]:
        (source, weights, zero), name = product.input, product.output[0]
        values = constants[weights].astype(np.int32)
        values = np.concatenate([values, np.zeros((len(values) % 2, values.shape[1]), np.int32)])
        places = np.minimum(np.arange(len(values)), len(constants[weights]) - 1)
        added = {
            "least": np.array(-(2**15), np.int32),
            "most": np.array(2**15 - 1, np.int32),
            "axis": np.array([1]),
            "zeros": constants[zero].astype(np.int32) * values.sum(axis=0, dtype=np.int32),
        }
        nodes = [helper.make_node("Cast", [source], [f"{name}_whole"], to=TensorProto.INT32)]
        for part in (0, 1):
            added |= {f"places{part}": places[part::2], f"weights{part}": values[None, part::2]}
            nodes += [
                helper.make_node("Gather", [f"{name}_whole", f"{name}_places{part}"], [f"{name}_part{part}"], axis=1),
                helper.make_node("Unsqueeze", [f"{name}_part{part}", f"{name}_last"], [f"{name}_wide{part}"]),
                helper.make_node("Mul", [f"{name}_wide{part}", f"{name}_weights{part}"], [f"{name}_product{part}"]),
            ]
        nodes += [
            helper.make_node("Add", [f"{name}_product0", f"{name}_product1"], [f"{name}_pairs"]),
            helper.make_node("Clip", [f"{name}_pairs", f"{name}_least", f"{name}_most"], [f"{name}_words"]),
            helper.make_node("ReduceSum", [f"{name}_words", f"{name}_axis"], [f"{name}_sum"], keepdims=0),
            helper.make_node("Sub", [f"{name}_sum", f"{name}_zeros"], [name]),
        ]
        added["last"] = np.array([2])
        graph.initializer.extend(numpy_helper.from_array(value, f"{name}_{key}") for key, value in added.items())
        place = list(graph.node).index(product)
        graph.node.remove(product)
        for node in reversed(nodes):
            graph.node.insert(place, node)
    return model


def in_floats(model: onnx.ModelProto) -> onnx.ModelProto:
    """The model with products of floats in the place of those in whole numbers."""
    graph = model.graph
    constants = {each.name: numpy_helper.to_array(each) for each in graph.initializer}
    sources = {node.input[1]: node.input[0] for node in graph.node if node.op_type == "MatMulInteger"}
    for weights, source in sources.items():
        name = weights.removesuffix("_bytes")
        step = next(constants[f"{name}_{kind}"] for kind in ("step", "step_small") if f"{name}_{kind}" in constants)
        values = constants[weights] * step.astype(np.float32)
        graph.initializer.append(numpy_helper.from_array(values.astype(np.float32), f"{name}_float"))
        (node,) = [each for each in graph.node if list(each.output) == [f"{name}_scaled"]]
        node.CopyFrom(helper.make_node("MatMul", [source.removesuffix("_split"), f"{name}_float"], list(node.output)))
    return model


Change = Callable[[onnx.ModelProto], onnx.ModelProto]


def unchanged(model: onnx.ModelProto) -> onnx.ModelProto:
    """The model as this processor computes it."""
    return model


def product_model() -> onnx.ModelProto:
    """One product in whole numbers."""
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
    return model


@lru_cache
def digits_of() -> onnxruntime.InferenceSession:
    """What the product multiplies."""
    model = product_model()
    model.graph.output.append(helper.make_tensor_value_info("x_split", TensorProto.UINT8, None))
    del model.graph.output[0]
    return onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])


@lru_cache
def session(change: Change) -> onnxruntime.InferenceSession:
    return onnxruntime.InferenceSession(change(product_model()).SerializeToString(), providers=["CPUExecutionProvider"])


def multiplied(x: np.ndarray, change: Change = unchanged) -> np.ndarray:
    return np.asarray(session(change).run(None, {"x": x.astype(np.float32)})[0])


@pytest.mark.parametrize("change", [unchanged, without_vnni])
@given(st.integers(1, 9), st.sampled_from([1e-3, 1.0, 4.0, 1e3]), st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_products_are_as_near_as_three_digits(change: Change, rows: int, size: float, seed: int) -> None:
    x = np.clip(size * np.random.default_rng(seed).normal(size=(rows, INPUTS)), -0.99 * REACH, 0.99 * REACH)
    weights, bias = weights_and_bias()
    got = multiplied(x, change)
    bound = np.abs(weights).sum(axis=1) * REACH / (2 * 63 * 126**2)
    assert (np.abs(got - (x @ weights.T + bias)) < bound).all()
    for row, alone in zip(x, got, strict=True):
        assert (multiplied(row[None], change)[0] == alone).all()


def test_what_reaches_further_is_cut() -> None:
    far, edge = (np.full((1, INPUTS), value, np.float32) for value in (1000.0, REACH))
    weights, bias = weights_and_bias()
    np.testing.assert_allclose(multiplied(far), edge @ weights.T + bias, atol=0.02 * REACH)


def test_no_pair_of_the_packaged_products_saturates() -> None:
    model = onnx.load(str(PACKAGED))
    constants = {each.name: numpy_helper.to_array(each) for each in model.graph.initializer}
    products = [node for node in model.graph.node if node.op_type == "MatMulInteger"]
    assert len(products) == 5
    for product in products:
        weights = constants[product.input[1]].astype(int)
        columns = weights.shape[1]
        pairs = np.concatenate([weights, np.zeros((len(weights) % 2, columns), int)]).reshape(-1, 2, columns)
        largest = 2 * int(constants[product.input[2]]) - 1
        assert largest * np.maximum(pairs, 0).sum(axis=1).max() < 2**15
        assert largest * np.minimum(pairs, 0).sum(axis=1).min() >= -(2**15)


@given(st.floats(1e-6, 1e6), st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_digits_have_seven_bits(size: float, seed: int) -> None:
    x = size * np.random.default_rng(seed).normal(size=(4, INPUTS)).astype(np.float32)
    digits = np.asarray(digits_of().run(None, {"x": x})[0])
    assert digits.shape == (12, INPUTS) and digits.min() >= 1 and digits.max() <= 127


@pytest.mark.parametrize("change", [unchanged, without_vnni])
def test_the_packaged_network_equals_its_twin_in_floats(change: Change, tmp_path: Path) -> None:
    clip = performance_of_stranger()
    points = []
    for name, made in (("changed", change), ("twin", in_floats)):
        path = tmp_path / f"{name}.onnx"
        onnx.save(made(onnx.load(str(PACKAGED))), str(path))
        tracker = Tracker(Person(clip.pose.skeleton), network=load_completion(path))
        observation = observe(clip.pose, clip.time, SENSOR_SETS["three_point"])[:40]
        points.append(tracker.step(observation, tracker.start())[0].points)
    assert np.abs(points[0] - points[1]).max() < 1e-4


def test_the_packaged_networks_are_read_back() -> None:
    body, fingers = read_networks(PACKAGED)
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
