"""The built page: what the wheel carries, and that it is what web/ says."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "src" / "bodysense" / "serve" / "page"
LARGEST = 1_500_000  # bytes, of the whole page


@pytest.fixture(scope="module")
def page() -> Path:
    if not (PAGE / "index.html").is_file():
        pytest.skip("the page is not built: run `npm run build` in web/")
    return PAGE


def test_the_page_is_whole_and_small(page: Path) -> None:
    html = (page / "index.html").read_text(encoding="utf-8")
    named = re.findall(r'(?:src|href)="\./([^"]+)"', html)
    assert named
    assert all((page / name).is_file() for name in named)
    assert sum(path.stat().st_size for path in page.iterdir()) < LARGEST


def test_the_page_fetches_nothing_from_elsewhere(page: Path) -> None:
    html = (page / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"""(?:src|href)=["'](?:https?:)?//""", html)
    style = (page / "index.css").read_text(encoding="utf-8")
    assert "url(" not in style and "@import" not in style


def test_the_licences_of_what_it_carries_are_in_it(page: Path) -> None:
    text = (page / "licenses.md").read_text(encoding="utf-8")
    assert {"three", "@pixiv/three-vrm"} <= set(re.findall(r"^## (\S+)", text, re.MULTILINE))


@pytest.mark.slow
def test_the_built_page_is_what_its_source_says(page: Path, web: Path, tmp_path: Path) -> None:
    build = ["npx", "vite", "build", "--outDir", str(tmp_path / "page"), "--logLevel", "error"]
    subprocess.run(build, cwd=web, check=True, timeout=300)
    fresh = {path.name: path.read_bytes() for path in (tmp_path / "page").iterdir()}
    kept = {path.name: path.read_bytes() for path in page.iterdir()}
    assert fresh.keys() == kept.keys()
    stale = [name for name, content in fresh.items() if kept[name] != content]
    assert stale == [], "run `npm run build` in web/"


@pytest.mark.slow
@pytest.mark.parametrize("command", [["npx", "tsc", "--noEmit"], ["npx", "vitest", "run"]])
def test_types_and_units(web: Path, command: list[str]) -> None:
    done = subprocess.run(command, cwd=web, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
