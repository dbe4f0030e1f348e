"""Compile the C core to WebAssembly, for the npm package: python scripts/build_wasm.py

The compiler is $CC if that is set, else the one that the package `ziglang` brings (`pip install ziglang`). The file is
committed, so that the npm package and its tests need no compiler. It imports nothing; JavaScript grows its memory.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUTPUT = ROOT / "web" / "core" / "core.wasm"
_STACK = 2**20  # bytes
_FLAGS = (
    "--target=wasm32-wasi",
    "-mexec-model=reactor",
    "-msimd128",
    "-std=c11",
    "-O3",
    "-DNDEBUG",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fvisibility=hidden",
    "-Wl,--no-entry",
    "-Wl,--strip-all",
    f"-Wl,-z,stack-size={_STACK}",
)


def compiler() -> list[str]:
    """Return the command of a C compiler for WebAssembly. Ends the program if it is missing."""
    if os.environ.get("CC"):
        return shlex.split(os.environ["CC"])
    if find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    raise SystemExit("no C compiler for WebAssembly: `pip install ziglang`, or name a clang with wasi-libc in CC")


def interface() -> list[str]:
    """Return the names of the header's functions."""
    header = (ROOT / "core" / "include" / "bodysense.h").read_text(encoding="utf-8")
    code = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    return sorted(set(re.findall(r"\b(bs_\w+)\(", code)))


def build(output: Path = OUTPUT, command: list[str] | None = None) -> Path:
    """Compile core/src into a WebAssembly module that exports its memory and the header's functions."""
    sources = sorted(str(path) for path in (ROOT / "core" / "src").glob("*/*.c"))
    exported = [f"-Wl,--export={name}" for name in interface()]
    unfinished = output.with_name(f"{output.name}.part")
    subprocess.run([*(command or compiler()), *_FLAGS, *exported, *sources, "-o", str(unfinished)], check=True)
    unfinished.chmod(0o644)
    os.replace(unfinished, output)
    return output


if __name__ == "__main__":
    print(f"wrote {build()}, {OUTPUT.stat().st_size} bytes")
