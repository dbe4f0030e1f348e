"""Weights files: they are read back as rounded, and the core opens them."""

import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.errors import BodysenseError
from bodysense.tracking.model import load_completion
from bodysense_lab.completion.networks.error_map import CERTAINTY_SCALE, INPUTS, POINTS, ErrorMap, identity_map
from bodysense_lab.completion.networks.fingers import FingerConfig, FingerNetwork
from bodysense_lab.completion.networks.network import CompletionConfig, CompletionNetwork
from bodysense_lab.completion.networks.weights_file import (
    TrainedNetworks,
    read_safetensors,
    read_weights,
    row_step,
    safetensors_bytes,
    tables_of,
    write_weights,
)

WEIGHTS = Path(str(files("bodysense.weights") / "completion.safetensors"))
SMALL = {"network": {"hidden": 16, "branch": 16, "judge_branch": 8}, "fingers": {"hidden": 8, "branch": 8}}


def small_networks() -> TrainedNetworks:
    torch.manual_seed(5)
    rng = np.random.default_rng(5)
    errors = ErrorMap(*(rng.normal(size=table.shape) for table in vars(identity_map()).values()))
    body, fingers = CompletionConfig(**SMALL["network"]), FingerConfig(**SMALL["fingers"])
    return TrainedNetworks(CompletionNetwork(body).eval(), FingerNetwork(fingers).eval(), errors, errors)


def test_networks_are_read_back_as_rounded(tmp_path: Path) -> None:
    networks, path, again = small_networks(), tmp_path / "own.safetensors", tmp_path / "again.safetensors"
    write_weights(networks, path, {"licence": "none", **SMALL})
    body, fingers = read_weights(path)
    for trained, got in ((networks.body, body), (networks.fingers, fingers)):
        for (name, a), (_, b) in zip(trained.named_parameters(), got.named_parameters(), strict=True):
            values = a.detach().numpy()
            unit = row_step(values) / 2 if values.ndim > 1 else 2.0**-11 * np.abs(values) + 2.0**-24
            assert (np.abs(b.detach().numpy() - values) <= 1.0001 * unit).all(), name
    write_weights(TrainedNetworks(body, fingers, networks.mean, networks.bound), again, {"licence": "none", **SMALL})
    assert again.read_bytes() == path.read_bytes()  # rounding what is rounded changes nothing
    assert load_completion(path).card["licence"] == "none"


def test_both_error_maps_are_one_table(tmp_path: Path) -> None:
    networks, path = small_networks(), tmp_path / "own.safetensors"
    rng = np.random.default_rng(6)
    shapes = {name: table.shape for name, table in vars(networks.mean).items()}
    networks = replace(networks, bound=ErrorMap(*(rng.normal(size=shape) for shape in shapes.values())))
    tables = tables_of(networks)
    known = rng.normal(size=INPUTS)
    metres = known.copy()
    metres[-POINTS - 22 : -22] /= CERTAINTY_SCALE
    write_weights(networks, path, SMALL)
    load_completion(path)
    stored, _ = read_safetensors(path)
    assert "errors.inward.weight.step" not in stored and "errors.weight.step" not in stored  # no bytes
    for parts, most in ((tables, 1e-4), (stored, 0.05)):
        errors = {name: table.astype(float) for name, table in parts.items() if name.startswith("errors")}
        inside = np.tanh(errors["errors.inward.weight"] @ metres + errors["errors.inward.bias"])
        together = errors["errors.weight"] @ np.concatenate([metres, inside]) + errors["errors.bias"]
        for own, of in zip(np.split(together, 2), (networks.mean, networks.bound), strict=True):
            hidden = np.tanh(known @ of.inward + of.inward_offset)
            np.testing.assert_allclose(own, known @ of.weight + hidden @ of.outward + of.offset, rtol=most, atol=most)


def test_the_packaged_networks_are_read() -> None:
    body, fingers = read_weights(WEIGHTS)
    assert sum(parameter.numel() for parameter in fingers.parameters()) > 280_000
    hidden = torch.zeros(body.config.layers, 1, body.config.hidden)
    (turned, _), _ = body.predict(torch.zeros(1, 1, body.features), hidden)
    assert turned.isfinite().all()
    assert WEIGHTS.stat().st_size <= 4.6e6


def test_numbers_of_a_file_are_aligned() -> None:
    """Numbers are aligned if the file is mapped into memory."""
    data = safetensors_bytes({"a": np.zeros(3, np.int8), "b": np.zeros(2), "c": np.zeros(5, np.float16)}, {"x": "ü"})
    size = int.from_bytes(data[:8], "little")
    assert (8 + size) % 64 == 0
    header = json.loads(data[8 : 8 + size])
    assert header.pop("__metadata__") == {"x": "ü"}
    for name, width in (("a", 1), ("b", 8), ("c", 2)):
        assert header[name]["data_offsets"][0] % width == 0


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match="no such file"):
        read_weights(tmp_path / "none.safetensors")
    other = tmp_path / "other.safetensors"
    other.write_bytes(safetensors_bytes({"a": np.zeros(3, np.float32)}, {"format": "pt"}))
    with pytest.raises(BodysenseError, match="bodysense-completion-2"):
        read_weights(other)
    for damaged in (b"", b"\xff" * 20, WEIGHTS.read_bytes()[:5000], WEIGHTS.read_bytes()[:-1]):
        other.write_bytes(damaged)
        with pytest.raises(BodysenseError, match="safetensors"):
            read_safetensors(other)
