"""README and docs: every Python snippet runs, and every command has the options that they use."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import fields, replace
from functools import cache, partial
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bodysense as bs
from bodysense.body.keypoints import ArmKeypoints
from bodysense.cli import main
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.device import simulate
from bodysense.devices.video.landmarker_files import find_landmarkers
from bodysense.io.clip import Clip
from bodysense_lab.papers.pahmt.camera_view import FRONT, sample_cameras, view, view_points
from bodysense_live.protocols.marker_stream import write_frame

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "packages").glob("*/README.md"))]
FENCED = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
GROUPS = ("data", "train", "evaluate", "papers", "bench", "study")
INDENTED = re.compile(r"^    (bodysense .*(?:\\\n.*)*)$", re.MULTILINE)


def page_id(page: Path) -> str:
    """README, serve, or lab-README of a package."""
    return page.stem if not page.is_relative_to(ROOT / "packages") else f"{page.parent.name}-{page.stem}"


def snippets(page: Path) -> list[str]:
    """The Python blocks of a page."""
    return [code for language, code in FENCED.findall(page.read_text()) if language == "python"]


def commands(page: Path) -> Iterator[list[str]]:
    """The words of each `bodysense …` command that a page shows, without comments."""
    text = page.read_text()
    blocks = [code for language, code in FENCED.findall(text) if language in ("", "sh")]
    for block in [*blocks, *INDENTED.findall(text)]:
        for line in block.replace("\\\n", " ").splitlines():
            if line.startswith("bodysense "):
                yield shlex.split(line, comments=True)[1:]
    for code in re.findall(r"`bodysense ([^`]+)`", FENCED.sub("", text)):
        yield [word for word in shlex.split(code) if word != "…"]


WITH_SNIPPETS = [page for page in PAGES if snippets(page)]


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason="needs the extra docs")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    built = subprocess.run(command, check=False, cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "api" / "index.html").is_file()


def test_there_are_snippets_and_commands() -> None:
    assert len(WITH_SNIPPETS) >= 5
    assert sum(len(list(commands(page))) for page in PAGES) >= 40


def beginning(frames: int) -> Clip:
    clip = packaged_performance()
    return replace(clip, pose=clip.pose[:frames])


def in_readme(_: pytest.MonkeyPatch) -> dict[str, Any]:
    seen = simulate(beginning(3), "three_point")
    frames = [
        (time, dict(zip(seen.points, zip(position, rotation, strict=True), strict=True)))
        for time, position, rotation in zip(seen.time, seen.position, seen.rotation, strict=True)
    ]
    return {"frames": frames}


def in_api(_: pytest.MonkeyPatch) -> dict[str, Any]:
    bs.write("walk.bvh", beginning(60))
    return {}


def in_arms(_: pytest.MonkeyPatch) -> dict[str, Any]:
    clip = beginning(60)
    points = view_points(clip.pose)[None]
    seen = view(points, clip.time, sample_cameras(points[:, 0], np.random.default_rng(0), FRONT))
    first = {field.name: getattr(seen, field.name)[0] for field in fields(ArmKeypoints) if field.name != "time"}
    return {"keypoints": ArmKeypoints(time=seen.time, **first)}


def in_completion(_: pytest.MonkeyPatch) -> dict[str, Any]:
    seen_by_headset(60)
    return {}


def in_engines(patch: pytest.MonkeyPatch) -> dict[str, Any]:
    """A recording, and as much of Blender as the page uses."""
    seen_by_headset(60)
    Path("seen.npz").rename("take.npz")
    imported = SimpleNamespace(bvh=lambda filepath, **_: bs.read(filepath))
    patch.setitem(sys.modules, "bpy", SimpleNamespace(ops=SimpleNamespace(import_anim=imported)))  # pyright: ignore[reportArgumentType]
    return {}


def in_own_network(_: pytest.MonkeyPatch) -> dict[str, Any]:
    pytest.importorskip("torch")
    return {}


def in_files(_: pytest.MonkeyPatch) -> dict[str, Any]:
    """A take on a rig with names of its own."""
    seen_by_headset(260)
    assert main(["track", "seen.npz", "--rig", "mixamo", "-o", "take.bvh"]) == 0
    return {}


def seen_by_headset(frames: int) -> None:
    """Write seen.npz."""
    bs.write("walk.bvh", beginning(frames))
    assert main(["simulate", "walk.bvh", "--device", "three_point", "-o", "seen.npz"]) == 0


def in_gloves(_: pytest.MonkeyPatch) -> dict[str, Any]:
    """Packets of three frames, in millimetres."""
    markers = simulate(beginning(3), "gloves")
    places = [dict(zip(markers.points, 1000 * row, strict=True)) for row in markers.position]
    return {"packets": [write_frame(float(time), row) for time, row in zip(markers.time, places, strict=True)]}


CONTEXTS: dict[str, Callable[[pytest.MonkeyPatch], dict[str, Any]]] = {
    "README": in_readme,
    "avatars": lambda _: {},
    "api": in_api,
    "pahmt": in_arms,
    "coming-from": lambda _: {},
    "completion": in_completion,
    "concepts": in_completion,
    "engines": in_engines,
    "files": in_files,
    "gloves": in_gloves,
    "own-network": in_own_network,
}


@pytest.mark.parametrize("page", [page for page in WITH_SNIPPETS if page.stem != "video"], ids=page_id)
def test_snippets_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the order in which the page shows them, in one namespace."""
    monkeypatch.chdir(tmp_path)
    names = CONTEXTS[page.stem](monkeypatch)
    for number, code in enumerate(snippets(page), start=1):
        exec(compile(code, f"{page.name}, snippet {number}", "exec"), names)


@pytest.mark.slow
def test_the_snippet_on_video_runs(
    landmarkers: Path, filmed: tuple[np.ndarray, Clip], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    av = pytest.importorskip("av")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "bodysense.devices.video.landmarker_files.find_landmarkers", partial(find_landmarkers, landmarkers)
    )
    with av.open("video.mp4", "w") as container:
        stream = container.add_stream("libx264", rate=15)
        stream.height, stream.width, stream.pix_fmt = *filmed[0].shape[1:3], "yuv420p"
        for picture in filmed[0]:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    for code in snippets(ROOT / "docs" / "video.md"):
        exec(compile(code, "video.md", "exec"), {})


@cache
def options_of(*command: str) -> set[str]:
    with pytest.raises(SystemExit) as stop, redirect_stdout(StringIO()) as printed:
        main([*command, "--help"])
    assert stop.value.code == 0, command
    return set(re.findall(r"(?<![\w-])--?[a-zA-Z][\w-]*", printed.getvalue()))


def test_commands_have_their_options() -> None:
    for page in PAGES:
        for words in commands(page):
            check_options(page, words)


def check_options(page: Path, words: list[str]) -> None:
    known = options_of(*words[: 2 if words[0] in GROUPS else 1])
    given = {word for word in words if re.fullmatch(r"--?[a-zA-Z][\w-]*", word)} - {"--overwrite", "--quiet"}
    assert given <= known, f"{page.name}: bodysense {' '.join(words)}: unknown {sorted(given - known)}"


def test_each_row_of_the_papers_has_commands_that_exist() -> None:
    page = ROOT / "docs" / "reproduce.md"
    rows = re.findall(r"^\| (\d\.\d+) \|[^|]*\|([^|]*)\|", page.read_text(), re.MULTILINE)
    counts = {1: 18, 2: 12, 3: 10, 4: 15}  # of points of each paper
    assert [number for number, _ in rows] == [f"{k}.{n}" for k, count in counts.items() for n in range(1, count + 1)]
    for number, cell in rows:
        given = [code.split() for code in re.findall(r"`([^`]+)`", cell)]
        assert given, number
        for words in given:
            if words[0] == "measure_figures.py":
                continue
            check_options(page, words if len(words) > 1 else [given[0][0], *words])


def test_the_api_page_has_every_public_name() -> None:
    page = (ROOT / "docs" / "api.md").read_text()
    listed = set(re.findall(r"^::: bodysense(?:\.quality)?\.(\w+)$", page, re.MULTILINE))
    assert listed == set(bs.__all__)


def test_each_part_of_the_gallery_has_a_picture_and_a_command() -> None:
    _, *parts = (ROOT / "docs" / "gallery.md").read_text().split("\n## ")
    assert len(parts) >= 6
    for part in parts:
        assert re.search(r"!\[.+\]\(figures/.+\)", part) and "\nbodysense " in part, part.splitlines()[0]


def test_every_public_name_has_an_example() -> None:
    """Between the name before and its own; `bs.track(` for a function or a class, or an object of a class."""
    text = (ROOT / "docs" / "api.md").read_text()
    first, *parts = re.split(r"^::: bodysense(?:\.quality)?\.(\w+)$", text, flags=re.MULTILINE)
    befores = [first, *parts[1::2]]
    without = [name for name, before in zip(parts[0::2], befores, strict=False) if not FENCED.search(before)]
    assert without == []
    code = "\n".join(snippets(ROOT / "docs" / "api.md"))
    objects = {"Device": "def observe(", "Estimate": "estimate[", "Observation": "bs.Observation.from_arrays("}
    unused = [name for name in bs.__all__ if objects.get(name, f"bs.{name}") not in code]
    assert unused == ["Skeleton", "Take"]  # made by default_skeleton and track


def test_link_targets_exist() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text()):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_files_that_are_named_exist() -> None:
    roots = (
        ROOT,
        ROOT / "web",
        ROOT / "src",
        ROOT / "src" / "bodysense",
        *(ROOT / "packages").glob("*/src"),
        *(ROOT / "packages").glob("*/src/*"),
    )
    named = [
        (page.name, name)
        for page in [
            *PAGES,
            *(ROOT / "src").rglob("*.py"),
            *(ROOT / "packages").rglob("*.py"),
            *(ROOT / "scripts").glob("*.py"),
        ]
        for name in re.findall(r"`([a-z_]+/[\w/]+\.(?:py|ts|mjs))`", page.read_text(encoding="utf-8"))
    ]
    assert len(named) >= 20
    assert not [(page, name) for page, name in named if not any((root / name).exists() for root in roots)]
