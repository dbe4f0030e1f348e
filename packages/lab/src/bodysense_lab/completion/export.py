"""The completion network as one self-describing ONNX file."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.skeleton import default_skeleton
from bodysense.observation import STRAPPED
from bodysense_lab.completion.graph import CompletionStep
from bodysense_lab.completion.rewriting import LARGE, row_step, shortened, stored_small
from bodysense_lab.completion.state import JOINT_COUNT, POINT_COUNT, Inputs, Outputs, State
from bodysense_lab.completion.stored import BODY, FINGERS, FORMAT
from bodysense_lab.completion.whole_numbers import whole_products
from bodysense_lab.export import export

# Whose weights are stored in bytes; what turns the body's joints in the end keeps half precision.
_IN_BYTES = ("body.recurrent", "body.turn_branch.0", "body.judge_branch", "finger_network")
_OPSET = 18


class _Flat(nn.Module):
    """The step with inputs, state and outputs as separate tensors."""

    def __init__(self, step: CompletionStep) -> None:
        super().__init__()
        self.step = step

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        count = len(Inputs._fields)
        outputs, state = self.step(Inputs(*values[:count]), State(*values[count:]))
        return (*outputs, *state)


def example_inputs(batch: int) -> Inputs:
    """Nothing tracked, on the default body."""
    skeleton = default_skeleton()
    return Inputs(
        position=torch.zeros(batch, POINT_COUNT, 3),
        rotation=torch.tensor([1.0, 0, 0, 0]).expand(batch, JOINT_COUNT, 4).clone(),
        has_position=torch.zeros(batch, POINT_COUNT, dtype=torch.bool),
        has_rotation=torch.zeros(batch, JOINT_COUNT, dtype=torch.bool),
        accuracy=torch.full((batch, POINT_COUNT), 0.001),
        interval=torch.full((batch,), 1 / 30),
        rest_offset=torch.tensor(skeleton.rest_offset.copy(), dtype=torch.float32).expand(batch, -1, -1).clone(),
        certainty=torch.zeros(batch, POINT_COUNT),
        floor=torch.zeros(batch),
        hold=torch.ones(batch),
        acceleration=torch.zeros(batch, len(STRAPPED), 3),
        has_acceleration=torch.zeros(batch, len(STRAPPED), dtype=torch.bool),
    )


def as_stored(step: CompletionStep) -> CompletionStep:
    """A copy of a step with its weights rounded as a file stores them: what the file computes is what this computes."""
    step = copy.deepcopy(step).eval()
    with torch.no_grad():
        for name, parameter in step.named_parameters():
            if name.startswith(_IN_BYTES) and parameter.ndim > 1:
                parameter.copy_(_in_bytes(parameter))
            else:
                parameter.copy_(parameter.half())
        table = step.expected_errors.weight
        table.copy_(table.half())
        table = step.expected_errors.inward
        table.copy_(_in_bytes(table))
    return step


def _in_bytes(table: Tensor) -> Tensor:
    """A table whose rows are whole multiples of what each counts in."""
    values = table.detach().numpy()
    unit = row_step(values)
    return torch.from_numpy(np.round(values / unit) * unit)


def write_completion(step: CompletionStep, path: Path, card: dict[str, Any], large: int = LARGE) -> None:
    """Write the whole step, batch axis free, with `card`: training data, licence, figures.

    The file appears whole or not at all. Weights are rounded, see `as_stored`; products with
    `large` of them or more are in whole numbers.
    """
    step = as_stored(step)
    start = step.start(3)  # a number that stands for any must not be one that means something
    inputs = example_inputs(3)
    batch = torch.export.Dim("batch", min=1, max=4096)
    card = {
        "points": default_skeleton().points,
        "joints": default_skeleton().joints,
        "state": {
            name: {"shape": list(value.shape[1:]), "start": value[0].flatten().tolist() if value.any() else None}
            for name, value in zip(State._fields, start, strict=True)
        },
        "weights": sum(parameter.numel() for parameter in step.parameters()),
        **card,
    }
    export(
        _Flat(step),
        (*inputs, *start),
        [*Inputs._fields, *(f"state_{name}" for name in State._fields)],
        [*Outputs._fields, *(f"next_{name}" for name in State._fields)],
        FORMAT,
        card,
        path,
        dynamic_shapes=(tuple({0: batch} for _ in (*inputs, *start)),),
        shrink=lambda model: stored_small(whole_products(shortened(model, large), large)),
        opset=_OPSET,
        named=(BODY, FINGERS),
    )
