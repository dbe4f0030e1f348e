"""Loading of completion networks: the packaged weights files, or any other one."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.tensors import tensors_of
from bodysense.tracking.core import Model

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

PACKAGED = "completion.safetensors"
PACKAGED_BACKWARD = "completion_backward.safetensors"
_COMMAND = "bodysense train completion"


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
    tensors, metadata = tensors_of(weights, str(source))
    for name, values in tensors.items():
        if not np.isfinite(values).all():
            raise BodysenseError(f"{source}: {name} is not finite, as in a damaged file; {wanted}")
    return CompletionModel(core, {name: _parsed(text) for name, text in metadata.items()}, source)


def _parsed(text: str) -> Any:
    """Return a field of the metadata, parsed as JSON if possible."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text
