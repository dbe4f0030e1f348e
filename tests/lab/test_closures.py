"""Number of files that a reader of a training must read: all imports count, inside functions, too."""

from __future__ import annotations

import pytest
from test_rooms import MODULES, imported, ours

Arrow = tuple[str, str]  # importer, imported
SLACK = 1.1  # the numbers below are at most a tenth above what is measured
MOST = {"completion.train": 96, "papers.hmd_vae.train": 80, "papers.pahmt.train": 74, "papers.unoc.train": 88}


def closure(module: str, cut: Arrow | None = None) -> set[str]:
    """Return the modules that a module imports, without packages that contain only a title."""
    reached, todo = set[str](), [module]
    while todo:
        one = todo.pop()
        if one in MODULES and one not in reached:
            reached.add(one)
            todo += (other for other in ours(imported(one, when="run")) if (one, other) != cut)
    return {one for one in reached if MODULES[one].name != "__init__.py"}


def largest_savings(module: str, count: int = 8) -> list[str]:
    """Return the imports without which the closure would lose the most files."""
    files = closure(module)
    arrows = ((one, other) for one in files for other in ours(imported(one, when="run")) if other in files)
    saved = sorted(((len(files) - len(closure(module, arrow)), *arrow) for arrow in arrows), reverse=True)
    return [f"{files} files less without {one} → {other}" for files, one, other in saved[:count]]


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
