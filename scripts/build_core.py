"""Compile the C core into the package, for work from a clone: python scripts/build_core.py

The build of wheels and editable installs does the same (hatch_build.py). The compiler is $CC, else the system's, else
the one that the package `ziglang` brings.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIBRARIES = {"win32": "_core.dll", "darwin": "_core.dylib"}  # by `sys.platform`; else _core.so
_FLAGS = (
    "-std=c11",
    "-O3",
    "-DNDEBUG",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-shared",
)


def system_compiler() -> list[str] | None:
    """Return the command of the system's C compiler; None without one."""
    if os.environ.get("CC"):
        return shlex.split(os.environ["CC"])
    found = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
    return None if found is None else [found]


def compiler() -> list[str]:
    """Return the command of a C compiler. Ends the program without one."""
    found = system_compiler()
    if found is None and find_spec("ziglang") is not None:
        found = [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"]
    if found is None:
        raise SystemExit("no C compiler: install gcc or clang, name one in CC, or `pip install ziglang`")
    return found


def build(library: Path | None = None, command: list[str] | None = None) -> Path:
    """Compile core/src into a shared library, in the package's folder if `library` is None."""
    if library is None:
        library = ROOT / "src" / "bodysense" / LIBRARIES.get(sys.platform, "_core.so")
    sources = sorted(str(path) for path in (ROOT / "core" / "src").glob("*.c"))
    beside = library.with_name(f"{library.name}.part")  # replaces a library that may be in use
    # With hidden symbols, a .dll exports nothing.
    system = [] if library.suffix == ".dll" else ["-fPIC", "-fvisibility=hidden", "-lm"]
    subprocess.run([*(command or compiler()), *_FLAGS, *sources, "-o", str(beside), *system], check=True)
    os.replace(beside, library)
    return library


def build_program(source: Path, program: Path) -> Path:
    """Compile a program of core/bench with core/src."""
    flags = [flag for flag in _FLAGS if flag != "-shared"]
    sources = [source, *sorted((ROOT / "core" / "src").glob("*.c"))]
    command = [*compiler(), *flags, f"-I{ROOT / 'core' / 'include'}", *map(str, sources), "-o", str(program), "-lm"]
    subprocess.run(command, check=True)
    return program


if __name__ == "__main__":
    print(f"wrote {build()}")
