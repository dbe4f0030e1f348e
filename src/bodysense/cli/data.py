"""`bodysense data`: what motion there is, and preparing it for training."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.extras import SubcommandApp

from bodysense.cli.render import render
from bodysense.data.layouts import Layout
from bodysense.occlusion.headset_camera import HeadsetCamera

if TYPE_CHECKING:
    from rich.table import Table

    from bodysense.data.clip import Clip

Folder = Annotated[Path, tyro.conf.Positional]


def commands() -> SubcommandApp:
    """The group's commands."""
    group = SubcommandApp()
    for command in (info, prepare, sources, render):
        group.command(command)
    return group


def info(
    directory: Folder,
    occlusion: bool = False,
    split: Literal["train", "val", "test", "all"] = "all",
    layout: Layout | None = None,
    camera: HeadsetCamera = HeadsetCamera(),
    json: Path | None = None,
) -> None:
    """Say what motion a folder or a prepared store holds; with --occlusion, what a headset would see of it.

    Args:
        directory: A folder of .bvh and AMASS .npz files, also .bvh in .zip, or a store written by
            `bodysense data prepare`.
        occlusion: Simulate the headset's cameras and print the statistics of UNOC, Table 1, beside the published ones.
        split: Which people.
        layout: Of which published data set the folder is; recognised by what is in it if not given.
        camera: Of the headset, for --occlusion.
        json: Write the numbers here, as one flat object.
    """
    from rich.console import Console
    from rich.progress import track
    from rich.table import Table

    from bodysense.cli.show import write_numbers
    from bodysense.data.clips import open_clips

    clips = open_clips(directory, split, layout=layout)
    if occlusion:
        shown, numbers = occlusion_table(track(clips, description="looking through the headset"), camera)
        Console().print(shown)
        write_numbers(json, numbers)
        return
    counts: dict[str, list[float]] = {}
    people: dict[str, set[str]] = {}
    for clip in track(clips, description="reading"):
        row = counts.setdefault(clip.category or "(none)", [0, 0, 0])
        row[0] += 1
        row[1] += clip.seconds / 60
        row[2] += clip.seconds / 60 * clip.has_fingers
        people.setdefault(clip.category or "(none)", set()).add(clip.person)
    shown = Table(title=f"{directory} ({split})")
    for column in ("category", "people", "clips", "minutes", "with fingers"):
        shown.add_column(column, justify="left" if column == "category" else "right")
    numbers = {}
    for category, (clip_count, minutes, fingers) in sorted(counts.items()):
        shown.add_row(category, str(len(people[category])), f"{clip_count:.0f}", f"{minutes:.1f}", f"{fingers:.1f}")
        numbers |= {f"{category}_clips": clip_count, f"{category}_minutes": minutes}
    total = [sum(row[k] for row in counts.values()) for k in range(3)]
    everyone = set().union(*people.values())
    shown.add_section()
    shown.add_row("all", str(len(everyone)), f"{total[0]:.0f}", f"{total[1]:.1f}", f"{total[2]:.1f}")
    Console().print(shown)
    write_numbers(json, {"clips": total[0], "minutes": total[1], "people": len(everyone), **numbers})


def occlusion_table(clips: Iterable[Clip], camera: HeadsetCamera = HeadsetCamera()) -> tuple[Table, dict[str, float]]:
    """UNOC, Table 1: a column a category, then all, then the published ones; and the numbers of ours."""
    from rich.table import Table

    from bodysense.evaluation.occlusion_table import columns_of, count_clips, numbers_of
    from bodysense.occlusion import statistics

    ours = columns_of(count_clips(clips, 1, lambda clip: None, camera)[0])
    header, rows = statistics.table([*ours, *statistics.PUBLISHED])
    shown = Table(title="Occlusion and contact (UNOC, Table 1; the last columns are published)")
    for name in header:
        shown.add_column(name, justify="left" if name == header[0] else "right")
    for row in rows:
        shown.add_row(*row)
    return shown, numbers_of(ours)


def prepare(
    directory: Folder,
    out: Annotated[Path, tyro.conf.arg(aliases=("-o",))],
    rate: float = 30.0,
    workers: int | None = None,
    scheduler: str | None = None,
    layout: Layout | None = None,
) -> None:
    """Turn a folder of motion files into a chunked Zarr store, in parallel; run it again to go on after a stop.

    Args:
        directory: A folder of .bvh and AMASS .npz files, also .bvh in .zip.
        out: The store.
        rate: Frames a second of the store.
        workers: Processes on this machine; all processors by default.
        scheduler: Address of a Dask scheduler to run on instead of this machine, like tcp://host:8786.
        layout: Of which published data set the folder is; recognised by what is in it if not given.
    """
    from bodysense.data.store import prepare as prepare_store

    prepare_store(directory, out, rate=rate, workers=workers, scheduler=scheduler, layout=layout)


def sources() -> None:
    """List public motion data that bodysense reads, with licence and where to get it."""
    from rich.console import Console
    from rich.table import Table

    from bodysense.data.catalogue import CATALOGUE

    shown = Table(title="Motion data that bodysense reads")
    for column in ("name", "what", "format", "fingers", "licence", "where", "tables"):
        shown.add_column(column)
    for entry in CATALOGUE:
        shown.add_row(entry.name, entry.what, entry.format, entry.fingers, entry.licence, entry.where, entry.tables)
    Console().print(shown)
