"""The built page: what the wheel carries, and that it is what web/ says."""

from __future__ import annotations

import gzip
import json
import lzma
import re
import subprocess
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

import pytest

from bodysense.cli import main
from bodysense.serve.page_files import write_page

PAGE = Path(__file__).parents[2] / "src" / "bodysense" / "serve" / "page"
LARGEST = 4_500_000  # bytes, of the whole page; ONNX Runtime is most of it


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
    text = "\n".join((page / name).read_text(encoding="utf-8") for name in ("licenses.md", "licenses-workers.md"))
    assert {"three", "@pixiv/three-vrm", "@mediapipe/tasks-vision", "onnxruntime-web"} <= set(
        re.findall(r"^## (\S+)", text, re.MULTILINE)
    )


@pytest.mark.slow
def test_the_built_page_is_what_its_source_says(page: Path, web: Path, tmp_path: Path) -> None:
    build = ["npx", "vite", "build", "--outDir", str(tmp_path / "page"), "--logLevel", "error"]
    subprocess.run(build, cwd=web, check=True, timeout=300)
    fresh, kept = contents(tmp_path / "page"), contents(page)
    assert fresh.keys() == kept.keys()
    stale = [name for name, content in fresh.items() if kept[name] != content]
    assert stale == [], "run `npm run build` in web/"


@pytest.mark.slow
@pytest.mark.parametrize("command", [["npx", "tsc", "--noEmit"], ["npx", "vitest", "run"]])
def test_types_and_units(web: Path, command: list[str]) -> None:
    done = subprocess.run(command, cwd=web, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]


def test_a_folder_of_the_page_says_what_is_in_it(page: Path, tmp_path: Path) -> None:
    written = dict(write_page(tmp_path / "out"))
    about = json.loads((tmp_path / "out" / "page.json").read_text(encoding="utf-8"))
    assert about["server"] is False and about["webcam"] is False
    assert set(about["files"]) == set(written) - {"page.json"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(written)
    for name, whole in (
        ("completion.onnx.gz", network().read_bytes()),
        ("runtime.wasm.gz", contents(page)["runtime.wasm.xz"]),
    ):
        assert gzip.decompress((tmp_path / "out" / name).read_bytes()) == whole
    assert sum(written.values()) < 13e6


def test_a_folder_of_the_page_is_the_same_every_time(page: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_page(tmp_path / name)
    first, second = ((tmp_path / name / "page.json").read_bytes() for name in ("a", "b"))
    assert first == second


def test_a_folder_of_the_page_cannot_be_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("x")
    assert main(["page", "--out", str(tmp_path / "file")]) == 2
    assert capsys.readouterr().err == f"bodysense: --out {tmp_path / 'file'}: it is a file; give a folder\n"
    assert main(["page", "--out", str(tmp_path / "new"), "--webcam", str(tmp_path)]) == 2
    assert "no pose_landmarker_full.task in it" in capsys.readouterr().err


def contents(folder: Path) -> dict[str, bytes]:
    """Of a built page, by name; unpacked, for each version of xz packs in its own way."""
    read = {path.name: path.read_bytes() for path in folder.iterdir()}
    return {name: lzma.decompress(content) if name.endswith(".xz") else content for name, content in read.items()}


def network() -> Traversable:
    return files("bodysense.weights").joinpath("completion.onnx")
