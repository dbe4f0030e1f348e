"""Imports among the modules of all packages. Tests hold rules about them, and `house.py` prints their sizes."""

from __future__ import annotations

import ast
import gc
from functools import cache
from pathlib import Path
from typing import Literal

ROOT = Path(__file__).resolve().parents[1]
SOURCES = {
    "bodysense": ROOT / "src",
    **{f"bodysense_{path.name}": path / "src" for path in (ROOT / "packages").iterdir()},
}
When = Literal["import", "run", "any"]  # while it is imported; in its functions, too; and for types alone, too
Arrow = tuple[str, str]  # importer, imported


def name_of(path: Path, source: Path) -> str:
    """Return the dotted name of a module's file."""
    parts = path.relative_to(source).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(path, source): path for source in SOURCES.values() for path in sorted(source.rglob("*.py"))}


def package(module: str) -> str:
    """Return the first part of a module's name."""
    return module.partition(".")[0]


@cache
def parsed(module: str) -> ast.Module:
    """Return the syntax tree of a module. Looking for unused objects meanwhile would take twice as long as the rest."""
    gc.disable()
    try:
        return ast.parse(MODULES[module].read_text(encoding="utf-8"))
    finally:
        gc.enable()


@cache
def imported(module: str, when: When) -> frozenset[str]:
    """Return the modules that a module imports."""
    names: set[str] = set()
    todo: list[ast.AST] = [parsed(module)]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level and node.module, f"{module}: imports are absolute"
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in MODULES else node.module for name in whole}
        elif isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING" and when != "any":
            todo += node.orelse
        elif when != "import" or not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            todo += (child for child in ast.iter_child_nodes(node) if not isinstance(child, ast.expr))
    return frozenset(names)


def ours(names: frozenset[str]) -> set[str]:
    """Return the names of modules of our packages."""
    return {name for name in names if package(name) in SOURCES}


def circles() -> set[Arrow]:
    """Return the imports of modules that import each other, inside functions, too."""
    remaining = {module: ours(imported(module, "run")) & set(MODULES) - {module} for module in MODULES}
    while free := {module for module, others in remaining.items() if not others & set(remaining)}:
        remaining = {module: others for module, others in remaining.items() if module not in free}
    while top := set(remaining) - set[str]().union(*remaining.values()):
        remaining = {module: others for module, others in remaining.items() if module not in top}
    return {(module, other) for module, others in remaining.items() for other in others & set(remaining)}


def closure(module: str, cut: Arrow | None = None) -> set[str]:
    """Return the modules that a module imports, inside functions, too, without packages that contain only a title.

    `cut` is an import that is left out.
    """
    reached, todo = set[str](), [module]
    while todo:
        one = todo.pop()
        if one in MODULES and one not in reached:
            reached.add(one)
            todo += (other for other in ours(imported(one, "run")) if (one, other) != cut)
    return {one for one in reached if MODULES[one].name != "__init__.py"}


def largest_savings(module: str, count: int = 8) -> list[str]:
    """Return the imports without which the closure of a module would lose the most files."""
    files = closure(module)
    arrows = ((one, other) for one in files for other in ours(imported(one, "run")) if other in files)
    saved = sorted(((len(files) - len(closure(module, arrow)), *arrow) for arrow in arrows), reverse=True)
    return [f"{fewer} files less without {one} → {other}" for fewer, one, other in saved[:count]]
