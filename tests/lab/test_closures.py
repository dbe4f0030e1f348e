"""How many of our files somebody meets who changes how a network is trained."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = (ROOT / "src", *(path / "src" for path in (ROOT / "packages").iterdir()))


@cache
def file_of(module: str) -> Path | None:
    """The file of a module of ours."""
    for source in SOURCES:
        place = source.joinpath(*module.split("."))
        for path in (place.with_suffix(".py"), place / "__init__.py"):
            if path.is_file():
                return path
    return None


def imported(path: Path) -> Iterator[str]:
    """Modules of ours that a file imports when it is imported itself."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = [f"{node.module}.{name.name}" for name in node.names]
            modules = [name for name in inside if file_of(name)]
            yield from modules
            if len(modules) < len(inside):
                yield node.module


def closure(module: str) -> set[Path]:
    """The files that are read when a module is imported, but for packages that hold a title alone."""
    found, todo = set[Path](), [module]
    while todo:
        path = file_of(todo.pop())
        if path is not None and path not in found:
            found.add(path)
            todo += imported(path)
    return {path for path in found if path.name != "__init__.py"}


@pytest.mark.parametrize(
    ("module", "most"),
    [("completion.task", 42), ("hmd_vae.train", 37), ("pahmt.train", 39), ("unoc.train", 44)],
)
def test_training_can_be_read(module: str, most: int) -> None:
    files = closure(f"bodysense_lab.{module}")
    assert len(files) > 20, "the imports are followed"
    assert len(files) <= most, sorted(path.stem for path in files)
