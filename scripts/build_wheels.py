"""Build wheels for Linux, macOS and Windows on this machine: python scripts/build_wheels.py --out dist

Needs the packages `build` and `ziglang`, which brings the compiler for all of them. With --library FOLDER it writes
libraries for engines in C instead, a folder each, with the header. Only what this machine can load is tried.
"""

from __future__ import annotations

import argparse
import base64
import ctypes
import hashlib
import runpy
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

ROOT = Path(__file__).resolve().parents[1]
LIBRARIES = ("_core", "_fbx")  # in a wheel; engines get the core alone
ZIG = [sys.executable, "-m", "ziglang", "cc"]


@dataclass(frozen=True)
class Target:
    """A target system and processor."""

    name: str
    zig: str  # zig's name, with the oldest supported C library or system
    tag: str  # a wheel's platform tag
    ending: str  # of shared libraries

    @property
    def is_here(self) -> bool:
        """Whether this machine can load its libraries."""
        system, _, processor = self.name.partition("-")
        return sys.platform.startswith({"windows": "win32", "macos": "darwin"}.get(system, system)) and (
            sysconfig.get_platform().replace("aarch64", "arm64").replace("amd64", "x86_64").endswith(processor)
        )


TARGETS = (
    Target("linux-x86_64", "x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64.manylinux2014_x86_64", ".so"),
    Target("linux-arm64", "aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64.manylinux2014_aarch64", ".so"),
    Target("macos-x86_64", "x86_64-macos.11.0", "macosx_11_0_x86_64", ".dylib"),
    Target("macos-arm64", "aarch64-macos.11.0", "macosx_11_0_arm64", ".dylib"),
    Target("windows-x86_64", "x86_64-windows-gnu", "win_amd64", ".dll"),
)


def build_library(target: Target, path: Path, name: str = "_core", more: Sequence[Path] = ()) -> Path:
    """Compile a library of `LIBRARIES` for a target, with `more` sources."""
    command = [*ZIG, "-target", target.zig, "-mcpu=baseline", "-Wl,-s"]
    path = path.with_suffix(target.ending)
    return runpy.run_path(str(ROOT / "scripts" / "build_core.py"))["build"](path, command, name, more)


def require_zig() -> None:
    """End the program with an install line if there is no compiler for other systems."""
    if find_spec("ziglang") is None:
        raise SystemExit("no compiler for other systems: pip install ziglang")


def build_wheel(native: Path, libraries: Mapping[str, Path], target: Target, folder: Path) -> Path:
    """Write a wheel like that of this machine, with other libraries, by name, and another tag."""
    name = native.name.split("-")
    out = folder / f"{name[0]}-{name[1]}-py3-none-{target.tag}.whl"
    rows = []
    with ZipFile(out, "w", ZIP_DEFLATED) as wheel:
        for path, content in _contents(native, libraries, target):
            info = ZipInfo(path, (2020, 1, 1, 0, 0, 0))
            info.external_attr = (0o755 if _is_library(path) else 0o644) << 16
            wheel.writestr(info, content, ZIP_DEFLATED)
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
            rows.append(f"{path},sha256={digest},{len(content)}")
        record = f"{name[0]}-{name[1]}.dist-info/RECORD"
        wheel.writestr(ZipInfo(record, (2020, 1, 1, 0, 0, 0)), "\n".join([*rows, f"{record},,", ""]))
    return out


def _is_library(path: str) -> bool:
    return path.rpartition(".")[0] in [f"bodysense/{name}" for name in LIBRARIES]


def _contents(native: Path, libraries: Mapping[str, Path], target: Target) -> Iterator[tuple[str, bytes]]:
    """Return paths and contents of a target's wheel, without the record."""
    with ZipFile(native) as wheel:
        for path in wheel.namelist():
            content = wheel.read(path)
            if _is_library(path) or path.endswith(".dist-info/RECORD"):
                continue
            if path.endswith(".dist-info/WHEEL"):
                lines = [line for line in content.decode().splitlines() if line and not line.startswith("Tag:")]
                lines += [f"Tag: py3-none-{tag}" for tag in target.tag.split(".")]
                content = ("\n".join(lines) + "\n").encode()
            yield path, content
    for name, library in libraries.items():
        yield f"bodysense/{name}{target.ending}", library.read_bytes()


def native_wheel(folder: Path) -> Path:
    """Build the wheel of this machine by `python -m build` and return it."""
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return next(folder.glob("*.whl"))


def _described(path: Path, library: Path, target: Target) -> str:
    """Return a line about a built file, and whether its library was loaded."""
    size = f"{path.name}: {path.stat().st_size / 1e6:.2f} MB, its library {library.stat().st_size / 1e3:.0f} kB"
    if not target.is_here:
        return f"{size}; built, not run"
    return f"{size}; built and loaded, version {ctypes.CDLL(str(library)).bs_version()}"


def main() -> None:
    """Build the wheels, or the libraries for engines."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the wheels")
    parser.add_argument("--library", type=Path, help="folder of libraries for engines, which are built instead")
    names = [target.name for target in TARGETS]
    parser.add_argument("--targets", nargs="+", choices=names, default=names, help="systems to build for")
    given = parser.parse_args()
    require_zig()
    with TemporaryDirectory(prefix="bodysense-") as temporary:
        folder = Path(temporary)
        native = None if given.library else native_wheel(folder)
        for target in TARGETS:
            if target.name not in given.targets:
                continue
            library = build_library(target, folder / target.name)
            if native is None:
                place = given.library / target.name
                place.mkdir(parents=True, exist_ok=True)
                named = "bodysense.dll" if target.ending == ".dll" else f"libbodysense{target.ending}"
                shutil.copy(ROOT / "core" / "include" / "bodysense.h", place)
                made = Path(shutil.copy(library, place / named))
            else:
                given.out.mkdir(parents=True, exist_ok=True)
                fbx = build_library(target, folder / f"{target.name}-fbx", "_fbx")
                made = build_wheel(native, {"_core": library, "_fbx": fbx}, target, given.out)
            print(f"{target.name}: {_described(made, library, target)}", flush=True)


if __name__ == "__main__":
    main()
