"""Number of files that a reader of a training must read: all imports count, inside functions, too."""

from __future__ import annotations

import pytest
from import_graph import closure, imported, largest_savings

SLACK = 1.1  # the numbers below are at most a tenth above what is measured
MOST = {"completion.train": 60, "papers.hmd_vae.train": 34, "papers.pahmt.train": 38, "papers.unoc.train": 48}


@pytest.mark.parametrize("name", MOST)
def test_trainings_import_few_files(name: str) -> None:
    module = f"bodysense_lab.{name}"
    size = len(closure(module))
    savings = "; ".join(largest_savings(module))
    assert size <= MOST[name], f"{size} files; {savings}"
    assert MOST[name] <= SLACK * size, f"{size} files: lower the number of {name}"


def test_imports_inside_functions_count() -> None:
    """The command's module imports its training inside functions only."""
    command = "bodysense_lab.commands.train"
    assert not any(".train" in name for name in imported(command, when="import"))
    assert any(name.endswith("completion.train") for name in closure(command))
