"""Files of networks that are damaged, or not of the forward pass: one line each."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from bodysense.errors import BodysenseError
from bodysense.tracking.model import PACKAGED, PACKAGED_BACKWARD, load_completion, packaged_model


@cache
def weights(name: str = PACKAGED) -> bytes:
    return files("bodysense.weights").joinpath(name).read_bytes()


def header_end() -> int:
    return 8 + int.from_bytes(weights()[:8], "little")


def refusal(path: Path) -> str:
    with pytest.raises(BodysenseError) as caught:
        load_completion(path)
    line = str(caught.value)
    assert str(path) in line and "\n" not in line
    return line


def test_any_damage_of_the_header_is_one_line_or_harmless(tmp_path: Path) -> None:
    """Bytes of the header are replaced, among them ones that are not UTF-8."""
    path = tmp_path / "a.safetensors"
    path.write_bytes(weights())
    for seed in range(60):
        rng, damaged = np.random.default_rng(seed), bytearray(weights()[: header_end()])
        for place in rng.integers(0, header_end(), int(rng.integers(1, 4))):
            damaged[place] = int(rng.choice([0xFF, 0xC0, 0x22, 0x7B, 0x00, int(rng.integers(256))]))
        with path.open("r+b") as file:
            file.write(damaged)
        try:
            load_completion(path)
        except BodysenseError as error:
            assert str(path) in str(error) and "\n" not in str(error), seed


def test_text_that_is_not_unicode_is_damage(tmp_path: Path) -> None:
    place = weights().index(b"Apache-2.0")
    path = tmp_path / "a.safetensors"
    path.write_bytes(weights()[:place] + b"\xff" + weights()[place + 1 :])
    assert "damaged weights file" in refusal(path)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_weights_that_are_not_finite_are_named(tmp_path: Path, value: float) -> None:
    header = json.loads(weights()[8 : header_end()])
    kinds = {"F16": "<f2", "F32": "<f4", "F64": "<f8"}
    names = [name for name, array in header.items() if array.get("dtype") in kinds]
    for name in np.random.default_rng(0).choice(names, 4, replace=False):
        damaged, (first, end) = bytearray(weights()), header[name]["data_offsets"]
        kind = np.dtype(kinds[header[name]["dtype"]])
        array = np.frombuffer(damaged, kind, (end - first) // kind.itemsize, header_end() + first)
        array[len(array) // 2] = value
        path = tmp_path / "a.safetensors"
        path.write_bytes(damaged)
        line = refusal(path)
        assert name in line or "finite" in line


def test_a_network_of_the_backward_pass_tracks_nothing(tmp_path: Path) -> None:
    path = tmp_path / "backward.safetensors"
    path.write_bytes(weights(PACKAGED_BACKWARD))
    assert "a network of the backward pass" in refusal(path)
    path.write_bytes(weights())
    assert load_completion(path).card == packaged_model().card
