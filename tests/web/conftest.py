"""The page in a real browser: node, npm's packages and Chromium, or the test is skipped."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

WEB = Path(__file__).parents[2] / "web"
PAGE = Path(__file__).parents[2] / "packages" / "live" / "src" / "bodysense_live" / "page"

VISION = WEB / "node_modules" / "@mediapipe" / "tasks-vision" / "wasm"

Scenario = Callable[..., dict[str, Any]]

# Words of statistics, mathematics and programming, which users of the page do not need. Joints and rigs are not among
# them: people who drop motion files know them. Messages may name files.
JARGON = re.compile(
    r"p50|p9\d|percentile|quantile|median|\bmean\b|MPJPE|jitter|deviation|sigma|\bms\b|\bHz\b|\bfps\b|frame ?rate"
    r"|latency|throughput|stale|buffer|backlog|thread|worker|socket|session|protocol|payload|\bJSON\b|\bUDP\b"
    r"|quaternion|wxyz|euler|rad(?:ian)?s?\b|matrix|vector|\btensor|kinematic|retarget"
    r"|inference|\bONNX\b|wasm|WebAssembly|mask|offset|\bAPI\b"
    r"|NaN|undefined|\bnull\b|\[object|Exception|TypeError|RangeError|\bat \S+:\d+",
    re.IGNORECASE,
)


@pytest.fixture(scope="session")
def web() -> Path:
    """The folder of the page's source, with npm's packages."""
    if shutil.which("node") is None:
        pytest.skip("no node: install Debian's nodejs")
    if not (WEB / "node_modules").is_dir():
        pytest.skip("no npm packages: run `npm ci` in web/")
    return WEB


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that `bodysense page` writes; with the webcam where MediaPipe's files are there.

    Its models are scripts/build_landmarkers.py's, its WebAssembly is npm's.
    """
    from bodysense.devices.video.landmarker_files import landmarker_folder
    from bodysense_live.server.page_files import WEBCAM, write_page

    if not (PAGE / "index.html").is_file():
        pytest.skip("the page is not built: run `npm run build` in web/")
    mediapipe, folder = tmp_path_factory.mktemp("mediapipe"), tmp_path_factory.mktemp("site")
    for name in WEBCAM:
        found = next(filter(Path.is_file, (landmarker_folder() / name, VISION / name)), None)
        if found is not None:
            (mediapipe / name).symlink_to(found)
    write_page(folder, mediapipe)
    return folder


@pytest.fixture(scope="session")
def scenario(web: Path) -> Scenario:
    """Runs web/tests/browser/NAME.mjs in headless Chromium; what it prints as JSON.

    Whatever it does, the page reports no error and says nothing that is not plain.
    """
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
    if chromium is None:
        pytest.skip("no Chromium: install Debian's chromium")
    if not (PAGE / "index.html").is_file():
        pytest.skip("the page is not built: run `npm run build` in web/")

    def run(name: str, *arguments: str | Path) -> dict[str, Any]:
        done = subprocess.run(
            ["node", f"tests/browser/{name}.mjs", *map(str, arguments)],
            cwd=web,
            env={**os.environ, "CHROMIUM": chromium},
            capture_output=True,
            text=True,
            check=False,
            timeout=900,
        )
        assert done.returncode == 0, done.stderr[-3000:]
        result = json.loads(done.stdout.splitlines()[-1])
        assert result.pop("errors") == []
        assert [text for text in result["read"] if JARGON.search(text)] == []
        return result

    return run
