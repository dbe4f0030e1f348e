"""Weights file of a completion network, as the core reads it: safetensors with a model card as metadata.

A file has eight bytes of length, a JSON header and the numbers. `__metadata__` is the model card: `format` is the kind
of network, and all other fields are JSON. Large tables are bytes in units of a `.step` for each row.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bodysense.body.shape import shape_space
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.tensors import TYPES, tensors_of
from bodysense_lab.completion.data.points import reference_offsets
from bodysense_lab.completion.networks.error_map import ErrorMap, error_tables
from bodysense_lab.completion.networks.fingers import FingerConfig, FingerNetwork
from bodysense_lab.completion.networks.network import CompletionConfig, CompletionNetwork

FORMAT = "bodysense-completion-2"
# Tables that are multiplied most. The last layer of rotations and the error maps keep half precision: with error maps
# in bytes, bounds of 90 % covered only 79 % of the errors of some sensor sets.
_IN_BYTES = ("body.recurrent.weight", "body.updates", "body.turn_branch.0.weight", "body.judge_branch", "fingers")
_EXACT = ("usual_bones", "standing", "relaxed", "errors.bias", "errors.inward.bias")
_ALIGNMENT = 64  # bytes, of length and header together, so that numbers are aligned in a memory map


@dataclass(frozen=True, eq=False)
class TrainedNetworks:
    """Contents of a file: both networks, and the maps that calibrate expected errors and their bounds."""

    body: CompletionNetwork
    fingers: FingerNetwork
    mean: ErrorMap
    bound: ErrorMap


def write_weights(networks: TrainedNetworks, path: Path, card: Mapping[str, Any]) -> None:
    """Write trained networks in the types of a file, with `card`: training data, licence, figures.

    The file appears whole or not at all.
    """
    skeleton = default_skeleton()
    trained = [*networks.body.parameters(), *networks.fingers.parameters()]
    fields = {
        "points": skeleton.points,
        "joints": skeleton.joints,
        "weights": sum(parameter.numel() for parameter in trained),
        **card,
    }
    metadata = {"format": FORMAT} | {name: json.dumps(value) for name, value in fields.items()}
    with written_beside(path) as beside:
        beside.write_bytes(safetensors_bytes(_stored(tables_of(networks)), metadata))


def tables_of(networks: TrainedNetworks) -> dict[str, np.ndarray]:
    """Return all tables that the core reads, by name."""
    body, fingers = networks.body, networks.fingers
    tables = {f"body.{name}": value for name, value in body.named_parameters()}
    tables |= {f"fingers.{name}": value for name, value in fingers.named_parameters()}
    tables |= {
        "body.usual_bones": torch.tensor(reference_offsets()),
        "body.standing": body.standing_axes.flatten(1),
        "fingers.usual_bones": fingers.usual_bones,
        "fingers.relaxed": fingers.relaxed.flatten(1),
    }
    errors = {f"errors.{name}": table for name, table in error_tables(networks.mean, networks.bound).items()}
    shapes = {"shape.mean": shape_space().mean, "shape.components": shape_space().components}
    return {name: value.detach().numpy().astype(np.float32) for name, value in tables.items()} | errors | shapes


def read_weights(path: Path) -> tuple[CompletionNetwork, FingerNetwork]:
    """Read the body's and the fingers' network of a file.

    Raises BodysenseError for a file that is missing or is not a completion network.
    """
    tensors, card = read_safetensors(path)
    if card.get("format") != FORMAT:
        raise BodysenseError(
            f"{path}: not a completion network (format {card.get('format')!r}, wanted {FORMAT!r}); give the "
            ".safetensors that `bodysense train completion` wrote"
        )
    body = CompletionNetwork(CompletionConfig(**json.loads(card["network"])))
    fingers = FingerNetwork(FingerConfig(**json.loads(card["fingers"])))
    for prefix, network in (("body", body), ("fingers", fingers)):
        for name, parameter in network.named_parameters():
            key = f"{prefix}.{name}"
            values = tensors.get(key)
            if prefix == "body" and values is not None and values.ndim == parameter.ndim == 2:
                missing = max(parameter.shape[1] - values.shape[1], 0)  # inputs, at the end, of newer networks
                values = np.pad(values, ((0, 0), (0, missing)))
            if values is None or values.shape != parameter.shape:
                raise BodysenseError(f"{path}: {key} is missing or of another shape; train the network again")
            whole = values.astype(np.float32) * (tensors[f"{key}.step"][:, None] if values.dtype == np.int8 else 1)
            with torch.no_grad():
                parameter.copy_(torch.from_numpy(whole))
    return body, fingers


def row_step(values: np.ndarray) -> np.ndarray:
    """Return the unit (..., 1), float32, of each row of values when stored in bytes.

    It has few digits, so that its multiples are exact and rounding is idempotent.
    """
    largest = np.abs(values).max(axis=-1, keepdims=True, initial=0.0).astype(np.float64)
    digits, exponent = np.frexp(np.where(largest > 0, largest, 1.0) / 127)
    return np.ldexp(np.ceil(digits * 2048) / 2048, exponent).astype(np.float32)


def safetensors_bytes(tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> bytes:
    """Return tensors and metadata as the bytes of a safetensors file."""
    header: dict[str, Any] = {"__metadata__": dict(metadata)}
    kinds, parts, place = {np.dtype(kind): name for name, kind in TYPES.items()}, list[bytes](), 0
    # Wide types come first, so that each table is aligned.
    for name, values in sorted(tensors.items(), key=lambda item: -item[1].itemsize):
        parts.append(np.ascontiguousarray(values).tobytes())
        size = len(parts[-1])
        header[name] = {
            "dtype": kinds[values.dtype],
            "shape": list(values.shape),
            "data_offsets": [place, place + size],
        }
        place += size
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-(8 + len(text)) % _ALIGNMENT)
    return struct.pack("<Q", len(text)) + text + b"".join(parts)


def read_safetensors(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Read tensors and metadata of a file. Raises BodysenseError if it is missing, damaged or of other types."""
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file; give a completion network (.safetensors)")
    return tensors_of(path.read_bytes(), str(path))


def _stored(tables: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Convert tables to the types of a file: bytes with the step of each row, half precision, or float32."""
    stored = dict[str, np.ndarray]()
    for name, values in tables.items():
        half = values.astype(np.float16)
        if name.startswith("shape"):
            stored[name] = values  # proportions are inferred in double precision
        elif values.ndim == 2 and "weight" in name and name.startswith(_IN_BYTES):
            step = row_step(values)
            stored[name], stored[f"{name}.step"] = np.round(values / step).astype(np.int8), step[:, 0]
        else:
            stored[name] = values if name.endswith(_EXACT) and (half != values).any() else half
    return stored
