"""Mutation run: break the source in one place at a time, and check that the tests fail.

    python scripts/mutants.py                    # all of scripts/mutants.toml
    python scripts/mutants.py --only live. --jobs 4

Each mutant replaces one text of one file in a copy of the sources. The copy is made of links, so that the working tree
stays unchanged. A mutant is killed if one of its tests fails. The tests must pass without a mutant. The run fails if
fewer than 90 % are killed, or if a text is not in its file exactly once.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = ("src", "packages", "core", "scripts", "hatch_build.py")
SHARE = 0.9  # share of the mutants that must be killed
PASSED, FAILED = 0, 1  # exit statuses of pytest


@dataclass(frozen=True)
class Mutant:
    """One fault: `old` of `file` becomes `new`, and `tests` are expected to fail."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]


def read_mutants(path: Path) -> list[Mutant]:
    """Read the mutants of a .toml file."""
    rows = tomllib.loads(path.read_text(encoding="utf-8"))["mutant"]
    return [Mutant(**{**row, "tests": tuple(row["tests"])}) for row in rows]


def stale(mutant: Mutant) -> bool:
    """Return whether the text is missing or repeated in the file."""
    path = ROOT / mutant.file
    return not path.is_file() or path.read_text(encoding="utf-8").count(mutant.old) != 1


@contextmanager
def sources(mutant: Mutant | None) -> Iterator[Path]:
    """Yield a folder with links to all sources, in which one file has the fault."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        copy = Path(folder)
        for name in SOURCES:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, copy / name, copy_function=os.symlink)
            else:
                (copy / name).symlink_to(ROOT / name)
        if mutant is not None:
            path = copy / mutant.file
            path.unlink()
            path.write_text((ROOT / mutant.file).read_text(encoding="utf-8").replace(mutant.old, mutant.new))
            if mutant.file.startswith("core/"):
                script = copy / "scripts" / "build_core.py"
                script.unlink()  # a link would make it find the working tree
                shutil.copy(ROOT / "scripts" / "build_core.py", script)
                for library in (copy / "src" / "bodysense").glob("_core.*"):
                    library.unlink()
                subprocess.run([sys.executable, script], check=True, capture_output=True)
        yield copy


def run_tests(tests: Sequence[str], copy: Path) -> tuple[int, str]:
    """Run tests against the sources of a folder; return pytest's exit status and its output."""
    folders = [copy / "src", *(copy / "packages" / name / "src" for name in ("live", "conform", "lab"))]
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(map(str, folders)),
        "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1",
    }
    command = [sys.executable, "-m", "pytest", "-n", "0", "-x", "-m", "", "-p", "no:cacheprovider", *tests]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def outcome(mutant: Mutant) -> str:
    """Return 'killed', 'survived', or the output of a run that is neither."""
    with sources(mutant) as copy:
        status, output = run_tests(mutant.tests, copy)
    return {PASSED: "survived", FAILED: "killed"}.get(status, f"not run: {output[-600:]}")


def main() -> None:
    """Run the mutants and print the result of each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", help="run mutants whose name contains this text")
    parser.add_argument("--jobs", type=int, default=2, help="mutants at a time")
    parser.add_argument("--skip-check", action="store_true", help="do not run the tests without a mutant first")
    arguments = parser.parse_args()
    mutants = [one for one in read_mutants(ROOT / "scripts" / "mutants.toml") if arguments.only in one.name]
    if not mutants:
        sys.exit(f"no mutant is named {arguments.only!r}")
    if old := [one.name for one in mutants if stale(one)]:
        sys.exit(f"{', '.join(old)}: the text is not in its file exactly once; mend scripts/mutants.toml")
    begun = time.monotonic()
    if not arguments.skip_check:
        with sources(None) as copy:
            status, output = run_tests(sorted({test for one in mutants for test in one.tests}), copy)
        if status != PASSED:
            sys.exit(f"the tests do not pass without a mutant:\n{output[-3000:]}")
    killed = 0
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for mutant, result in zip(mutants, pool.map(outcome, mutants), strict=True):
            print(f"{mutant.name:32} {result}", flush=True)
            killed += result == "killed"
    minutes = (time.monotonic() - begun) / 60
    print(f"{killed} of {len(mutants)} killed ({killed / len(mutants):.0%}), {minutes:.1f} minutes")
    sys.exit(killed < SHARE * len(mutants))


if __name__ == "__main__":
    main()
