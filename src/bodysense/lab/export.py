"""Writing a trained network as one self-describing ONNX file."""

from __future__ import annotations

import json
import logging
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from bodysense.files import written_beside
from bodysense.lab.unoc.episodes import RATE
from bodysense.lab.unoc.learned import FORMAT
from bodysense.lab.unoc.network import BodyNetwork, State, Tracked

_HALF_FROM = 4096  # values: larger constants are stored in half precision


class _OneStep(nn.Module):
    """The network with its state spelled out as separate inputs and outputs."""

    def __init__(self, model: BodyNetwork) -> None:
        super().__init__()
        self.model = model

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        count = len(Tracked._fields)
        completed, state = self.model(Tracked(*values[:count]), State(*values[count:]))
        return (*completed, *state)


def write_onnx(model: BodyNetwork, path: Path, card: dict[str, Any]) -> None:
    """Export one streaming step of `model` with its metadata; large weights in half precision.

    `card` holds what a user should know: training data, licence, test figures, and `fastest_rate`, Hz, where the
    network was taught to step faster than at `RATE`. The file appears whole or not at all.
    """
    model = model.eval()
    points = len(model.skeleton.points)
    state = model.start(1)
    tracked = Tracked(
        position=torch.zeros(1, 1, points, 3),
        visible=torch.ones(1, 1, points, dtype=torch.bool),
        head_position=torch.zeros(1, 1, 3),
        head_rotation=torch.tensor([[[1.0, 0, 0, 0]]]),
        interval=torch.full((1, 1), 1 / RATE),
        bone_length=model.typical_bone[None],
        height=torch.tensor([1.7]),
    )
    inputs = [*Tracked._fields, *(f"state_{name}" for name in State._fields)]
    outputs = ["completed", "occluded", "error", *(f"next_{name}" for name in State._fields)]
    start = {
        f"state_{name}": {"shape": list(value.shape), "dtype": str(value.numpy().dtype)}
        | ({"values": np.round(value.flatten().numpy().astype(float), 5).tolist()} if value.any() else {})
        for name, value in zip(State._fields, state, strict=True)
    }
    card = {
        "points": model.skeleton.points,
        "rate": RATE,
        "fastest_rate": RATE,
        "state": start,
        "network": vars(model.config),
        "weights": sum(parameter.numel() for parameter in model.parameters()),
        **card,
    }
    export(_OneStep(model), (*tracked, *state), inputs, outputs, FORMAT, card, path)


def export(
    step: nn.Module,
    example: tuple[Tensor, ...],
    inputs: list[str],
    outputs: list[str],
    format: str,
    card: dict[str, Any],
    path: Path,
    dynamic_shapes: tuple[Any, ...] | None = None,
) -> None:
    """Write one step of a network with its card; large weights in half precision. The file appears whole or not.

    `dynamic_shapes` are the axes (torch.export.Dim) of each input that may have any length.
    """
    with written_beside(path) as beside:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            logging.getLogger("torch.onnx").setLevel(logging.ERROR)
            torch.onnx.export(
                step,
                example,
                str(beside),
                input_names=inputs,
                output_names=outputs,
                dynamo=True,
                external_data=False,
                verbose=False,
                dynamic_shapes=dynamic_shapes,
            )
        written = _halve(onnx.load(str(beside)))
        for node in written.graph.node:
            del node.metadata_props[:]  # where in whose files each operation was written: a third of a file
        fields = {"format": format} | {key: json.dumps(value) for key, value in card.items()}
        onnx.helper.set_model_props(written, fields)
        onnx.checker.check_model(written)
        onnx.save(written, str(beside))


def _halve(model: onnx.ModelProto) -> onnx.ModelProto:
    """Store large weights as float16, cast back when the file is loaded: half the size, the same speed."""
    graph = model.graph
    casts = []
    for initializer in list(graph.initializer):
        values = numpy_helper.to_array(initializer)
        if values.dtype != np.float32 or values.size < _HALF_FROM:
            continue
        name = initializer.name
        graph.initializer.remove(initializer)
        graph.initializer.append(numpy_helper.from_array(values.astype(np.float16), f"{name}_half"))
        casts.append(onnx.helper.make_node("Cast", [f"{name}_half"], [name], to=onnx.TensorProto.FLOAT))
    for cast in reversed(casts):
        graph.node.insert(0, cast)
    return model
