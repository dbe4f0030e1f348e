"""Motion files on disk, alone or in folders, with the person, category and split of each."""

from __future__ import annotations

import csv
import json
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip, at_height
from bodysense.io.datasets.layouts import Layout, labelled, layout_of
from bodysense.io.datasets.splits import SPLITS, Split
from bodysense.io.formats.amass import read_amass
from bodysense.io.formats.archive import SUFFIXES, ZIP, MotionFile, motion_files
from bodysense.io.placement import BodyPlacement, read_with_placement, standing_floor
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.io.rigged import FBX, read_rigged
from bodysense.io.rigs.canonical import complete_skeleton
from bodysense.io.rigs.rig import Rig


@dataclass(frozen=True)
class Source:
    """A motion file and its labels from the folder."""

    path: Path
    person: str
    split: Split
    category: str = ""
    skeleton: Skeleton | None = None  # of the body, if the file does not hold it
    member: str = ""  # of the zip file at `path`
    rest: Literal["given", "found"] = "given"  # found: from the motion, if the file's does not stand (`stance`)
    placement: BodyPlacement | None = None  # height and floor of an AMASS file's person; None: those of this motion

    @property
    def file(self) -> MotionFile:
        """The file on disk or in its zip file."""
        return MotionFile(self.path, self.member)

    def key(self, directory: Path) -> str:
        """Return its path relative to a folder, the name of the zip file included."""
        return self.file.place.relative_to(directory).as_posix()


def read_source(source: Source, options: ReadingOptions = AS_FOUND) -> Clip:
    """Read the clip of a source in canonical form, with its person and category. Raises for half bodies, too."""
    clip = read_with_rig(source, options)[0]
    if clip.lacks:
        raise BodysenseError(
            f"{source.file.place}: the body has no {' and no '.join(clip.lacks)}; leave the file out, or complete it "
            f"first: bodysense track {source.file.place.name} -o whole.bvh"
        )
    return clip


def read_with_rig(source: Source, options: ReadingOptions = AS_FOUND) -> tuple[Clip, Rig | None]:
    """Return the clip of a source in canonical form, and the recognised rig; None for AMASS, which has no rig.

    Raises BodysenseError for other files and damaged ones.
    """
    file = source.file
    suffix = file.place.suffix
    if suffix.lower() not in (*SUFFIXES, ZIP, FBX):
        what = f"unknown kind of file {suffix!r}" if suffix else "a name without an ending"
        raise BodysenseError(f"{file.place}: {what}; valid are {', '.join(SUFFIXES)}")
    rig = None
    if suffix.lower() == ".npz":
        clip = read_amass_source(source, options)[0]
    else:
        rigged = read_rigged(file.read(), file.place, options, must_stand=source.rest == "found")
        clip, rig = rigged.clip, rigged.rig
    return replace(clip, person=source.person, category=source.category), rig


def read_amass_source(source: Source, options: ReadingOptions) -> tuple[Clip, BodyPlacement | None]:
    """Read an AMASS file, with the placement that its body was given; None if its skeleton is known.

    Then only the floor is found, where the feet of this motion stand.
    """
    if source.skeleton is not None:
        clip = read_amass(source.path, source.skeleton, unit=options.metres)
        if options.floor is None:
            clip = with_floor(clip, standing_floor(clip))
        return apply_options(clip, replace(options, unit=None), "AMASS files", "z"), None
    clip, placement = read_with_placement(source.path, options.smpl_model, source.placement, options.metres)
    if options.floor is not None:  # undo the floor that was found
        clip = with_floor(clip, -placement.floor)
    return apply_options(clip, replace(options, unit=None), "AMASS files", "z"), placement


def list_sources(directory: str | Path, layout: Layout | None = None) -> list[Source]:
    """Return the motion files of a folder, those in zip files included, sorted by path.

    A folder with `splits.json` is read by that file, `categories.csv` and `skeletons.json` (see docs/data.md), and so
    is the folder of one of its sets. The published data sets that `io.datasets.layouts` describes are recognised by
    the folder's content, or given by `layout`. In any other, the person is the first folder below `directory`;
    for files directly in it, the 'subject5' in the name, or else the name up to the first '_'. The split follows from
    the person's name. Raises BodysenseError if there is no file, or if the folder does not have the requested
    layout.
    """
    directory = Path(directory)
    if not directory.is_dir():
        what = "file" if directory.suffix else "folder"
        raise BodysenseError(f"{directory}: no such {what}; give a motion file, or a folder of .bvh or .npz files")
    if layout is None and (directory / "splits.json").is_file():
        sources = _described_sources(directory)
    elif layout is None and directory.name in _described_sets(directory.parent):
        sources = [one for one in _described_sources(directory.parent) if one.path.is_relative_to(directory)]
    else:
        files = motion_files(directory)
        rows = labelled(layout or layout_of(directory, files), directory, files) if files else []
        sources = [
            Source(row.file.path, row.person, row.split, row.category, member=row.file.member, rest=row.rest)
            for row in rows
        ]
    if not sources:
        raise BodysenseError(f"{directory}: no .bvh or .npz file in it; give a folder of motion files")
    return sorted(sources, key=lambda source: source.file)


def skeleton_from_entry(entry: dict[str, Any]) -> Skeleton:
    """Return the full skeleton of an entry of `skeletons.json`; missing points are the default's, scaled to fit."""
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


def _described_sets(directory: Path) -> Collection[str]:
    """Return the sets that a folder's splits.json names; empty if there is no such file."""
    try:
        return json.loads((directory / "splits.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ()


def _described_sources(directory: Path) -> list[Source]:
    """Return the files of a described folder; its splits.json is {set: {split: people or clips}}."""
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
            for path in (path for path in (directory / name).rglob("*") if path.suffix.lower() in SUFFIXES):
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


def apply_options(clip: Clip, options: ReadingOptions, kind: str, up: str) -> Clip:
    """Apply the floor and the height of options to a motion; other options are refused for this `kind` of files."""
    for option, value in (("unit", options.unit), ("joints", options.joints), ("figure", options.figure)):
        if value is not None:
            raise BodysenseError(
                f"{clip.name}: {kind} hold one body, in metres, whose joints are known; leave --{option} out"
            )
    if options.left_handed:
        raise BodysenseError(f"{clip.name}: {kind} are right-handed; leave --left-handed out")
    if options.up not in (None, up):
        raise BodysenseError(f"{clip.name}: {kind} are {up} up; leave --up {options.up} out")
    if options.floor is not None:
        clip = with_floor(clip, options.floor)
    return clip if options.height is None else at_height(clip, options.height)


def with_floor(clip: Clip, floor: float) -> Clip:
    """Move a motion so that a floor of that height (m) comes to 0."""
    pose = clip.pose
    root = pose.root_position - np.array([0.0, floor, 0.0])
    return replace(clip, pose=Pose(pose.skeleton, root, pose.rotation))
