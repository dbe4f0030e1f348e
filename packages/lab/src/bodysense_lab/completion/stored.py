"""The networks of a published file, read back: to go on training from, or to look at."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper

from bodysense.errors import BodysenseError
from bodysense_lab.completion.fingers import FingerConfig, FingerNetwork
from bodysense_lab.completion.network import CompletionConfig, CompletionNetwork

FORMAT = "bodysense-completion-1"  # of the .onnx files of earlier releases
BODY, FINGERS = "step.mirrored.network.", "step.hands.network."  # what their constants' names begin with
_GATES = "_gates"  # behind the names of what a GRU holds in the order of ONNX


def read_networks(path: Path) -> tuple[CompletionNetwork, FingerNetwork]:
    """The body's and the fingers' network, with weights as they are stored: rounded.

    Raises BodysenseError where a file is no completion network, or of a release that did not name its weights.
    """
    if not path.exists():
        raise BodysenseError(f"{path}: no such file; give a completion network (.onnx)")
    model = onnx.load(str(path))
    card = {entry.key: entry.value for entry in model.metadata_props}
    if card.get("format") != FORMAT:
        raise BodysenseError(f"{path}: not a completion network (format {card.get('format')!r}, wanted {FORMAT!r})")
    constants = {each.name: numpy_helper.to_array(each) for each in model.graph.initializer}
    body = CompletionNetwork(_config(CompletionConfig, card["network"]))
    fingers = FingerNetwork(_config(FingerConfig, card["fingers"]))
    for network, prefix in ((body, BODY), (fingers, FINGERS)):
        for name, parameter in network.named_parameters():
            values = _widened(_stored(constants, prefix, name), parameter)
            if values is None or values.shape != parameter.shape:
                raise BodysenseError(f"{path}: {prefix}{name} is not in the file; give one that this release wrote")
            with torch.no_grad():
                parameter.copy_(torch.tensor(values))
    return body, fingers


def _widened(values: np.ndarray | None, parameter: torch.Tensor) -> np.ndarray | None:
    """A table of a release that read less, which is not heeded at first; others as they are."""
    if values is None or values.ndim != 2:
        return values
    return np.pad(values, ((0, 0), (0, max(0, parameter.shape[1] - values.shape[1]))))


def _config(kind: Any, text: str) -> Any:
    return kind(**json.loads(text))


def _stored(constants: dict[str, np.ndarray], prefix: str, name: str) -> np.ndarray | None:
    """A parameter, in whichever form the file has it."""
    values = _numbers(constants, prefix + name)
    if values is not None:
        return values
    # A GRU's: update, reset, new; what is added to the products with input and state, in one.
    gates = _numbers(constants, prefix + name.replace("bias_hh", "bias_ih") + _GATES)
    if gates is None:
        return None
    parts = gates[0].reshape(2, -1) if "bias" in name else gates
    update, reset, new = np.split(parts[-1 if "hh" in name else 0], 3)
    return np.concatenate([reset, update, new])


def _numbers(constants: dict[str, np.ndarray], name: str) -> np.ndarray | None:
    """A constant by the name it had before it was stored in bytes or half precision."""
    if name in constants:
        return constants[name]
    stored = {kind: constants[f"{name}_{kind}"] for kind in ("bytes", "small") if f"{name}_{kind}" in constants}
    if not stored:
        return None
    step = _numbers(constants, f"{name}_step")
    if "bytes" in stored:
        assert step is not None, name
        return stored["bytes"].T * step[:, None]
    return stored["small"].astype(np.float32) * (1 if step is None else step)
