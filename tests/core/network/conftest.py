"""The core's networks, compiled once."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from filelock import FileLock

from .library import FLAGS, SOURCES, compiled


@pytest.fixture(scope="session")
def networks_file(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shared library, which all processes and later runs share until a source or a flag changes."""
    kept = getattr(request.config, "cache", None)  # none with `-p no:cacheprovider`
    build = tmp_path_factory.mktemp("core") if kept is None else kept.mkdir("core")
    sources = sorted(path for kind in ("h", "c") for path in SOURCES.rglob(f"*.{kind}"))
    digest = hashlib.sha256(repr([FLAGS, *(path.read_bytes() for path in sources)]).encode()).hexdigest()
    file = build / digest[:16] / "networks.so"
    with FileLock(build / "networks.lock"):
        if not file.is_file():
            file.parent.mkdir(exist_ok=True)
            compiled(file.parent)
    return file
