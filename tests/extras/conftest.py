"""The packages of ecosystems, built once for the system of this machine."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import build_packages
import build_wheels
import pytest


@pytest.fixture(scope="session")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that `scripts/build_packages.py` writes."""
    if find_spec("ziglang") is None:
        pytest.skip("needs a compiler for all systems: pip install ziglang")
    out, work = tmp_path_factory.mktemp("packages"), tmp_path_factory.mktemp("work")
    here = [target for target in build_wheels.TARGETS if target.is_here]
    for build in build_packages.BUILDERS.values():
        build(here, out, work)
    return out
