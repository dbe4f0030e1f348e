"""The layers of docs/architecture.md: who imports whom, and what the run time never imports."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src"
FLOORS: dict[str, float] = {
    "errors": -2,
    "files": -1,
    "arrays": -0.5,
    "weights": -1,  # data, read by name
    "body": 0,
    "observation": 1,
    "io": 2,
    "completion": 2,
    "devices": 3,
    "demo": 3,
    "tracker": 4,
    "pictures": 4,
    "reading": 5,
    "filling": 4.5,
    "open": 4.8,
    "signals": 5.5,
    "convert": 6,
    "take": 6,
    "serve": 6,
    "lab": 6,
    "lab.serving": 6.5,  # what holds the live server to its word
    "conform": 7,
    "cli": 8,
    "lab.commands": 8.5,  # beside those of the library, of which they use a little
    "cli.laboratory": 8.6,
    "cli.application": 8.7,
    "__main__": 9,
}
FRONT_DOOR = "bodysense"  # names what the library offers, and imports it when it is asked for
LIGHT = {"numpy", "array_api_compat", "tyro", "rich"}  # what run-time modules may import at once
LAB = ("lab",)  # what comes with bodysense[lab]


def name_of(path: Path) -> str:
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(path): path for path in sorted(SOURCE.rglob("*.py"))}


def room(module: str) -> str:
    return module.partition(".")[2].partition(".")[0]


@cache
def parsed(module: str) -> ast.Module:
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


@cache
def imported(module: str, everywhere: bool) -> frozenset[str]:
    """Modules that a module imports: `everywhere` in it, or only at the moment when it is itself imported."""
    found: set[str] = set()
    todo: list[ast.AST] = [parsed(module)]
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


def test_every_module_has_a_floor() -> None:
    assert not [module for module in MODULES if module != FRONT_DOOR and room(module) not in FLOORS]


def test_modules_import_from_lower_floors_only() -> None:
    offenders = []
    for module in MODULES:
        for other in ours(imported(module, everywhere=True)) - {FRONT_DOOR}:
            if other not in MODULES:
                offenders.append(f"{module} imports {other}, which does not exist")
            elif module != FRONT_DOOR and not same(module, other) and floor(other) >= floor(module):
                offenders.append(f"{module} imports {other}")
    assert not offenders


def same(module: str, other: str) -> bool:
    """Whether both lie in one room, where order is free; the laboratory's commands are a room of their own."""
    return room(module) == room(other) and other.startswith("bodysense.lab.commands") <= (floor(module) > 8)


def floor(module: str) -> float:
    """Of the longest name in `FLOORS` that holds the module."""
    parts = module.split(".")[1:]
    names = (".".join(parts[:count]) for count in range(len(parts), 0, -1))
    return next(FLOORS[name] for name in names if name in FLOORS)


def test_the_library_never_imports_the_lab() -> None:
    """Commands do, when they run; `bodysense` without the lab has all others."""
    offenders = [
        f"{module} imports {other}"
        for module in MODULES
        if room(module) not in LAB
        for other in ours(imported(module, everywhere=room(module) != "cli"))
        if room(other) in LAB
    ]
    assert not offenders


def test_no_modules_import_each_other() -> None:
    """No circles: modules in an order in which each imports from those before it alone."""
    left = {module: ours(imported(module, everywhere=False)) & set(MODULES) - {module} for module in MODULES}
    while free := {module for module, others in left.items() if not others & set(left)}:
        left = {module: others for module, others in left.items() if module not in free}
    assert not left, f"in circles, or on the way to one: {', '.join(left)}"


def heavy(module: str, seen: set[str]) -> set[str]:
    """What comes along from outside the standard library when a module is imported."""
    if module in seen:
        return set()
    seen.add(module)
    names = imported(module, everywhere=False)
    packages = {".".join(module.split(".")[:k]) for k in range(1, module.count(".") + 1)}
    outside = {name.split(".")[0] for name in names - ours(names)} - sys.stdlib_module_names
    return outside.union(*(heavy(other, seen) for other in (ours(names) | packages) & set(MODULES)))


def test_no_two_classes_share_a_name() -> None:
    found: dict[str, list[str]] = {}
    for module in MODULES:
        for node in ast.walk(parsed(module)):
            if isinstance(node, ast.ClassDef):
                found.setdefault(node.name, []).append(module)
    assert not {name: modules for name, modules in found.items() if len(modules) > 1}


def test_the_run_time_is_light() -> None:
    heavier = {name: heavy(name, set()) - LIGHT for name in MODULES if room(name) not in LAB}
    assert not {name: packages for name, packages in heavier.items() if packages}
    assert heavy(FRONT_DOOR, set()) == set()


def test_the_check_sees_what_is_heavy() -> None:
    assert "torch" in heavy("bodysense.lab.unoc.network", set())
    assert {"torch", "onnx"} <= heavy("bodysense.lab.unoc.train", set())


def test_the_command_starts_without_the_libraries_of_training() -> None:
    code = (
        "import sys, bodysense, bodysense.cli.application; bodysense.track, bodysense.Tracker\n"
        "print(*{'torch', 'zarr', 'dask', 'onnx', 'scipy', 'onnxruntime', 'matplotlib'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_help() -> None:
    done = subprocess.run([sys.executable, "-m", "bodysense", "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for command in ("demo", "track", "simulate", "data", "train", "evaluate", "bench", "study", "serve"):
        assert command in done.stdout
