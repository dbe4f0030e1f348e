"""The rooms of docs/architecture.md: who imports whom, and what the run time never imports."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src"
FLOORS = {
    "": -2,  # the package itself: its version
    "errors": -2,
    "files": -1,
    "weights": -1,  # data, read by name
    "body": 0,
    "observation": 1,
    "capture": 2,
    "completion": 2,
    "data": 2,
    "occlusion": 2,
    "estimators": 3,
    "models": 3,
    "demo": 3,
    "devices": 4,
    "tracker": 4,
    "export": 4,
    "training": 5,
    "evaluation": 5,
    "serve": 5,
    "lab": 6,
    "cli": 7,
    "__main__": 8,
}
LIGHT = {"numpy", "array_api_compat", "tyro", "rich"}  # what run-time modules may import at once
TRAINING_ONLY = (
    *("bodysense.lab", "bodysense.models", "bodysense.training", "bodysense.data.store"),
    *("bodysense.evaluation.variants", "bodysense.evaluation.body_vae", "bodysense.evaluation.arm_table"),
)


def name_of(path: Path) -> str:
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(path): path for path in sorted(SOURCE.rglob("*.py"))}


def room(module: str) -> str:
    return module.partition(".")[2].partition(".")[0]


@cache
def imported(module: str, everywhere: bool) -> frozenset[str]:
    """Modules that a module imports: `everywhere` in it, or only at the moment when it is itself imported."""
    found: set[str] = set()
    todo: list[ast.AST] = [ast.parse(MODULES[module].read_text(encoding="utf-8"))]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level and node.module, f"{module}: imports are absolute"
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {name if name in MODULES else node.module for name in whole}
        elif everywhere or not waits(node):
            todo += ast.iter_child_nodes(node)
    return frozenset(found)


def waits(node: ast.AST) -> bool:
    """Whether what stands in a node does not run on import."""
    is_function = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
    return is_function or (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")


def ours(names: frozenset[str]) -> set[str]:
    return {name for name in names if name.split(".")[0] == "bodysense"}


@pytest.mark.parametrize("module", MODULES)
def test_a_module_imports_from_lower_floors_only(module: str) -> None:
    assert room(module) in FLOORS, f"{module}: which floor is it on?"
    for other in ours(imported(module, everywhere=True)):
        assert other in MODULES, f"{module} imports {other}, which does not exist"
        if room(other) != room(module):
            assert FLOORS[room(other)] < FLOORS[room(module)], f"{module} imports {other}"


def heavy(module: str, seen: set[str]) -> set[str]:
    """What comes along from outside the standard library when a module is imported."""
    if module in seen:
        return set()
    seen.add(module)
    names = imported(module, everywhere=False)
    packages = {".".join(module.split(".")[:k]) for k in range(1, module.count(".") + 1)}
    outside = {name.split(".")[0] for name in names - ours(names)} - sys.stdlib_module_names
    return outside.union(*(heavy(other, seen) for other in (ours(names) | packages) & set(MODULES)))


@pytest.mark.parametrize("module", [name for name in MODULES if not name.startswith(TRAINING_ONLY)])
def test_the_run_time_is_light(module: str) -> None:
    assert heavy(module, set()) <= LIGHT


def test_the_check_sees_what_is_heavy() -> None:
    assert "torch" in heavy("bodysense.models.body_network", set())
    assert {"torch", "onnx"} <= heavy("bodysense.training.run", set())


def test_the_command_starts_without_the_libraries_of_training() -> None:
    code = (
        "import sys, bodysense.cli.application, bodysense.data.sources, bodysense.estimators.learned\n"
        "print(*{'torch', 'zarr', 'dask', 'onnx', 'scipy', 'onnxruntime', 'matplotlib'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_help() -> None:
    done = subprocess.run([sys.executable, "-m", "bodysense", "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for command in ("demo", "track", "simulate", "data", "train", "evaluate", "bench", "study", "serve"):
        assert command in done.stdout
