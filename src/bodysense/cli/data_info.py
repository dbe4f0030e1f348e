"""`bodysense data info`: what motion files hold and how they were read; `data joints`: a table of joints to edit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from bodysense.cli.options import Reading
from bodysense.data.layouts import Layout
from bodysense.data.splits import empty_split
from bodysense.errors import BodysenseError
from bodysense.occlusion.headset_camera import HeadsetCamera
from bodysense.rigs.options import AS_FOUND, ReadingOptions

if TYPE_CHECKING:
    from rich.table import Table

    from bodysense.data.clip import Clip
    from bodysense.data.sources import Source
    from bodysense.rigs.rig import Rig

Split = Literal["train", "val", "test", "all"]
PICTURED = 6  # frames of a picture
LISTED = 40  # files of a folder that are listed one by one; of more, those alike are counted
OTHERS = (
    *(".glb", ".gltf", ".vrma", ".npy", ".c3d", ".trc", ".tsv", ".csv", ".jsonl"),
    *(".fbx", ".pkl", ".pickle", ".gz"),  # with what to do about them
)
KINDS = {".glb": "glTF", ".gltf": "glTF", ".vrma": "VRM animation", ".npy": "SMPL"}
REASONS = 20  # of files that cannot be read, that are printed


@dataclass(frozen=True)
class Found:
    """A file and what it holds, or why it cannot be read."""

    key: str
    clip: Clip | None = None
    rig: Rig | None = None
    kind: str = "AMASS or store"  # what it is, where it has no rig
    said: str = ""  # what was found of it, where it has no rig
    rate: float = 0.0  # Hz
    reason: str = ""  # why it cannot be read


def info(
    place: Annotated[Path, tyro.conf.Positional],
    occlusion: bool = False,
    split: Split = "all",
    layout: Layout | None = None,
    camera: HeadsetCamera = HeadsetCamera(),
    picture: Path | None = None,
    json: Path | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Say what a motion file, a folder of them or a prepared store holds, and how each file was read.

    Of each file: rig, unit, upward axis, floor, frame rate, what is missing, how sure that is. What cannot be read is
    skipped, counted and given with the reason.

    Args:
        place: a motion file (.bvh, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma), markers (.c3d, .trc, .tsv, .csv), a
            recording, a folder of them, also .bvh in .zip, or a store written by `bodysense data prepare`.
        occlusion: simulate the headset's cameras and print the statistics of UNOC, Table 1, beside the published ones.
        split: which people.
        layout: which published data set the folder is; recognised by what is in it if omitted.
        camera: the headset's, for --occlusion.
        picture: PNG file for stick figures of the first file that can be read.
        json: JSON file for the numbers, one flat object.
        reading: what the files do not say of themselves.
    """
    from rich.console import Console
    from rich.progress import track

    from bodysense.cli.show import write_numbers
    from bodysense.files import check_place

    if picture is not None:
        check_place(picture)
    total, every = _files(place, split, layout, reading)
    found: list[Found] = []
    if occlusion:
        from bodysense.lab.unoc.occlusion_table import occlusion_table

        shown, numbers = occlusion_table(_readable(track(every, "looking", total), found), camera)
        Console().print(shown)
    else:
        counts = _Counts()
        for clip in _readable(track(every, "reading", total) if total > 1 else every, found):
            counts.add(clip)
            if picture is not None and counts.clips == 1:
                _draw(picture, clip)
        numbers = counts.numbers()
        if total == 1:
            print(*(_line(one) for one in found if not one.reason), end="" if found[0].reason else "\n")
        else:
            Console().print(_rigs(found))
            Console().print(counts.table(f"{place} ({split})"))
    skipped = [one for one in found if one.reason]
    if len(skipped) == len(found):
        raise BodysenseError(skipped[0].reason if total == 1 else _none_of(place, skipped))
    for one in skipped[:REASONS]:
        print(f"skipped {one.reason if one.key in one.reason else f'{one.key}: {one.reason}'}")
    if skipped:
        print(
            f"skipped {len(skipped)} of {len(found)} files"
            + (", the first with reasons" if len(skipped) > REASONS else "")
        )
    write_numbers(json, numbers | {"skipped": len(skipped)})


def joints(
    file: Annotated[Path, tyro.conf.Positional],
    out: Annotated[Path | None, tyro.conf.arg(aliases=("-o",))] = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Draft the table for --joints: every joint of a BVH file, and which of ours it was taken for.

    Args:
        file: BVH file.
        out: JSON file; printed if omitted.
        reading: what the file does not say of itself.
    """
    from bodysense.data.archive import MotionFile
    from bodysense.data.rigged import figure_of_file
    from bodysense.rigs.joint_map import joint_map_text, write_joint_map
    from bodysense.rigs.rig import recognise

    if file.suffix.lower() != ".bvh":
        raise BodysenseError(f"{file}: joints are named in .bvh files only; give one")
    figure = figure_of_file(MotionFile(file).read(), file, reading)
    try:
        rig = recognise(figure, reading)
        given, said = dict(rig.joints), rig.line()
    except BodysenseError as error:
        given, said = {}, f"{error}; name its joints by hand"
    if out is None:
        print(joint_map_text(figure, given), end="")
        return
    write_joint_map(out, figure, given)
    print(f"wrote {out}: {len(given)} of {len(figure.points)} joints and end sites named; {said}")


def _files(place: Path, split: Split, layout: Layout | None, reading: ReadingOptions) -> tuple[int, Iterable[Found]]:
    """How many files a place has, and each of them when its turn comes."""
    from bodysense.data.sources import Source, list_sources
    from bodysense.lab.clips import count_clips, open_clips
    from bodysense.lab.store import is_store

    if place.is_dir() and is_store(place):
        clips = open_clips(place, split, layout=layout, options=reading)
        return count_clips(place, split), (Found(clip.name, clip) for clip in clips)
    if place.is_file():
        return 1, (_read(place.name, Source(place, person="", split="test"), reading) for _ in range(1))
    others = _others(place) if place.is_dir() and split == "all" else []
    every = [] if others and not _has_motion(place) else list_sources(place, layout)
    sources = [source for source in every if split in ("all", source.split)]
    if not sources and not others:
        raise BodysenseError(empty_split(str(place), split, (source.split for source in every)))
    sources += [Source(path, person="", split="test") for path in others]
    return len(sources), (_read(source.key(place), source, reading) for source in sources)


def _has_motion(folder: Path) -> bool:
    from bodysense.data.archive import motion_files

    return bool(motion_files(folder))


def _others(folder: Path) -> list[Path]:
    """Files of a folder that are no part of a data set: markers, glTF, recordings, and what is refused by name."""
    if (folder / "splits.json").exists():
        return []
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in OTHERS and path.is_file())


def _read(key: str, source: Source, reading: ReadingOptions) -> Found:
    from bodysense.data.sources import read_with_rig

    alone = source.skeleton is None and not source.member
    try:
        if alone and source.path.suffix.lower() not in (".bvh", ".zip"):
            return _read_other(key, source, reading)
        clip, rig = read_with_rig(source, reading)
    except BodysenseError as error:
        return Found(key, reason=str(error))
    return Found(key, clip, rig, rate=clip.frame_rate)


def _read_other(key: str, source: Source, reading: ReadingOptions) -> Found:
    """A file that has no rig: AMASS, results of SMPL, glTF; markers and recordings, which are no motion yet."""
    from bodysense.capture.recording import is_recording, read_recording
    from bodysense.io.markers.files import is_marker_file
    from bodysense.io.markers.recording import read_markers
    from bodysense.reading import check_kind, read_clip

    path = source.path
    check_kind(path)
    if is_marker_file(path):
        markers = read_markers(path)
        said = f"{len(markers.observation.points)} points of {'a body' if markers.has_body else 'gloves'}"
        return Found(key, kind="markers", said="; ".join((said, *markers.remarks)), rate=markers.frame_rate)
    if is_recording(path):
        seen = read_recording(path).observation
        rate = (len(seen) - 1) / max(float(seen.time[-1] - seen.time[0]), 1e-9)
        return Found(key, kind="recording", said=f"{len(seen.points)} points, {len(seen)} frames", rate=rate)
    clip, lines = read_clip(path, reading)
    clip = replace(clip, person=source.person, category=source.category)
    said = "; ".join(line.removeprefix("note: ") for line in lines)
    return Found(key, clip, kind=KINDS.get(path.suffix.lower(), "AMASS or SMPL"), said=said, rate=clip.frame_rate)


def _readable(every: Iterable[Found], found: list[Found]) -> Iterator[Clip]:
    """The clips that can be read; all that was found is kept without its motion."""
    for one in every:
        if one.clip is not None:
            yield one.clip
        found.append(one if one.clip is None else replace(one, clip=_without_motion(one.clip)))


def _without_motion(clip: Clip) -> Clip:
    return replace(clip, pose=clip.pose[:1])


def _line(one: Found) -> str:
    """What one file holds."""
    if one.rig is None:
        return f"{one.key}: {one.kind}, {one.rate:g} Hz" + (f"; {one.said}" if one.said else "")
    sure = f"confidence {one.rig.confidence:.0%}"
    left_out = (
        f"; of its {one.rig.count} joints {one.rig.count - one.rig.used} are left out"
        if one.rig.used < one.rig.count
        else ""
    )
    return f"{one.key}: {one.rig.line()}; {sure}{left_out}"


def _rigs(found: list[Found]) -> Table:
    """How the files were read: one by one, or, of many, those alike together."""
    from rich import box
    from rich.table import Table

    shown = Table(title="How the files were read", box=box.SIMPLE_HEAD, pad_edge=False)
    names = ("rig", "joints", "unit", "up", "floor", "Hz", "missing")
    alone = len(found) <= LISTED
    for column in ("file" if alone else "files", *names, "confidence"):
        shown.add_column(column, overflow="fold")
    rows: dict[tuple[str, ...], list[Found]] = {}
    for one in found:
        if not one.reason:
            rows.setdefault((one.key,) if alone else _alike(one), []).append(one)
    for alike in rows.values():
        least = [one.rig.confidence for one in alike if one.rig is not None]
        sure = f"{min(least):.0%}" if least else ""
        shown.add_row(alike[0].key if alone else str(len(alike)), *_alike(alike[0]), sure)
    return shown


def _alike(one: Found) -> tuple[str, ...]:
    """What is said of a file but its name and confidence."""
    if one.rig is None:
        return (one.kind, "", "", "", "", f"{one.rate:g}", "")
    rig = one.rig
    unit = rig.unit_name or f"unknown, scaled to {rig.height:.2f} m"
    return (rig.family, str(rig.count), unit, rig.up, f"{-rig.lift:.2f}", f"{rig.frame_rate:g}", ", ".join(rig.lacking))


class _Counts:
    """People, clips and minutes by category."""

    def __init__(self) -> None:
        self._rows: dict[str, Counter[str]] = {}
        self._people: dict[str, set[str]] = {}

    def add(self, clip: Clip) -> None:
        row = self._rows.setdefault(clip.category or "(none)", Counter())
        row.update({"clips": 1, "seconds": clip.seconds, "fingered": clip.seconds * clip.has_fingers})  # type: ignore[dict-item]
        self._people.setdefault(clip.category or "(none)", set()).add(clip.person)

    @property
    def clips(self) -> int:
        return sum(row["clips"] for row in self._rows.values())

    def table(self, title: str) -> Table:
        from rich.table import Table

        shown = Table(title=title)
        for column in ("category", "people", "clips", "minutes", "with fingers"):
            shown.add_column(column, justify="left" if column == "category" else "right")
        for category, row in sorted(self._rows.items()):
            shown.add_row(category, str(len(self._people[category])), *_minutes(row))
        shown.add_section()
        everyone = set().union(*self._people.values()) if self._people else set()
        whole = sum(self._rows.values(), Counter())
        shown.add_row("all", str(len(everyone)), *_minutes(whole))
        return shown

    def numbers(self) -> dict[str, float]:
        everyone = set().union(*self._people.values()) if self._people else set()
        found: dict[str, float] = {"clips": self.clips, "people": len(everyone)}
        found["minutes"] = sum(row["seconds"] for row in self._rows.values()) / 60
        for category, row in self._rows.items():
            found |= {f"{category}_clips": row["clips"], f"{category}_minutes": row["seconds"] / 60}
        return found


def _minutes(row: Counter[str]) -> tuple[str, str, str]:
    return str(row["clips"]), f"{row['seconds'] / 60:.1f}", f"{row['fingered'] / 60:.1f}"


def _draw(path: Path, clip: Clip) -> None:
    """Stick figures of a few frames."""
    import numpy as np

    from bodysense.body.pose import forward_kinematics
    from bodysense.export.picture import draw_sheet

    frames = np.unique(np.linspace(0, len(clip) - 1, PICTURED).astype(int))
    draw_sheet(path, clip.pose.skeleton, np.asarray(forward_kinematics(clip.pose[frames])[0]))
    print(f"wrote {path}")


def _none_of(place: Path, skipped: list[Found]) -> str:
    return f"{place}: none of its {len(skipped)} files can be read; the first: {skipped[0].reason}"
