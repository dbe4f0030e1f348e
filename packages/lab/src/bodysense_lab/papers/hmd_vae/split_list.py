"""Lists that split motion into training and test, for tables whose papers publish such a list."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from bodysense.errors import BodysenseError

Listed = Literal["train", "test"]


def read_split_file(path: Path) -> dict[str, Listed]:
    """A split list: a line a motion, 'PATH train' or 'PATH test', the path relative to the data's folder."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror}); give a list of lines 'PATH train'") from None
    listed: dict[str, Listed] = {}
    for number, line in enumerate(lines, start=1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        name, _, which = text.rpartition(" ")
        key = name.strip().replace("\\", "/").removeprefix("./")
        if which not in ("train", "test") or not key:
            raise BodysenseError(f"{path}, line {number}: {text!r} is not 'PATH train' or 'PATH test'")
        if listed.setdefault(key, which) != which:
            raise BodysenseError(f"{path}, line {number}: {key} is in train and in test; keep one")
    return listed
