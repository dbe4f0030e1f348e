"""Time the README's first commands on a machine with only Python, from nothing to a moving body.

    python scripts/figures/first_body.py [--json FIGURES/first-body.json] [--without-compiler]

Clones the last commit into a temporary folder and runs the README's first sh block there, in an environment of its
own, twice: with an empty cache of pip, then without a network, from packages that were fetched between the two. The
difference is the network's share of the installation. The clone is of this machine: the network's share of a real one
is that of `clone_mb`. With the package `uv`, the README's line of uvx is timed, too, with an empty cache.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from bodysense.cli.show import write_numbers

ROOT = Path(__file__).resolve().parents[2]
MADE = ("bodysense-demo/result.bvh", "bodysense-demo/demo.webp")  # a moving body, as a file and as pictures
_OWN = ("PYTHONPATH", "VIRTUAL_ENV", "PIP_CONSTRAINT", "CC")  # variables that new users do not have


@dataclass(frozen=True)
class Step:
    """A command, its duration and its processor time."""

    command: str
    seconds: float
    processor: float  # s
    part: str  # clone, install or demo


def first_commands(readme: str) -> list[str]:
    """Return the lines of the first sh block, without those that fetch the repository."""
    block = re.search(r"^```sh\n(.*?)^```", readme, re.MULTILINE | re.DOTALL)
    if block is None:
        raise ValueError("README.md: no sh block")
    return [line for line in block[1].splitlines() if line.strip() and not line.startswith(("git clone", "cd "))]


def uvx_command(readme: str) -> str:
    """Return the README's line of uvx."""
    found = re.search(r"^uvx .*$", readme, re.MULTILINE)
    if found is None:
        raise ValueError("README.md: no line of uvx")
    return found[0]


def run(command: list[str] | str, folder: Path, environment: dict[str, str]) -> tuple[float, float]:
    """Run a command, a shell's if it is a text, and return the seconds that it took and that it computed.

    Ends the program if it fails.
    """
    begun, before = time.monotonic(), os.times()
    done = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        shell=isinstance(command, str),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise SystemExit(f"{command}: {(done.stderr or done.stdout)[-2000:]}")
    seconds, after = time.monotonic() - begun, os.times()
    before_s, after_s = (times.children_user + times.children_system for times in (before, after))
    return seconds, after_s - before_s


def newcomer(folder: Path, environment: dict[str, str], has_compiler: bool) -> list[Step]:
    """Clone into `folder` and run the README's first block there."""
    clone, venv = folder / "bodysense", folder / "venv"
    cloning = ["git", "clone", "--quiet", "--depth", "1", f"file://{ROOT}", str(clone)]
    steps = [Step("git clone", *run(cloning, folder, environment), "clone")]
    steps.append(
        Step("python -m venv", *run([sys.executable, "-m", "venv", str(venv)], folder, environment), "install")
    )
    path = [str(venv / "bin"), *([environment["PATH"]] if has_compiler else [])]
    inside = environment | {"PATH": os.pathsep.join(path)}
    for line in first_commands((clone / "README.md").read_text(encoding="utf-8")):
        steps.append(Step(line, *run(line, clone, inside), "install" if line.startswith("pip ") else "demo"))
    missing = [name for name in MADE if not (clone / name).is_file()]
    if missing:
        raise SystemExit(f"{missing[0]} was not written by the README's first block")
    return steps


def fetch(clone: Path, wheels: Path, environment: dict[str, str], has_compiler: bool) -> None:
    """Download all packages that the installation and its build need into a folder."""
    build = tomllib.loads((clone / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    packages = [*build, *([] if has_compiler else ["ziglang>=0.14"]), "."]
    pip = [sys.executable, "-m", "pip", "download", "-q", "-d", str(wheels), "-c", "constraints.txt", *packages]
    run(pip, clone, environment)
    for own in wheels.glob("bodysense-*"):
        own.unlink()


def numbers_of(cold: list[Step], offline: list[Step]) -> dict[str, float]:
    """Return seconds by part, with an empty cache and without a network, and the network's share."""
    found: dict[str, float] = {}
    for name, steps in (("cold", cold), ("offline", offline)):
        for part in ("clone", "install", "demo"):
            found[f"{name}_{part}_s"] = sum(step.seconds for step in steps if step.part == part)
        found[f"{name}_s"] = sum(step.seconds for step in steps)
        found[f"{name}_processor_s"] = sum(step.processor for step in steps)
    found["network_s"] = max(found["cold_install_s"] - found["offline_install_s"], 0.0)
    return found


def size_mb(folder: Path) -> float:
    """Return the MB of all files in a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def measure(has_compiler: bool) -> tuple[list[Step], list[Step], dict[str, float]]:
    """Run the README's first block twice: steps with an empty cache, steps without a network, and the numbers."""
    environment = {name: value for name, value in os.environ.items() if name not in _OWN}
    with tempfile.TemporaryDirectory() as folder:
        first, second, wheels = Path(folder) / "first", Path(folder) / "second", Path(folder) / "wheels"
        first.mkdir()
        second.mkdir()
        environment["PIP_CACHE_DIR"] = str(Path(folder) / "cache")
        cold = newcomer(first, environment, has_compiler)
        fetch(first / "bodysense", wheels, environment, has_compiler)
        sizes = {"clone_mb": size_mb(first / "bodysense" / ".git"), "packages_mb": size_mb(wheels)}
        shutil.rmtree(first)
        alone = environment | {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(wheels), "PIP_CACHE_DIR": f"{folder}/none"}
        offline = newcomer(second, alone, has_compiler)
        numbers = numbers_of(cold, offline) | sizes
        if find_spec("uv") is not None:
            numbers["uvx_s"] = by_uvx(Path(folder) / "uvx", environment)
    return cold, offline, numbers


def by_uvx(folder: Path, environment: dict[str, str]) -> float:
    """Return the seconds of the README's line of uvx, with an empty cache."""
    folder.mkdir()
    line = uvx_command((ROOT / "README.md").read_text(encoding="utf-8")).replace("uvx", "-m uv tool run", 1)
    places = {"UV_CACHE_DIR": "cache", "UV_TOOL_DIR": "tools"}
    inside = environment | {name: str(folder / place) for name, place in places.items()}
    seconds, _ = run(f"{shlex.quote(sys.executable)} {line}", folder, inside | {"REPOSITORY": f"file://{ROOT}"})
    if not all((folder / name).is_file() for name in MADE):
        raise SystemExit(f"{line}: {MADE[0]} was not written")
    return seconds


def main() -> None:
    """Measure the commands, and print and write the numbers."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", type=Path, help="file to write the numbers into, as one flat object")
    parser.add_argument("--without-compiler", action="store_true", help="hide the system's C compiler from pip")
    arguments = parser.parse_args()
    cold, offline, numbers = measure(not arguments.without_compiler)
    print(f"{'seconds':42} empty cache  no network")
    for one, other in zip(cold, offline, strict=True):
        print(f"{one.command:42} {one.seconds:11.1f} {other.seconds:11.1f}")
    print(f"{'from git clone to a moving body':42} {numbers['cold_s']:11.1f} {numbers['offline_s']:11.1f}")
    if "uvx_s" in numbers:
        print(f"{'from uvx to a moving body':42} {numbers['uvx_s']:11.1f}")
    print(f"{'of which install':42} {numbers['cold_install_s']:11.1f} {numbers['offline_install_s']:11.1f}")
    computed = f"{numbers['cold_processor_s']:11.1f} {numbers['offline_processor_s']:11.1f}"
    print(f"{'time of a processor':42} {computed}")
    print(f"network: {numbers['network_s']:.1f} s for {numbers['packages_mb']:.0f} MB of packages; ", end="")
    print(f"the clone has {numbers['clone_mb']:.0f} MB")
    write_numbers(arguments.json, numbers | {"without_compiler": float(arguments.without_compiler)})


if __name__ == "__main__":
    main()
