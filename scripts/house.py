"""Print the size and the shape of the sources next to their budgets.

    python scripts/house.py

Lines are counted as `wc -l` does, of tracked files. All imports count, inside functions, too, except for types alone.
"""

from __future__ import annotations

import ast
import re
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import words
from import_graph import MODULES, circles, closure, parsed

ROOT = Path(__file__).resolve().parents[1]
TRAININGS = ("completion", "papers.hmd_vae", "papers.pahmt", "papers.unoc")
CODE = {".py", ".c", ".h", ".ts", ".tsx", ".mjs", ".js"}
BUDGETS: dict[str, tuple[str, int]] = {  # files by a pattern, and the most lines
    "library and packages, Python": (r"(src|packages)/.*\.py", 64_000),
    "core, C and its tests": (r"core/.*\.[ch]", 5_500),
    "web": (r"web/(src|core/src|core/test|build)/?.*\.(ts|tsx|mjs|js|css|html)", 7_800),
    "extras": (r"extras/.*\.(py|cs|cpp|hpp|h|js|toml|yaml|cfg)", 2_200),
    "scripts": (r"scripts/.*\.(py|mjs)", 2_600),
    "tests, Python and web": (r"(tests/.*\.(py|hpp|cs)|web/tests/.*\.(ts|mjs|js))", 48_000),
}
MOST_IN_A_FOLDER = 15
SHORT = 6  # lines of a private function that might be in the place of its only call


def tracked() -> list[str]:
    """Return the paths of tracked files that exist, without the built page and generated or foreign code."""
    names = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    others = ("/bodysense_live/page/", "core/vendor/", "_generated.py")
    return [name for name in names if (ROOT / name).is_file() and not any(part in name for part in others)]


def lines(name: str) -> int:
    """Return the number of lines of a file."""
    return (ROOT / name).read_bytes().count(b"\n")


def full_folders(names: list[str]) -> dict[str, int]:
    """Return the folders with more code files than allowed; files of titles alone do not count."""
    code = [Path(name) for name in names if Path(name).suffix in CODE and Path(name).name != "__init__.py"]
    counts = Counter(str(path.parent) for path in code)
    return {folder: count for folder, count in counts.items() if count > MOST_IN_A_FOLDER}


def short_helpers() -> int:
    """Return the number of private functions of at most `SHORT` lines that one place uses."""
    count = 0
    for module in MODULES:
        tree = parsed(module)
        used = Counter(
            node.id if isinstance(node, ast.Name) else node.attr
            for node in ast.walk(tree)
            if isinstance(node, (ast.Name, ast.Attribute))
        )
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("_") and not node.name.startswith("__"):
                size = (node.end_lineno or node.lineno) - node.lineno + 1
                count += size <= SHORT and used[node.name] == 1 and not node.decorator_list
    return count


def scattered_constants(names: list[str]) -> int:
    """Return the number of tuned numbers of the core that are not in constants.h.

    They are numbers with a point that have a name. Whole numbers are sizes, versions and bits; numbers such as 1e-6
    guard divisions; base/maths.h has mathematical constants.
    """
    number = re.compile(r"^ *(?:#define [A-Z_0-9]+ \(?|static const (?:float|double) .*\b[A-Z_0-9]+ = )-?\d*\.\d", re.M)
    others = ("core/src/constants.h", "core/src/base/maths.h")
    sources = [name for name in names if re.match(r"core/(src|include)/.*\.[ch]$", name) and name not in others]
    return sum(len(number.findall((ROOT / name).read_text(encoding="utf-8"))) for name in sources)


def rows() -> Iterator[tuple[str, int, int]]:
    """Yield names, figures and limits."""
    names = tracked()
    for title, (pattern, most) in BUDGETS.items():
        yield title, sum(lines(name) for name in names if re.fullmatch(pattern, name)), most
    yield f"folders with more than {MOST_IN_A_FOLDER} code files", len(full_folders(names)), 0
    yield "imports in circles", len(circles()), 0
    for name in TRAININGS:
        yield f"files that {name}.train imports", len(closure(f"bodysense_lab.{name}.train")), 60
    yield f"private functions of at most {SHORT} lines with one use", short_helpers(), 80
    yield "numbers of the core outside constants.h", scattered_constants(names), 0
    yield (
        "lines that the word gauge lists",
        sum(len(words.findings(path)) for path in map(ROOT.joinpath, names)),
        15,
    )


def main() -> None:
    """Print the table, and the folders that are too full."""
    for title, figure, most in rows():
        print(f"{'  ' if figure <= most else '! '}{title:62} {figure:>7,} of {most:,}")
    for folder, count in sorted(full_folders(tracked()).items()):
        print(f"    {folder}: {count} files of code")


if __name__ == "__main__":
    main()
