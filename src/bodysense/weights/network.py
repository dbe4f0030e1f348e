"""Loading of .onnx network files with metadata, run by ONNX Runtime on one thread.

The metadata of a file is its card: `format` names the kind of network, every other field is JSON. A graph carries its
state through inputs `state_…` and outputs `next_…` of equal names. The card's `state` is the initial state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from importlib.resources.abc import Traversable
from math import prod
from pathlib import Path
from typing import Any, Self

import numpy as np

from bodysense.errors import BodysenseError, missing_package
from bodysense.files import json_or_text
from bodysense.weights.formats import NetworkFormat

STATE, NEXT = "state_", "next_"  # prefixes of inputs and outputs that carry the state
_TYPES = {"tensor(float)": np.float32, "tensor(bool)": np.bool_, "tensor(int64)": np.int64}


@dataclass(frozen=True, eq=False)
class Network:
    """An open network file."""

    session: Any  # onnxruntime.InferenceSession
    card: Mapping[str, Any]
    source: Traversable
    format: NetworkFormat

    @classmethod
    def open(cls, path: str | Path | None, format: NetworkFormat, *, batch: int | None = None) -> Self:
        """Open the file at a path, or the packaged one if `path` is None.

        `batch` fixes the batch size of a file with a variable one, which is faster.

        Raises BodysenseError for a file that does not exist, is no ONNX model, or is of another format.
        """
        try:
            import onnxruntime
        except ImportError as error:
            raise missing_package(error) from None
        if path is None:
            assert format.packaged is not None, f"no {format.kind} is packaged"
            source: Traversable = files("bodysense.weights").joinpath(format.packaged)
        else:
            source = Path(path)
        if not source.is_file():
            raise BodysenseError(f"{source}: no such model file; give the .onnx that `{format.command}` wrote")
        if Path(source.name).suffix == ".pt":
            raise BodysenseError(
                f"{source}: weights of a training; give the .onnx that the same `{format.command}` writes with "
                f"-o {Path(source.name).with_suffix('.onnx')}"
            )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        if batch is not None:
            options.add_free_dimension_override_by_name("batch", batch)
        try:
            session = onnxruntime.InferenceSession(source.read_bytes(), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # ONNX Runtime raises its own exceptions for broken files
            reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
            raise BodysenseError(f"{source}: not a readable ONNX model ({reason})") from None
        card = dict(session.get_modelmeta().custom_metadata_map)
        found = card.pop("format", None)
        if found != format.name:
            raise BodysenseError(
                f"{source}: not a bodysense {format.kind} (format {found or 'not given'!r}, wanted {format.name!r}); "
                f"give the .onnx that `{format.command}` wrote"
            )
        missing = [name for name in format.fields if name not in card]
        if missing:
            raise BodysenseError(f"{source}: its card has no {missing[0]!r}; export the network again")
        return cls(session, {name: json_or_text(value) for name, value in card.items()}, source, format)

    @property
    def name(self) -> str:
        """The file's name."""
        return self.source.name

    @cached_property
    def inputs(self) -> tuple[str, ...]:
        """Names of the graph's inputs. The file has only inputs that the network needs."""
        return tuple(value.name for value in self.session.get_inputs())

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Names of the graph's outputs."""
        return tuple(value.name for value in self.session.get_outputs())

    def start(self, batch: int = 1) -> dict[str, np.ndarray]:
        """Return the state (batch, …) before the first frame, by input."""
        return {name: np.repeat(values, batch, axis=0) for name, values in self._start.items()}

    def run(self, inputs: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return all outputs by name; inputs that the graph does not have are ignored."""
        feed = {name: inputs[name] for name in self.inputs if name in inputs}
        return dict(zip(self.outputs, self.session.run(self.outputs, feed), strict=True))

    def step(
        self, inputs: Mapping[str, np.ndarray], state: Mapping[str, np.ndarray]
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Run one step; return the outputs without the state, and the state."""
        outputs = self.run({**inputs, **state})
        return outputs, {name: outputs.pop(NEXT + name.removeprefix(STATE)) for name in state}

    @cached_property
    def _start(self) -> dict[str, np.ndarray]:
        """State (1, …) before the first frame, by input."""
        rows = self.card.get("state", {})
        start = {}
        for value in self.session.get_inputs():
            if not value.name.startswith(STATE):
                continue
            shape, short = value.shape[1:], value.name.removeprefix(STATE)
            row = rows.get(short) or rows.get(value.name) or {}
            initial = row.get("start", row.get("values"))
            if initial is not None and np.size(initial) != prod(shape):
                raise BodysenseError(
                    f"{self.source}: its card starts {short!r} with {np.size(initial)} numbers, but the graph reads "
                    f"{prod(shape)}; export the network again"
                )
            values = np.zeros(shape) if initial is None else np.reshape(initial, shape)
            start[value.name] = values[None].astype(_TYPES[value.type])
        return start
