"""Descriptions of motion files in a folder: their content, how each was read, or why it cannot be read."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bodysense.errors import BodysenseError, how_to_install
from bodysense.io.datasets.layouts import Layout
from bodysense.io.datasets.splits import empty_split
from bodysense.io.reading_options import ReadingOptions

if TYPE_CHECKING:
    from rich.table import Table

    from bodysense.io.clip import Clip
    from bodysense.io.datasets.sources import Source
    from bodysense.io.rigs.rig import Rig

Split = Literal["train", "val", "test", "all"]
LISTED = 40  # largest number of files that are listed one by one; in larger folders equal ones are counted
OTHERS = (
    *(".fbx", ".mvnx", ".glb", ".gltf", ".vrma", ".npy", ".c3d", ".trc", ".tsv", ".csv", ".jsonl"),
    *(".pkl", ".pickle", ".gz"),  # unsupported, listed with the fix
)
LAB = "packages/lab"
KINDS = {".glb": "glTF", ".gltf": "glTF", ".vrma": "VRM animation", ".npy": "SMPL"}


@dataclass(frozen=True)
class FoundFile:
    """A file with its content, or the reason why it cannot be read."""

    key: str
    clip: Clip | None = None
    rig: Rig | None = None
    kind: str = "AMASS"  # kind of a file without a rig
    summary: str = ""  # content of a file without a rig
    rate: float = 0.0  # Hz
    reason: str = ""  # why it cannot be read


def files_in(
    place: Path, split: Split, layout: Layout | None, reading: ReadingOptions
) -> tuple[int, Iterable[FoundFile]]:
    """Return the number of files in a place, and an iterable that reads one after the other."""
    from bodysense.io.datasets.sources import Source, list_sources
    from bodysense.io.formats.archive import motion_files

    if (place / "zarr.json").is_file():
        raise BodysenseError(f"{place}: a prepared store of motion, which {LAB} reads; {how_to_install(LAB)}")
    if place.is_file():
        return 1, (_read(place.name, Source(place, person="", split="test"), reading) for _ in range(1))
    others: list[Path] = []  # that belong to no data set: markers, glTF, recordings, and unsupported kinds
    if split == "all" and place.is_dir() and not (place / "splits.json").exists():
        others = sorted(path for path in place.rglob("*") if path.suffix.lower() in OTHERS and path.is_file())
    every = [] if others and not motion_files(place) else list_sources(place, layout)
    sources = [source for source in every if split in ("all", source.split)]
    if not sources and not others:
        raise BodysenseError(empty_split(str(place), split, (source.split for source in every)))
    sources += [Source(path, person="", split="test") for path in others]
    return len(sources), (_read(source.key(place), source, reading) for source in sources)


def _read(key: str, source: Source, reading: ReadingOptions) -> FoundFile:
    from bodysense.io.datasets.sources import read_with_rig

    alone = source.skeleton is None and not source.member
    try:
        if alone and source.path.suffix.lower() not in (".bvh", ".fbx", ".mvnx", ".zip"):
            return _read_other(key, source, reading)
        clip, rig = read_with_rig(source, reading)
    except BodysenseError as error:
        return FoundFile(key, reason=str(error))
    return FoundFile(key, clip, rig, rate=clip.frame_rate)


def _read_other(key: str, source: Source, reading: ReadingOptions) -> FoundFile:
    """Read a file without a rig: AMASS, results of SMPL, glTF, or markers and recordings, which have no clip."""
    from bodysense.sources.open import MarkerSource, MotionSource, VideoSource, open_source

    opened = open_source(source.path, reading)
    if isinstance(opened, VideoSource):
        raise BodysenseError(f"{source.path}: a video; complete it: bodysense track {source.path.name} -o motion.bvh")
    if isinstance(opened, MotionSource):
        clip = replace(opened.clip, person=source.person, category=source.category)
        warned = (f"WARNING: {line}" for line in clip.warnings)
        summary = "; ".join((*(line.removeprefix("note: ") for line in opened.remarks), *warned))
        kind = KINDS.get(source.path.suffix.lower(), "AMASS or SMPL")
        return FoundFile(key, clip, kind=kind, summary=summary, rate=clip.frame_rate)
    seen = opened.recording.observation
    rate = (len(seen) - 1) / max(float(seen.time[-1] - seen.time[0]), 1e-9)
    if isinstance(opened, MarkerSource):
        summary = f"{len(seen.points)} points of {'gloves' if opened.recording.known else 'a body'}"
        lines = (line.removeprefix("note: ") for line in opened.remarks)
        rate = rate if opened.found is None else opened.found.frame_rate
        return FoundFile(key, kind="markers", summary="; ".join((summary, *lines, *opened.warnings)), rate=rate)
    return FoundFile(key, kind="recording", summary=f"{len(seen.points)} points, {len(seen)} frames", rate=rate)


def readable_clips(every: Iterable[FoundFile], found: list[FoundFile]) -> Iterator[Clip]:
    """Yield the readable clips, and append every file to `found`, without its motion."""
    for one in every:
        if one.clip is not None:
            yield one.clip
        found.append(one if one.clip is None else replace(one, clip=replace(one.clip, pose=one.clip.pose[:1])))


def description_of(one: FoundFile) -> str:
    """Return a line that describes one file."""
    if one.rig is None:
        return f"{one.key}: {one.kind}, {one.rate:g} Hz" + (f"; {one.summary}" if one.summary else "")
    sure = f"confidence {one.rig.confidence:.0%}"
    left_out = (
        f"; of its {one.rig.count} joints {one.rig.count - one.rig.used} are left out"
        if one.rig.used < one.rig.count
        else ""
    )
    warned = "".join(f"; WARNING: {line}" for line in (() if one.clip is None else one.clip.warnings))
    return f"{one.key}: {one.rig.line()}; {sure}{left_out}{warned}"


def table_of(found: list[FoundFile]) -> Table:
    """Return the table of files: one row per file, or, for many files, one row per group of equal ones."""
    from rich import box
    from rich.table import Table

    table = Table(title="How the files were read", box=box.SIMPLE_HEAD, pad_edge=False)
    names = ("rig", "joints", "unit", "up", "floor", "Hz", "missing")
    alone = len(found) <= LISTED
    for column in ("file" if alone else "files", *names, "confidence"):
        table.add_column(column, overflow="fold")
    rows: dict[tuple[str, ...], list[FoundFile]] = {}
    for one in found:
        if not one.reason:
            rows.setdefault((one.key,) if alone else _group_key(one), []).append(one)
    for alike in rows.values():
        least = [one.rig.confidence for one in alike if one.rig is not None]
        sure = f"{min(least):.0%}" if least else ""
        table.add_row(alike[0].key if alone else str(len(alike)), *_group_key(alike[0]), sure)
    return table


def _group_key(one: FoundFile) -> tuple[str, ...]:
    """Return the columns of a file without its name and confidence."""
    if one.rig is None:
        return (one.kind, "", "", "", "", f"{one.rate:g}", "")
    rig = one.rig
    unit = rig.unit_name or f"unknown, scaled to {rig.height:.2f} m"
    return (
        rig.family,
        str(rig.count),
        unit,
        rig.up,
        f"{0.0 - rig.lift:.2f}",
        f"{rig.frame_rate:g}",
        ", ".join(rig.lacking),
    )


def no_readable_file(place: Path, skipped: list[FoundFile]) -> str:
    """Return the message about a folder without a readable file."""
    return f"{place}: none of its {len(skipped)} files can be read; the first: {skipped[0].reason}"
