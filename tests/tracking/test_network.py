"""Loading of network files, with a small network that adds its input to its state."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from bodysense.errors import BodysenseError
from bodysense.weights.formats import NetworkFormat
from bodysense.weights.network import Network

FORMAT = NetworkFormat("bodysense sums 1", "network of sums", "bodysense train sums", ("state", "rate"))
STATE = {"sum": {"shape": [2, 3], "start": list(range(6))}, "seen": {"shape": [], "start": None}}
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes the network with a card."""

    def make(batch: str | int = "batch", name: str = "sums.onnx", **card: Any) -> Path:
        shapes = {"value": [batch, 2, 3], "state_sum": [batch, 2, 3], "state_seen": [batch]}
        values = {key: helper.make_tensor_value_info(key, TensorProto.FLOAT, shape) for key, shape in shapes.items()}
        values["state_seen"] = helper.make_tensor_value_info("state_seen", TensorProto.BOOL, [batch])
        outputs = [
            helper.make_tensor_value_info("next_seen", TensorProto.BOOL, [batch]),
            helper.make_tensor_value_info("total", TensorProto.FLOAT, [batch, 2, 3]),
            helper.make_tensor_value_info("next_sum", TensorProto.FLOAT, [batch, 2, 3]),
        ]
        nodes = [
            helper.make_node("Add", ["value", "state_sum"], ["total"]),
            helper.make_node("Identity", ["total"], ["next_sum"]),
            helper.make_node("Not", ["state_seen"], ["next_seen"]),
        ]
        graph = helper.make_graph(nodes, "sums", list(values.values()), outputs)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
        card = {"format": FORMAT.name, "rate": 30, "state": STATE, "note": "none", **card}
        texts = {key: value if isinstance(value, str) else json.dumps(value) for key, value in card.items()}
        helper.set_model_props(model, texts)
        onnx.save(model, str(tmp_path / name))
        return tmp_path / name

    return make


def test_steps_carry_the_state(write: Write) -> None:
    network = Network.open(write(), FORMAT)
    assert network.name == "sums.onnx"
    assert set(network.inputs) == {"value", "state_sum", "state_seen"}
    assert network.card == {"rate": 30, "state": STATE, "note": "none"}
    state = network.start(4)
    assert {name: (values.shape, values.dtype.name) for name, values in state.items()} == {
        "state_sum": ((4, 2, 3), "float32"),
        "state_seen": ((4,), "bool"),
    }
    value = np.random.default_rng(0).normal(size=(4, 2, 3)).astype(np.float32)
    for k in range(1, 4):
        outputs, state = network.step({"value": value, "unread": value}, state)
        assert set(outputs) == {"total"}
        np.testing.assert_allclose(outputs["total"], np.arange(6).reshape(2, 3) + k * value, rtol=1e-5)
        np.testing.assert_array_equal(state["state_seen"], k % 2 == 1)


def test_each_start_has_its_own_memory(write: Write) -> None:
    network = Network.open(write(), FORMAT)
    network.start(2)["state_sum"][:] = 9
    np.testing.assert_array_equal(network.start(2)["state_sum"][1], np.arange(6).reshape(2, 3))


def test_cards_of_older_files_start_the_same(write: Write) -> None:
    """Older cards have a batch axis in their shapes, `values`, or full names of inputs."""
    older = {"state_sum": {"shape": [1, 2, 3], "dtype": "float32", "values": list(range(6))}}
    expected = Network.open(write(), FORMAT).start()
    found = Network.open(write(name="older.onnx", state=older), FORMAT).start()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)


@pytest.mark.parametrize(("axis", "batch"), [("batch", None), ("batch", 2), (2, None)])
def test_the_batch_axis(write: Write, axis: str | int, batch: int | None) -> None:
    network = Network.open(write(batch=axis), FORMAT, batch=batch)
    outputs, _ = network.step({"value": np.zeros((2, 2, 3), dtype=np.float32)}, network.start(2))
    assert outputs["total"].shape == (2, 2, 3)


def test_other_files_are_refused_by_name(write: Write, tmp_path: Path) -> None:
    refused = {
        tmp_path / "missing.onnx": "missing.onnx: no such model file; give the .onnx that `bodysense train sums` wrote",
        write(name="other.onnx", format="sums 9"): (
            "other.onnx: not a bodysense network of sums (format 'sums 9', wanted 'bodysense sums 1'); "
            "give the .onnx that `bodysense train sums` wrote"
        ),
    }
    (tmp_path / "text.onnx").write_text("hello")
    refused[tmp_path / "text.onnx"] = "text.onnx: not a readable ONNX model ("
    (tmp_path / "one.5.pt").write_bytes(b"weights")
    refused[tmp_path / "one.5.pt"] = "give the .onnx that the same `bodysense train sums` writes with -o one.5.onnx"
    for path, text in refused.items():
        with pytest.raises(BodysenseError) as raised:
            Network.open(path, FORMAT)
        assert text in str(raised.value) and str(path) in str(raised.value) and "\n" not in str(raised.value)


def test_incomplete_cards_are_refused(write: Write) -> None:
    wanted = NetworkFormat(FORMAT.name, FORMAT.kind, FORMAT.command, ("licence",))
    with pytest.raises(BodysenseError, match=r"sums\.onnx: its card has no 'licence'; export the network again"):
        Network.open(write(), wanted)
    network = Network.open(write(state={"sum": {"start": [1, 2]}}), FORMAT)
    with pytest.raises(BodysenseError, match=r"its card starts 'sum' with 2 numbers, but the graph reads 6; export"):
        network.start()


def test_the_packaged_file_is_opened_without_a_path() -> None:
    packaged = NetworkFormat("bodysense arms 1", "network of arms", "bodysense train arms", packaged="arms.onnx")
    network = Network.open(None, packaged)
    assert network.name == "arms.onnx" and network.card["frames"] == 32
    assert network.source.read_bytes()[:1] == b"\x08"
