"""Build the Dockerfile's image where no registry of images is reached, from Debian's packages, and try it.

    apt-get install buildah mmdebstrap
    python scripts/build_image.py

The base image is Debian, of the release of this system, with Python, in place of the public one. Python's packages are
fetched before the build, which has no network then. Needs root. Nothing is left but what `--out` names.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import tomllib
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bodysense.cli.show import write_numbers

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = ("buildah", "mmdebstrap")
LARGEST = 400  # MB, of the image unpacked
_PYTHON = "/usr/bin/python3"  # the base image's, and the one that chooses packages
_BASE = "python3,python3-venv,python3-pip,python-is-python3"
_LEFT_OUT = ("/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*")  # as in the public image
_START = 60.0  # s in which a server must answer
_PACKAGES = ("ziglang>=0.14", ".", "./packages/live[shared]")


@dataclass(frozen=True)
class Image:
    """A built image in a storage of its own."""

    store: Path
    name: str

    def buildah(self, *words: str | Path) -> list[str]:
        """Return a command of buildah on this storage, without overlays and without namespaces."""
        places = ["--root", str(self.store / "root"), "--runroot", str(self.store / "run"), "--storage-driver", "vfs"]
        return ["buildah", *places, *map(str, words)]

    def container_output(self, container: str, *words: str) -> str:
        """Run a program in a container, as the image's user, and return what it printed."""
        return said(self.buildah("run", "--isolation", "chroot", container, "--", *words))

    def inspected(self) -> dict[str, Any]:
        """Return the image's configuration: `User`, `Entrypoint`, `Cmd`, …"""
        return json.loads(said(self.buildah("inspect", "--type", "image", self.name)))["Docker"]["config"]

    @contextmanager
    def container(self) -> Iterator[str]:
        """Yield a container of the image."""
        name = said(self.buildah("from", "--pull-never", self.name))
        try:
            yield name
        finally:
            said(self.buildah("rm", name))

    def size_mb(self) -> float:
        """Return the MB of the image's files, unpacked."""
        with self.container() as container:
            folder = Path(said(self.buildah("mount", container)))
            files = [path.lstat() for path in folder.rglob("*") if not path.is_dir() or path.is_symlink()]
            return sum({file.st_ino: file.st_size for file in files}.values()) / 1e6

    @contextmanager
    def running(self) -> Iterator[tuple[str, str]]:
        """Yield a container in which the image's own command runs, and the address of its server."""
        settings = self.inspected()
        with self.container() as container, socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
            free.close()
            words = [*settings["Entrypoint"], *settings["Cmd"], "--port", str(port)]
            command = self.buildah("run", "--isolation", "chroot", container, "--", *words)
            with subprocess.Popen(command, stdout=subprocess.DEVNULL) as server:
                try:
                    address, until = f"http://127.0.0.1:{port}", time.monotonic() + _START
                    while not is_healthy(address):
                        if server.poll() is not None or time.monotonic() > until:
                            raise SystemExit(f"{' '.join(words)}: no answer of {address}/healthz in the image")
                        time.sleep(0.1)
                    yield container, address
                finally:
                    server.terminate()


def said(command: list[str], folder: Path = ROOT) -> str:
    """Run a command and return what it printed. Ends the program if it fails."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)}: {(done.stderr or done.stdout)[-2000:]}")
    return done.stdout.strip()


def is_healthy(address: str) -> bool:
    """Return whether a server answers its health endpoint."""
    with suppress(OSError), urllib.request.urlopen(f"{address}/healthz", timeout=2) as answer:
        return answer.read().strip() == b"ok"
    return False


def missing() -> str | None:
    """Return what hinders a build on this machine; None if nothing does."""
    if sys.platform != "linux" or os.geteuid() != 0:
        return "root on Linux"
    absent = [name for name in PROGRAMS if shutil.which(name) is None]
    return f"Debian's {' and '.join(absent)}" if absent else None


def fetch(source: Path, wheels: Path) -> None:
    """Put all packages that the Dockerfile installs, and those that build ours, into a folder."""
    build = tomllib.loads((source / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    pip = [sys.executable, "-m", "pip", "--python", _PYTHON, "download", "-q", "-d", str(wheels)]
    said([*pip, "-c", "constraints.txt", *build, *_PACKAGES], source)
    for own in wheels.glob("bodysense*"):
        own.unlink()


def build(folder: Path, source: Path = ROOT) -> Image:
    """Build the image of `source`'s Dockerfile with all files of the build in `folder`."""
    release = platform.freedesktop_os_release()["VERSION_CODENAME"]
    base, wheels, settings = folder / "base", folder / "wheels", folder / "pip.conf"
    base.mkdir()
    options = [f"--include={_BASE}", *(f"--dpkgopt=path-exclude={place}" for place in _LEFT_OUT)]
    said(["mmdebstrap", "--variant=minbase", *options, release, str(base / "base.tar")])
    (base / "Dockerfile").write_text("FROM scratch\nADD base.tar /\n")
    fetch(source, wheels)
    settings.write_text("[global]\nno-index = true\nfind-links = /wheels\n")
    image = Image(folder, "localhost/bodysense")
    building = ("build", "--isolation", "chroot", "--format", "docker", "--pull-never")
    said(image.buildah(*building, "--tag", "localhost/base", base))
    mounts = [
        word for place in (f"{wheels}:/wheels:ro", f"{settings}:/etc/pip.conf:ro") for word in ("--volume", place)
    ]
    said(image.buildah(*building, *mounts, "--build-arg", "BASE=localhost/base", "--tag", image.name, source))
    return image


def main() -> None:
    """Build, measure and try."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, help="file to write the image into, for `docker load` or `podman load`")
    parser.add_argument("--json", type=Path, help="file to write the size into")
    arguments = parser.parse_args()
    hindrance = missing()
    if hindrance is not None:
        raise SystemExit(f"this needs {hindrance}")
    with tempfile.TemporaryDirectory() as folder:
        image = build(Path(folder))
        size = image.size_mb()
        with image.running() as (container, address):
            user = image.container_output(container, "id", "-u")
            print(f"the image has {size:.0f} MB; as user {user} its server answers at {address}/healthz")
        write_numbers(arguments.json, {"image_mb": size})
        if arguments.out is not None:
            said(image.buildah("push", image.name, f"docker-archive:{arguments.out.resolve()}:bodysense:latest"))
            print(f"wrote {arguments.out}")
    if size > LARGEST:
        raise SystemExit(f"the image has {size:.0f} MB; {LARGEST} are allowed")


if __name__ == "__main__":
    main()
