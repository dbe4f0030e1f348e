"""Motion files on disk: one file, a folder of them, and what is known of each (person, category, split)."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.data.amass import read_amass
from bodysense.data.bvh import read_bvh
from bodysense.data.canonical import canonical, complete_skeleton
from bodysense.data.clip import Clip
from bodysense.data.splits import SPLITS, Split, split_of
from bodysense.errors import BodysenseError

READERS = {".bvh": read_bvh, ".npz": read_amass}


@dataclass(frozen=True)
class Source:
    """A motion file and what its folder says of it."""

    path: Path
    person: str
    split: Split
    category: str = ""
    skeleton: Skeleton | None = None  # of the body, where the file does not hold it


def read_motion(path: str | Path) -> Clip:
    """Read a .bvh or .npz (AMASS) file, as it is. Raises BodysenseError for other files and damaged ones."""
    path = Path(path)
    if path.suffix.lower() not in READERS:
        raise BodysenseError(f"{path}: unknown kind of file {path.suffix!r}; valid are {', '.join(READERS)}")
    if path.is_file() and path.stat().st_size == 0:
        raise BodysenseError(f"{path}: the file is empty; copy or export it again")
    return READERS[path.suffix.lower()](path)


def read_source(source: Source) -> Clip:
    """The clip of a source in canonical form, with its person and category."""
    if source.skeleton is not None:
        clip = read_amass(source.path, source.skeleton)
    else:
        clip = read_motion(source.path)
    if source.path.suffix.lower() == ".bvh":
        clip = replace(canonical(replace(clip, name=str(source.path))), name=clip.name)  # errors name the file
    return replace(clip, person=source.person, category=source.category)


def list_sources(directory: str | Path) -> list[Source]:
    """The motion files of a folder, sorted by path.

    A folder with `splits.json` is read by that file, `categories.csv` and `skeletons.json` (see docs/data.md). In any
    other, the person is the first folder below `directory`; of files that lie in it, the 'subject5' in the name, or
    else the name up to the first '_'. The split follows from the person's name. Raises BodysenseError where there is
    no file.
    """
    directory = Path(directory)
    if not directory.is_dir():
        raise BodysenseError(f"{directory}: no such folder; give a folder of .bvh or .npz files")
    described = (directory / "splits.json").is_file()
    sources = _described_sources(directory) if described else _plain_sources(directory)
    if not sources:
        raise BodysenseError(f"{directory}: no .bvh or .npz file in it; give a folder of motion files")
    return sorted(sources, key=lambda source: source.path)


def skeleton_from_entry(entry: dict[str, Any]) -> Skeleton:
    """The full skeleton of an entry of `skeletons.json`; what it lacks is the default's, scaled to fit."""
    from bodysense.body.skeleton import default_skeleton

    ours = default_skeleton()
    offset = {name: np.array(row["offset"], dtype=float) for name, row in entry["joints"].items() if row["parent"]}
    for name, row in entry["end_sites"].items():
        site = [p for p in ours.end_sites if ours.joints[ours.parents[ours.index(p)]] == row["parent"]]
        for known in site or [name.replace("middle_knuckle", "middle1")]:
            offset[known] = np.array(row["offset"], dtype=float)
    return complete_skeleton(
        {name: vector for name, vector in offset.items() if name in ours.points},
        root_offset=np.array([0.0, entry["pelvis_height"], 0.0]),
    )


def _described_sources(directory: Path) -> list[Source]:
    """Files of a folder that has splits.json ({set: {split: people or clips}}), categories.csv and skeletons.json."""
    try:
        splits = json.loads((directory / "splits.json").read_text(encoding="utf-8"))
        with (directory / "categories.csv").open(newline="", encoding="utf-8") as file:
            rows = csv.DictReader(file)
            if not {"clip", "category"} <= set(rows.fieldnames or ()):
                raise KeyError("categories.csv: clip, category")
            category = {row["clip"]: row["category"] for row in rows}
        entries = json.loads((directory / "skeletons.json").read_text(encoding="utf-8"))
        skeletons = {name: skeleton_from_entry(entry) for name, entry in entries.items()}
        sources = []
        for name, of_split in splits.items():
            split = {key: which for which, keys in of_split.items() for key in keys}
            for path in (path for path in (directory / name).rglob("*") if path.suffix.lower() in READERS):
                inside = path.parent != directory / name
                person = path.parent.name if inside else path.stem.partition("_")[0]
                which = split.get(person if inside else path.stem)
                if which in SPLITS:
                    skeleton = skeletons.get(name) if path.suffix.lower() == ".npz" else None
                    sources.append(Source(path, f"{name}_{person}", which, category.get(path.stem, ""), skeleton))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise BodysenseError(
            f"{directory}: splits.json, categories.csv and skeletons.json do not fit together ({error!r}); "
            "mend them, or take splits.json away to split by folder names"
        ) from None
    return sources


def _plain_sources(directory: Path) -> list[Source]:
    """Files of any folder, the person by the rule that `list_sources` says."""
    sources = []
    for path in (path for path in directory.rglob("*") if path.suffix.lower() in READERS and path.is_file()):
        parts = path.relative_to(directory).parts
        subject = re.search(r"subject_?\d+", path.stem, re.IGNORECASE)
        person = parts[0] if len(parts) > 1 else subject[0] if subject else path.stem.partition("_")[0]
        sources.append(Source(path, person, split_of(person)))
    return sources
