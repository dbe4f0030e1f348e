"""Sampled mutation run: break the sources in random places, one at a time, and check that the tests of that area fail.

    python scripts/mutate.py --count 40                  # fresh mutants of today
    python scripts/mutate.py --seed 20261129 --only bodysense.takes

The seed is the date unless it is given. Rooms are drawn evenly, then modules by their number of places. A mutant
changes one operator, comparison, number or condition in a copy of the sources. It is killed if a test fails, or does
not end within ten minutes. Its tests are those that import its module, else those of its room. The run fails if fewer
than 85 % are killed. Survivors are printed with their line: each owes a test, or the line does nothing.
"""

from __future__ import annotations

import argparse
import ast
import copy
import os
import random  # noqa: TID251 (choices of words and places, by a seed)
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from import_graph import MODULES, ROOT, parsed

SOURCES = ("src", "packages", "core", "scripts", "hatch_build.py")
SHARE = 0.85  # share of the mutants that must be killed
LONGEST = 600  # s of the tests of one mutant
MOST_FILES = 8  # test files that run for one mutant
PASSED, FAILED, INTERRUPTED = 0, 1, 2  # exit statuses of pytest
SWAPS: dict[type, type] = {
    **{ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.BitAnd: ast.BitOr},
    **{ast.BitOr: ast.BitAnd, ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq},
    **{ast.NotEq: ast.Eq, ast.And: ast.Or, ast.Or: ast.And, ast.Is: ast.IsNot, ast.IsNot: ast.Is},
}
NAMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "any": "all", "all": "any"}
HARMLESS = {
    "frozen",
    "eq",
    "repr",
    "slots",
    "strict",
    "maxsize",
    "encoding",
    "check",
    "exist_ok",
    "parents",
}  # arguments


@dataclass(frozen=True)
class Mutant:
    """A changed expression of a module."""

    module: str
    line: int
    old: str
    new: str
    text: str  # of the whole file


def changed(node: ast.AST) -> ast.AST | None:
    """Return a changed copy of a node, or None if nothing of it is changed."""
    other = copy.deepcopy(node)
    if isinstance(other, ast.BinOp) and isinstance(other.right, ast.Constant) and other.right.value is None:
        return None  # a type
    if isinstance(other, (ast.BinOp, ast.BoolOp)) and type(other.op) in SWAPS:
        other.op = SWAPS[type(other.op)]()
    elif isinstance(other, ast.Compare) and type(other.ops[0]) in SWAPS:
        other.ops[0] = SWAPS[type(other.ops[0])]()
    elif (
        isinstance(other, ast.Constant) and isinstance(other.value, (int, float)) and not isinstance(other.value, bool)
    ):
        other.value = 2 * other.value or 1
    elif isinstance(other, ast.UnaryOp) and isinstance(other.op, (ast.Not, ast.USub)):
        return other.operand
    elif isinstance(other, ast.IfExp):
        other.body, other.orelse = other.orelse, other.body
    elif isinstance(other, ast.Name) and other.id in NAMES:
        other.id = NAMES[other.id]
    elif isinstance(other, ast.Attribute) and other.attr in NAMES:
        other.attr = NAMES[other.attr]
    else:
        return None
    return other


def places(module: str) -> list[tuple[ast.expr, ast.AST]]:
    """Return the expressions of a module that can be changed, with their changed copies."""
    skipped = set[int]()
    tree = parsed(module)
    for node in ast.walk(tree):
        inert = [node.annotation] if isinstance(node, (ast.arg, ast.AnnAssign)) else []
        if isinstance(node, ast.FunctionDef):
            inert = [node.returns, *node.decorator_list]
        elif isinstance(node, (ast.JoinedStr, ast.Raise, ast.Assert)):
            inert = [node]
        elif isinstance(node, ast.keyword) and node.arg in HARMLESS:
            inert = [node.value]
        for one in filter(None, inert):
            skipped |= {id(part) for part in ast.walk(one)}
    found = ((node, changed(node)) for node in ast.walk(tree) if isinstance(node, ast.expr) and id(node) not in skipped)
    return [(node, other) for node, other in found if other is not None]


def mutant(module: str, node: ast.expr, other: ast.AST) -> Mutant:
    """Return a mutant from an expression and its changed copy."""
    text = MODULES[module].read_text(encoding="utf-8")
    lines = text.splitlines(keepends=True)
    old = ast.get_source_segment(text, node)
    assert old is not None and node.end_lineno is not None and node.end_col_offset is not None
    before = lines[node.lineno - 1].encode()[: node.col_offset].decode()
    after = lines[node.end_lineno - 1].encode()[node.end_col_offset :].decode()
    new = ast.unparse(other) if isinstance(other, (ast.Name, ast.Attribute)) else f"({ast.unparse(other)})"
    whole = "".join([*lines[: node.lineno - 1], before, new, after, *lines[node.end_lineno :]])
    return Mutant(module, node.lineno, old, new, whole)


def draw(count: int, rng: random.Random, only: str) -> Iterator[Mutant]:
    """Yield random mutants: rooms evenly, then modules by their number of places."""
    rooms: dict[str, list[tuple[str, ast.expr, ast.AST]]] = {}
    for module in MODULES:
        if module.startswith(only):
            room = ".".join(module.split(".")[:2])
            rooms.setdefault(room, []).extend((module, *one) for one in places(module))
    rooms = {name: found for name, found in rooms.items() if found}
    if not rooms:
        sys.exit(f"--only {only}: no module with this beginning has a place to change")
    for _ in range(count):
        yield mutant(*rng.choice(rooms[rng.choice(sorted(rooms))]))


def tests_of(module: str) -> list[str]:
    """Return the test files that name a module in an import, nearest folders first; else the tests of its room."""
    parts = module.split(".")
    stem, names = parts[-1], {f"from {module} import", f"from {'.'.join(parts[:-1])} import {parts[-1]}"}
    files = [path for path in sorted((ROOT / "tests").rglob("test_*.py")) if "web" not in path.parts]
    found = [path for path in files if any(name in path.read_text(encoding="utf-8") for name in names)]
    found.sort(key=lambda path: (stem not in path.stem, -len(set(path.parts) & set(parts)), path))
    if not found:
        package = parts[0].removeprefix("bodysense").removeprefix("_")
        folders = [Path("tests", *filter(None, [package, *parts[1:k]])) for k in range(len(parts), 0, -1)]
        found = [next(folder for folder in [*folders, Path("tests/cli")] if (ROOT / folder).is_dir())]
    return [str(path.relative_to(ROOT) if path.is_absolute() else path) for path in found[:MOST_FILES]]


def outcome(one: Mutant) -> str:
    """Return 'killed', 'survived' or why its tests did not run."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        work = Path(folder)
        for name in SOURCES:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, work / name, copy_function=os.symlink)
            else:
                (work / name).symlink_to(ROOT / name)
        path = work / MODULES[one.module].relative_to(ROOT)
        path.unlink()
        path.write_text(one.text, encoding="utf-8")
        folders = [work / "src", *(work / "packages" / name / "src" for name in ("live", "conform", "lab"))]
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(map(str, folders)),
            "PYTHONDONTWRITEBYTECODE": "1",
            "OMP_NUM_THREADS": "1",
        }
        command = [sys.executable, "-m", "pytest", "-n", "0", "-x", "-p", "no:cacheprovider", *tests_of(one.module)]
        try:
            done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, timeout=LONGEST, check=False)
        except subprocess.TimeoutExpired:
            return "killed"
    if done.returncode in (FAILED, INTERRUPTED):  # interrupted: the module no longer imports
        return "killed"
    return "survived" if done.returncode == PASSED else f"not run: {done.stdout.decode()[-300:]}"


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=40, help="number of mutants")
    parser.add_argument("--seed", type=int, default=int(f"{datetime.now(UTC):%Y%m%d}"), help="today's date if omitted")
    parser.add_argument("--only", default="bodysense", help="beginning of the modules' names")
    arguments = parser.parse_args()
    killed = 0
    for number, one in enumerate(draw(arguments.count, random.Random(arguments.seed), arguments.only), 1):
        result = outcome(one)
        killed += result == "killed"
        print(f"{number:3} {result:9} {one.module}:{one.line} {one.old!r} → {one.new!r}", flush=True)
    print(f"{killed} of {arguments.count} killed ({killed / arguments.count:.0%}), seed {arguments.seed}")
    sys.exit(killed < SHARE * arguments.count)


if __name__ == "__main__":
    main()
