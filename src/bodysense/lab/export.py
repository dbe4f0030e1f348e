"""Writing a trained network as one self-describing ONNX file: the one writer, for every network."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import ModelProto, numpy_helper
from torch import Tensor, nn

from bodysense.files import written_beside

_HALF_FROM = 4096  # values: larger constants are stored in half precision


def export(
    step: nn.Module,
    example: tuple[Tensor, ...],
    inputs: list[str],
    outputs: list[str],
    format: str,
    card: dict[str, Any],
    path: Path,
    dynamic_shapes: tuple[Any, ...] | None = None,
    shrink: Callable[[ModelProto], ModelProto] | None = None,
    opset: int | None = None,
) -> None:
    """Write one step of a network with its card. The file appears whole or not at all.

    `dynamic_shapes` are the axes (torch.export.Dim) of each input that may have any length; `shrink` rewrites the
    graph, by default so that large weights are stored in half precision.
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
                opset_version=opset,
            )
        written = (shrink or halved)(onnx.load(str(beside)))
        for node in written.graph.node:
            del node.metadata_props[:]  # where in whose files each operation was written: a third of a file
        fields = {"format": format} | {key: json.dumps(value) for key, value in card.items()}
        onnx.helper.set_model_props(written, fields)
        onnx.checker.check_model(written)
        onnx.save(written, str(beside))


def halved(model: ModelProto) -> ModelProto:
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
