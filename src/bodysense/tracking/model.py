"""Loading of completion networks: the packaged weights files, or any other one."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import json_or_text
from bodysense.tracking.core import Model

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

PACKAGED = "completion.safetensors"
PACKAGED_BACKWARD = "completion_backward.safetensors"
_COMMAND = "bodysense train completion"
_FLOATS = {"F16": "<f2", "F32": "<f4", "F64": "<f8"}  # safetensors' types of numbers → NumPy's


@dataclass(frozen=True, eq=False)
class CompletionModel:
    """A completion network at run time."""

    core: Model
    card: dict[str, Any]  # the file's metadata
    source: Traversable

    @cached_property
    def name(self) -> str:
        """The file's name."""
        return self.source.name


def load_completion(path: str | Path, backward: bool = False) -> CompletionModel:
    """Open a completion network's file (.safetensors) of the forward pass, or of the `backward` pass.

    Raises BodysenseError for any other file.
    """
    model = _opened(Path(path))
    if bool(model.card.get("backward")) != backward:
        passes = ("forward", "backward")
        raise BodysenseError(
            f"{path}: a network of the {passes[not backward]} pass; give one of the {passes[backward]} pass"
        )
    return model


@lru_cache(maxsize=2)
def packaged_model(backward: bool = False) -> CompletionModel:
    """Return the packaged network, loaded once; `backward`: the network of the backward pass."""
    from importlib.resources import files

    return _opened(files("bodysense.weights").joinpath(PACKAGED_BACKWARD if backward else PACKAGED))


def _opened(source: Traversable) -> CompletionModel:
    wanted = f"give the .safetensors that `{_COMMAND}` wrote"
    if not source.is_file():
        raise BodysenseError(f"{source}: no such model file; {wanted}")
    if source.name.endswith(".onnx"):
        raise BodysenseError(f"{source}: an .onnx file of an older version; {wanted}")
    weights = source.read_bytes()
    try:
        core = Model(weights, str(source))
    except BodysenseError as error:
        raise BodysenseError(f"{error}; {wanted}") from None
    try:
        length = int.from_bytes(weights[:8], "little")
        header, arrays = json.loads(weights[8 : 8 + length]), memoryview(weights)[8 + length :]
        _check_finite(header, arrays)
        card = {name: json_or_text(text) for name, text in header["__metadata__"].items()}
        return CompletionModel(core, card, source)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:  # text that is damaged, too
        raise BodysenseError(f"{source}: a damaged weights file ({error}); {wanted}") from None


def _check_finite(header: dict[str, Any], arrays: memoryview) -> None:
    """Raise ValueError, naming the array, for weights that are not finite."""
    for name, array in header.items():
        kind = _FLOATS.get(array.get("dtype"))
        if kind is None:
            continue
        first, end = array["data_offsets"]
        if not np.isfinite(np.frombuffer(arrays[first:end], dtype=kind)).all():
            raise ValueError(f"{name} is not finite")
