"""Defaults of the tables' commands, and refusal of missing networks."""

from __future__ import annotations

import dataclasses
import inspect
from pathlib import Path
from typing import Any

import pytest
from people.split import write_people

from bodysense.io.clip import Clip
from bodysense_lab.commands import arms, gloves
from bodysense_lab.commands import completion as completion_commands
from bodysense_lab.commands import hmd_vae as hmd_vae_commands
from bodysense_lab.commands import rendering as rendering_commands
from bodysense_lab.commands import unoc as unoc_commands
from bodysense_lab.completion.score.tables import CompletionSettings
from bodysense_lab.completion.training import options as completion
from bodysense_lab.core.options import TableOptions
from bodysense_lab.data.datasets import DataSet
from bodysense_lab.papers.hmd_vae import options as hmd_vae
from bodysense_lab.papers.pahmt import options as pahmt
from bodysense_lab.papers.two_hands import options as two_hands
from bodysense_lab.papers.unoc import options as unoc
from bodysense_lab.rendering import options as rendering


def defaults_of(kind: Any) -> dict[str, Any]:
    """Return the defaults of a class of options."""
    return {field.name: field.default for field in dataclasses.fields(kind)}


def test_tables_score_the_test_split() -> None:
    modules = (completion, hmd_vae, pahmt, rendering, two_hands, unoc)
    kinds: set[Any] = {kind for module in modules for _, kind in inspect.getmembers(module, dataclasses.is_dataclass)}
    splits = {kind.__name__: defaults_of(kind)["split"] for kind in kinds if "split" in defaults_of(kind)}
    assert TableOptions().split == "test" and DataSet("a", Path()).split == "test"
    assert set(splits.values()) == {"test"}, splits


def test_commands_score_the_test_split() -> None:
    """Defaults of the commands themselves: `table`, `split`, or those of their dataclass of options."""
    splits: dict[str, object] = {}
    for module in (arms, completion_commands, gloves, hmd_vae_commands, rendering_commands, unoc_commands):
        for name, command in inspect.getmembers(module, inspect.isfunction):
            if command.__module__ != module.__name__ or name.startswith("_"):
                continue
            for field, parameter in inspect.signature(command).parameters.items():
                if isinstance(parameter.default, TableOptions):
                    splits[name] = parameter.default.split
                elif field == "split":
                    splits[name] = parameter.default
    assert splits.pop("unoc_table1") == "all"  # the paper's table has all data
    assert splits.pop("gloves_settings") == "val"  # settings are selected on the validation split
    assert len(splits) > 12 and set(splits.values()) == {"test"}, splits
    assert CompletionSettings().split == "test"


def test_scenes_open_the_given_network(tmp_path: Path, refused) -> None:
    output = refused("evaluate", "scenes", "--model", tmp_path / "missing.safetensors")
    assert "missing.safetensors: no such" in output


@pytest.mark.parametrize(
    ("command", "more"),
    [
        ("finger-synthesis", ()),
        ("transitions", ("--jobs", 1)),
        ("completion", ("--jobs", 1)),
        ("unoc-table2", ("--jobs", 1)),
        ("unoc-table6", ("--jobs", 1)),
    ],
)
def test_tables_open_the_given_network(
    command: str, more: tuple[object, ...], tmp_path: Path, waving_clip: Clip, refused
) -> None:
    write_people(tmp_path / "motion", {"train": [waving_clip], "test": [waving_clip]})
    missing = tmp_path / "missing.onnx"
    output = refused("evaluate", command, "--data", tmp_path / "motion", "--model", missing, *more)
    assert "missing.onnx: no such" in output.lower()


@pytest.mark.parametrize(
    ("command", "option"),
    [
        ("gloves-table3", "--model"),
        ("gloves-table4", "--markers"),
        ("gloves-table4", "--joints"),
        ("gloves-fusion", "--markers"),
        ("gloves-fusion", "--joints"),
    ],
)
def test_glove_tables_open_the_given_networks(command: str, option: str, tmp_path: Path, refused) -> None:
    output = refused("evaluate", command, "--quick", "--jobs", 1, option, tmp_path / "missing.onnx")
    assert "missing.onnx: no such" in output.lower()
