"""Compile the C libraries into the package, for work from a clone: python scripts/build_core.py

`_core` is the core, `_fbx` the reader of FBX files; the latter is compiled only if its sources are newer. The build
of wheels and editable installs compiles both (hatch_build.py). The compiler is $CC, else the system's, else the one
that the package `ziglang` brings.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ENDINGS = {"win32": ".dll", "darwin": ".dylib"}  # of shared libraries, by `sys.platform`; else .so
SOURCES = {"_core": ("core/src/*/*.c",), "_fbx": ("core/fbx/*.c", "core/vendor/ufbx/*.c")}
_HEADERS = {"_core": ("core/src/*.h", "core/src/*/*.h"), "_fbx": ("core/vendor/ufbx/*.h",)}
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


def library_path(name: str) -> Path:
    """Return the path of a library in the package: '_core' or '_fbx'."""
    return ROOT / "src" / "bodysense" / f"{name}{ENDINGS.get(sys.platform, '.so')}"


def build(
    library: Path | None = None, command: list[str] | None = None, name: str = "_core", more: Sequence[Path] = ()
) -> Path:
    """Compile a shared library of `SOURCES` and `more`, in the package's folder if `library` is None."""
    library = library_path(name) if library is None else library
    sources = [str(path) for pattern in SOURCES[name] for path in sorted(ROOT.glob(pattern))]
    sources += [f"-I{ROOT / 'core' / 'include'}", *map(str, more)]
    beside = library.with_name(f"{library.name}.part")  # replaces a library that may be in use
    # With hidden symbols, a .dll exports nothing.
    system = [] if library.suffix == ".dll" else ["-fPIC", "-fvisibility=hidden", "-lm"]
    flags = _FLAGS if name == "_core" else tuple("-O2" if flag == "-O3" else flag for flag in _FLAGS)
    subprocess.run([*(command or compiler()), *flags, *sources, "-o", str(beside), *system], check=True)
    os.replace(beside, library)
    return library


def is_current(name: str) -> bool:
    """Whether a library in the package is newer than its sources."""
    library = library_path(name)
    files = [path for pattern in (*SOURCES[name], *_HEADERS[name]) for path in ROOT.glob(pattern)]
    return library.exists() and library.stat().st_mtime > max(path.stat().st_mtime for path in files)


def build_program(source: Path, program: Path) -> Path:
    """Compile a program of core/bench with core/src."""
    flags = [flag for flag in _FLAGS if flag != "-shared"]
    sources = [source, *sorted((ROOT / "core" / "src").glob("*/*.c"))]
    command = [*compiler(), *flags, f"-I{ROOT / 'core' / 'include'}", *map(str, sources), "-o", str(program), "-lm"]
    subprocess.run(command, check=True)
    return program


if __name__ == "__main__":
    print(f"wrote {build()}")
    if not is_current("_fbx"):
        print(f"wrote {build(name='_fbx')}")
