"""The pages of a study as a folder of static files: index.html, one script, one style sheet, the animations."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

FILES = ("index.html", "style.css", "study.js")


def write_study_page(folder: Path, study: str, rings: Sequence[Sequence[str]]) -> Path:
    """Write the pages of a study into an existing, empty folder, and return the folder for its animations.

    `rings` are the names of each scene's animations, in the order of its ring (lab/study/study.py); their files,
    `<name>.webp`, are to be written into the folder that is returned. Nothing but the names is told to the page.
    """
    told = json.dumps({"study": study, "scenes": [list(ring) for ring in rings]}).replace("<", "\\u003c")
    source = files("bodysense.lab.study").joinpath("assets")
    for name in FILES:
        text = source.joinpath(name).read_text(encoding="utf-8")
        (folder / name).write_text(text.replace(">STUDY<", f">{told}<"), encoding="utf-8")
    clips = folder / "clips"
    clips.mkdir()
    return clips
