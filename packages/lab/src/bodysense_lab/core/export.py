"""Export of trained networks, each as one ONNX file with its card as metadata."""

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
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper
from torch import Tensor, nn

from bodysense.files import written_beside

_LARGE = 4096  # values; smaller constants are unchanged


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
) -> None:
    """Write one step of a network with its card. The file is complete or not written.

    Args:
        step: module of one step.
        example: inputs of the step, for tracing.
        inputs: names of the inputs.
        outputs: names of the outputs.
        format: name of the file format, in the metadata.
        card: numbers and texts for the metadata.
        path: file to write.
        dynamic_shapes: axes (torch.export.Dim) of each input that may have any length.
        shrink: function that stores large weights in fewer bytes; half precision if None.
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
        written = strip_metadata((shrink or store_as_float16)(onnx.load(str(beside))))
        fields = {"format": format} | {key: json.dumps(value) for key, value in card.items()}
        helper.set_model_props(written, fields)
        onnx.checker.check_model(written)
        onnx.save(written, str(beside))


def store_as_float16(model: ModelProto) -> ModelProto:
    """Store large weights as float16, which are cast back when the file is loaded: half the size, equal speed."""

    def half(name: str, values: np.ndarray) -> tuple[dict[str, np.ndarray], list[NodeProto]]:
        return {f"{name}_half": values.astype(np.float16)}, [_cast(f"{name}_half", name)]

    return _replace_large_weights(model, half)


def store_as_int8(model: ModelProto, most: int = 127) -> ModelProto:
    """Store large weights as int8 multiples of a unit for each row (first axis).

    They are multiplied again when the file is loaded: a quarter of the size, equal speed. Multiples are at most `most`;
    a smaller value compresses better.
    """

    def counted(name: str, values: np.ndarray) -> tuple[dict[str, np.ndarray], list[NodeProto]]:
        largest = np.abs(values).max(axis=tuple(range(1, values.ndim)), keepdims=True)
        unit = np.where(largest > 0, largest, 1.0).astype(np.float32) / most
        stored = {f"{name}_count": np.round(values / unit).astype(np.int8), f"{name}_unit": unit}
        multiply = helper.make_node("Mul", [f"{name}_whole", f"{name}_unit"], [name])
        return stored, [_cast(f"{name}_count", f"{name}_whole"), multiply]

    return _replace_large_weights(model, counted)


def strip_metadata(model: ModelProto) -> ModelProto:
    """Drop the origins of operations, which are a third of a file, and number the constants."""
    outputs = {output.name for output in model.graph.output}  # an output that is a constant keeps its name
    constants = [constant for constant in model.graph.initializer if constant.name not in outputs]
    numbers = {constant.name: f"c{number}" for number, constant in enumerate(constants)}
    for constant in constants:
        constant.name = numbers[constant.name]
    for node in model.graph.node:
        del node.metadata_props[:]
        node.ClearField("doc_string")
        node.ClearField("name")
        node.input[:] = [numbers.get(name, name) for name in node.input]
    del model.graph.value_info[:]
    del model.graph.metadata_props[:]
    del model.metadata_props[:]
    return model


def _replace_large_weights(
    model: ModelProto, store: Callable[[str, np.ndarray], tuple[dict[str, np.ndarray], list[NodeProto]]]
) -> ModelProto:
    """Replace each large weight by the constants of `store` and by the nodes that unpack them."""
    graph, unpacking = model.graph, list[NodeProto]()
    for constant in list(graph.initializer):
        values = numpy_helper.to_array(constant)
        if values.dtype != np.float32 or values.size < _LARGE:
            continue
        constants, nodes = store(constant.name, values)
        graph.initializer.remove(constant)
        graph.initializer.extend(numpy_helper.from_array(value, name) for name, value in constants.items())
        unpacking += nodes
    for node in reversed(unpacking):
        graph.node.insert(0, node)
    return model


def _cast(name: str, to: str) -> NodeProto:
    return helper.make_node("Cast", [name], [to], to=TensorProto.FLOAT)
