"""Installing from a repository's address, and by the steps of a container, each on its own and then run."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import build_image
import pytest

ROOT = Path(__file__).parents[2]
BASE = 130  # MB, of python:3.11-slim unpacked
LARGEST = 400  # MB, of the image
ENVIRONMENT = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}

pytestmark = pytest.mark.slow


def files() -> list[str]:
    """Files of the repository, including uncommitted ones."""
    command = ["git", "-C", str(ROOT), "ls-files", "-co", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, text=True, check=False).stdout.splitlines()
    if not listed:
        pytest.skip("needs a clone of the repository")
    return [name for name in listed if (ROOT / name).is_file()]


def copied(names: list[str], folder: Path) -> Path:
    for name in names:
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, place)
    return folder


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Git address of the working tree."""
    folder = copied(files(), tmp_path_factory.mktemp("repository"))
    who = ["-c", "user.name=test", "-c", "user.email=test@example.org"]
    for command in (["init", "-q"], ["add", "-A"], [*who, "commit", "-q", "-m", "test"]):
        subprocess.run(["git", "-C", str(folder), *command], check=True)
    return f"file://{folder}"


def documented_command(page: str, first: str) -> list[str]:
    """Return the words of the command on a page that begins with `first`."""
    line = next(line for line in (ROOT / page).read_text().splitlines() if line.startswith(first))
    return shlex.split(line.partition(" #")[0])


# Programs that run a command from an address, with the pages whose line begins so.
ONE_COMMAND = {"uvx --from": ("README.md", "docs/deploy.md"), "pipx run": ("docs/deploy.md",)}


@pytest.mark.parametrize("first", ONE_COMMAND)
def test_a_demo_from_the_address_of_a_repository(repository: str, tmp_path: Path, first: str) -> None:
    """Pages with the same command are one case."""
    program = first[:2] if first.startswith("uv") else "pipx"
    pytest.importorskip(program, reason=f"needs {program}, of the extra deploy")
    (documented,) = {tuple(documented_command(page, first)) for page in ONE_COMMAND[first]}
    words = [word.replace("$REPOSITORY", repository) for word in documented]
    start = ["uv", "tool", "run"] if program == "uv" else ["pipx"]
    run = [sys.executable, "-m", *start, *words[1:], "-o", str(tmp_path / "demo")]
    places = {"UV_CACHE_DIR": "uv", "UV_TOOL_DIR": "tools", "PIPX_HOME": "pipx"}
    folders = {name: str(tmp_path / folder) for name, folder in places.items()}
    subprocess.run(run, env=ENVIRONMENT | folders, check=True, cwd=tmp_path)
    assert (tmp_path / "demo" / "result.bvh").stat().st_size > 10_000


def test_the_readme_begins_with_uvx_and_then_a_shallow_clone(repository: str, tmp_path: Path) -> None:
    blocks = re.findall(r"^```(?:sh)?\n(.*?)^```", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    commands = "".join(blocks).splitlines()
    assert commands[0].startswith("uvx --from git+$REPOSITORY")
    assert commands[1].startswith("git clone --depth 1 $REPOSITORY")
    words = [word.replace("$REPOSITORY", repository) for word in shlex.split(commands[1])]
    subprocess.run(words, check=True, cwd=tmp_path)
    assert (tmp_path / words[-1] / "constraints.txt").is_file()


@contextmanager
def served(command: list[str], **options: Any) -> Iterator[str]:
    """Start a server on a free port and return its address."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with subprocess.Popen([*command, "--port", str(port)], **options) as server:
        try:
            address, until = f"http://127.0.0.1:{port}", time.monotonic() + 60
            while True:
                with suppress(OSError), urllib.request.urlopen(f"{address}/healthz", timeout=2):
                    break
                assert server.poll() is None and time.monotonic() < until
                time.sleep(0.1)
            yield address
        finally:
            server.terminate()


def has_page_and_network(address: str) -> None:
    with urllib.request.urlopen(f"{address}/", timeout=10) as page:
        assert b"<html" in page.read().lower()
    with urllib.request.urlopen(f"{address}/completion.safetensors.gz", timeout=60) as network:
        assert len(network.read()) > 1_000_000


def kept(name: str, rules: list[str]) -> bool:
    """Whether .dockerignore lets a file into the build."""
    found = True
    for rule in rules:
        pattern = rule.lstrip("!").removeprefix("**/")
        if any(fnmatch(part, pattern) for part in (name, *map(str, Path(name).parents), Path(name).name)):
            found = rule.startswith("!")
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="the steps are of Linux")
def test_the_steps_of_the_dockerfile_make_a_server(tmp_path: Path) -> None:
    """Run in a folder in place of a container: what is copied, its RUN step, its size, and its command."""
    text = (ROOT / "Dockerfile").read_text()
    rules = [line for line in (ROOT / ".dockerignore").read_text().splitlines() if line and line[0] != "#"]
    source = copied([name for name in files() if kept(name, rules)], tmp_path / "src")
    build = text.split("\nFROM")[0] + "\nFROM" + text.split("\nFROM")[1]
    (step,) = re.findall(r"^RUN ((?:.*\\\n)*.*)$", build, re.MULTILINE)
    venv, tool = tmp_path / "venv", tmp_path / "pip"
    subprocess.run([sys.executable, "-m", "venv", tool], check=True, env=ENVIRONMENT)  # the image's own Python
    step = step.replace("/src", str(source)).replace("/venv", str(venv)).replace("--no-cache-dir ", "")
    inside = ENVIRONMENT | {"PATH": f"{tool / 'bin'}:/usr/bin:/bin"}
    subprocess.run(["sh", "-eu", "-c", step], check=True, env=inside)
    size = sum(path.stat().st_size for path in venv.rglob("*") if path.is_file() and not path.is_symlink()) / 1e6
    print(f"the image: {BASE} + {size:.0f} MB")
    assert BASE + size <= LARGEST
    installed = {path.name for path in venv.glob("lib/python*/site-packages/*")}
    assert "bodysense_live" in installed and installed.isdisjoint({"ziglang", "torch", "pip", "pytest"})
    server = [str(venv / "bin" / "bodysense"), "serve"]
    nobody: dict[str, Any] = {"user": 10001, "group": 10001, "extra_groups": []}
    for folder in (tmp_path, *tmp_path.parents[:2]):  # pytest's, which are closed to others
        folder.chmod(0o755)
    try:
        subprocess.run([*server, "--help"], check=True, stdout=subprocess.DEVNULL, **nobody)
    except OSError:  # not as root, or a Python that others may not read
        nobody = {}
    with served(server, cwd="/", env={"HOME": "/nonexistent"}, **nobody) as address:
        has_page_and_network(address)


def test_the_dockerfile_makes_an_image_that_serves(tmp_path: Path) -> None:
    """Built on a Debian base in place of the public one, and run as its own user."""
    hindrance = build_image.missing()
    if hindrance is not None:
        pytest.skip(f"needs {hindrance}")
    rules = [line for line in (ROOT / ".dockerignore").read_text().splitlines() if line and line[0] != "#"]
    source = copied([*(name for name in files() if kept(name, rules)), "Dockerfile", ".dockerignore"], tmp_path / "src")
    image = build_image.build(tmp_path, source)
    size = image.size_mb()
    print(f"the image: {size:.0f} MB")
    assert size <= LARGEST
    health = [str(word) for word in image.inspected()["Healthcheck"]["Test"][1:]]
    with image.running() as (container, address):
        has_page_and_network(address)
        assert image.container_output(container, "id", "-u") == "10001"
        port = address.rpartition(":")[2]
        image.container_output(container, *(word.replace(":8765", f":{port}") for word in health))
