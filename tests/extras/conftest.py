"""The packages of ecosystems, built once for the system of this machine."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path

import build_packages
import build_wheels
import pytest
from filelock import FileLock


@pytest.fixture(scope="session")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that `scripts/build_packages.py` writes, once for all processes of the tests."""
    if find_spec("ziglang") is None:
        pytest.skip("needs a compiler for all systems: pip install ziglang")
    own = tmp_path_factory.getbasetemp()
    folder = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
    out, made = folder / "ecosystems", tmp_path_factory.mktemp("packages")
    with FileLock(f"{out}.lock"):
        if not out.is_dir():
            here = [target for target in build_wheels.TARGETS if target.is_here]
            for build in build_packages.BUILDERS.values():
                build(here, made, tmp_path_factory.mktemp("work"))
            made.rename(out)
    return out
