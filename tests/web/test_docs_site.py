"""The pages of the built docs by axe-core, light and dark."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
# The first page, code with all colours, long tables, pictures, and a page with options.
PAGES = ("", "api/", "completion/", "gallery/", "command-line/")


@pytest.mark.slow
@pytest.mark.alone
def test_axe_finds_nothing_on_the_docs_light_and_dark(scenario: Callable[..., dict[str, Any]], tmp_path: Path) -> None:
    """Contrast, names of parts, keyboard: by all rules of axe-core."""
    pytest.importorskip("mkdocs", reason="needs the extra docs")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(tmp_path)]
    subprocess.run(command, check=True, cwd=ROOT, capture_output=True)
    faults = scenario("alone/docs", tmp_path, *PAGES)["faults"]
    assert len(faults) == 2 * len(PAGES)
    assert faults == {page: [] for page in faults}
