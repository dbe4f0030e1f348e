"""Folders of motion with one person of each split."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split, split_of
from bodysense.io.formats.bvh import write_bvh


def person_of(split: Split) -> str:
    """Return the name of a person of a split."""
    return next(name for name in map(str, range(99)) if split_of(name) == split)


def write_people(folder: Path, clips: Mapping[Split, Sequence[Clip]]) -> Path:
    """Write the clips of a person of each split as BVH files 0.bvh, 1.bvh, …; returns the folder."""
    for split, theirs in clips.items():
        (folder / person_of(split)).mkdir(parents=True)
        for number, clip in enumerate(theirs):
            write_bvh(folder / person_of(split) / f"{number}.bvh", clip)
    return folder
