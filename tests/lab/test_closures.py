"""Number of files that a reader of a training must read."""

from __future__ import annotations

import pytest
from test_rooms import MODULES, imported, ours


def closure(module: str) -> set[str]:
    """Return the modules that a module imports, without packages that contain only a title."""
    found, todo = set[str](), [module]
    while todo:
        one = todo.pop()
        if one in MODULES and one not in found:
            found.add(one)
            todo += ours(imported(one, everywhere=False))
    return {one for one in found if MODULES[one].name != "__init__.py"}


@pytest.mark.parametrize(
    ("module", "most"),
    [("completion.train", 48), ("papers.hmd_vae.train", 39), ("papers.pahmt.train", 41), ("papers.unoc.train", 44)],
)
def test_trainings_import_few_files(module: str, most: int) -> None:
    modules = closure(f"bodysense_lab.{module}")
    assert len(modules) > 20, "the imports are followed"
    assert len(modules) <= most, sorted(modules)
