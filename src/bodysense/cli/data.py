"""`bodysense data`: descriptions of motion files (`info`), tables of joints, and the list of public data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.extras import SubcommandApp

from bodysense.cli.found_files import (
    FoundFile,
    Split,
    description_of,
    files_in,
    no_readable_file,
    readable_clips,
    table_of,
)
from bodysense.cli.options import Reading
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.io.datasets.layouts import Layout
from bodysense.io.datasets.reasons import lines_by_kind
from bodysense.io.reading_options import AS_FOUND

if TYPE_CHECKING:
    from rich.table import Table

    from bodysense.io.clip import Clip


PICTURED = 6  # number of frames in a picture


def info(
    place: Annotated[Path, tyro.conf.Positional],
    split: Split = "all",
    layout: Layout | None = None,
    picture: Path | None = None,
    json: Path | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Describe a motion file or a folder of them, and how each file was read.

    For each file: rig, unit, upward axis, floor, frame rate, missing joints, and confidence. Files that cannot be read
    are skipped, counted and listed with the reason.

    Args:
        place: a motion file (.bvh, .fbx, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma), markers (.c3d, .trc, .tsv,
            .csv), a recording, or a folder of them, also .bvh in .zip.
        split: people of this split.
        layout: published data set of the folder; recognised by its content if omitted.
        picture: PNG file for bodies of a few frames of the first readable file.
        json: JSON file for the numbers, one flat object.
        reading: facts that the files omit.
    """
    from bodysense.files import check_picture

    if picture is not None:
        check_picture(picture)
    print_info(place, split, *files_in(place, split, layout, reading), picture, json)


def print_info(
    place: Path, split: Split, total: int, every: Iterable[FoundFile], picture: Path | None, json: Path | None
) -> None:
    """Print a description of `total` files; write the numbers and a picture of the first file."""
    from rich.progress import track

    from bodysense.cli.show import wide_console, write_numbers

    found, counts = list[FoundFile](), _Counts()
    for clip in readable_clips(track(every, "reading", total) if total > 1 else every, found):
        counts.add(clip)
        if picture is not None and counts.clips == 1:
            _draw(picture, clip)
    if total == 1:
        print(*(description_of(one) for one in found if not one.reason), end="" if found[0].reason else "\n")
    else:
        console = wide_console()
        console.print(table_of(found))
        console.print(counts.table(f"{place} ({split})"))
    write_numbers(json, counts.numbers() | {"skipped": print_skipped(place, total, found)})


def print_skipped(place: Path, total: int, found: list[FoundFile]) -> int:
    """Print the files that cannot be read and return their number. Raises BodysenseError if no file can be read."""
    skipped = [one for one in found if one.reason]
    if len(skipped) == len(found):
        raise BodysenseError(skipped[0].reason if total == 1 else no_readable_file(place, skipped))
    print(*lines_by_kind((one.key, one.reason) for one in skipped), sep="\n", end="\n" if skipped else "")
    if skipped:
        print(f"skipped {len(skipped)} of {len(found)} files")
    return len(skipped)


def joints(
    file: Annotated[Path, tyro.conf.Positional],
    out: Annotated[Path | None, tyro.conf.arg(aliases=("-o",))] = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Draft the table for --joints: every joint of a BVH, FBX or glTF file, and the joint of ours that it matches.

    If no body is recognised, joints are matched by their names alone.

    Args:
        file: .bvh, .fbx, .glb or .gltf file.
        out: .json file; printed if omitted.
        reading: facts that the file omits.
    """
    from bodysense.io.formats.archive import MotionFile
    from bodysense.io.formats.gltf.motion import figure_of_gltf
    from bodysense.io.rigged import figure_of_file
    from bodysense.io.rigs.names import joints_of
    from bodysense.io.rigs.rig import joint_map_text, recognise

    if out is not None and out.suffix.lower() != ".json":
        raise BodysenseError(f"-o {out}: the table for --joints is JSON; give a name that ends in .json")
    ending = file.suffix.lower()
    if ending in (".glb", ".gltf"):
        figure, reading = figure_of_gltf(file, reading.animation), replace(reading, up="y", floor=0.0)
    elif ending in (".bvh", ".fbx"):
        figure = figure_of_file(MotionFile(file).read(), file, reading)
    else:
        raise BodysenseError(f"{file}: joints are named in .bvh, .fbx, .glb and .gltf files only; give one")
    try:
        rig = recognise(figure, reading)
        given, note = dict(rig.joints), f"; {rig.line()}"
    except BodysenseError as error:
        given = {ours: name for name, ours in joints_of(figure.points).items()}
        note = f", by their names alone: {error}; name the others by hand"
    if out is None:
        print(joint_map_text(figure.points, given), end="")
        return
    with written_beside(out) as beside:
        beside.write_text(joint_map_text(figure.points, given), encoding="utf-8")
    print(f"wrote {out}: {len(given)} of {len(figure.points)} joints and end sites named{note}")


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

    @property
    def _people_count(self) -> int:
        return len(set[str]().union(*self._people.values()))

    def table(self, title: str) -> Table:
        from rich.table import Table

        table = Table(title=title)
        for column in ("category", "people", "clips", "minutes", "with fingers"):
            table.add_column(column, justify="left" if column == "category" else "right")
        for category, row in sorted(self._rows.items()):
            table.add_row(category, str(len(self._people[category])), *_minutes(row))
        table.add_section()
        whole = sum(self._rows.values(), Counter())
        table.add_row("all", str(self._people_count), *_minutes(whole))
        return table

    def numbers(self) -> dict[str, float]:
        found: dict[str, float] = {"clips": self.clips, "people": self._people_count}
        found["minutes"] = sum(row["seconds"] for row in self._rows.values()) / 60
        for category, row in self._rows.items():
            found |= {f"{category}_clips": row["clips"], f"{category}_minutes": row["seconds"] / 60}
        return found


def _minutes(row: Counter[str]) -> tuple[str, str, str]:
    return str(row["clips"]), f"{row['seconds'] / 60:.1f}", f"{row['fingered'] / 60:.1f}"


def _draw(path: Path, clip: Clip) -> None:
    """Draw a sheet of bodies in a few frames of a clip."""
    import numpy as np

    from bodysense.pictures.sheet import draw_sheet

    frames = np.unique(np.linspace(0, len(clip) - 1, PICTURED).astype(int))
    draw_sheet(path, clip.pose[frames])
    print(f"wrote {path}")


def commands() -> SubcommandApp:
    """Return the commands of the group."""
    group = SubcommandApp()
    for command in (info, joints, sources):
        group.command(command)
    return group


def sources() -> None:
    """List public motion data that bodysense reads, with licences and download pages."""
    from rich.console import Console
    from rich.table import Table

    from bodysense.io.datasets.catalogue import CATALOGUE

    table = Table(title="Motion data that bodysense reads")
    for column in ("name", "what", "format", "fingers", "licence", "where", "tables"):
        table.add_column(column)
    for entry in CATALOGUE:
        table.add_row(entry.name, entry.what, entry.format, entry.fingers, entry.licence, entry.where, entry.tables)
    Console().print(table)
    print("The figures of the documentation are of CMU and Rocketbox; none is of another set.")
