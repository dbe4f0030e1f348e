"""`bodysense data`: what motion there is, and preparing it for training."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from tyro.extras import SubcommandApp

from bodysense.cli.data_info import info, joints
from bodysense.cli.options import Reading
from bodysense.cli.render import render
from bodysense.data.layouts import Layout
from bodysense.rigs.options import AS_FOUND

Folder = Annotated[Path, tyro.conf.Positional]


def commands() -> SubcommandApp:
    """The group's commands."""
    group = SubcommandApp()
    for command in (info, joints, prepare, sources, render):
        group.command(command)
    return group


def prepare(
    directory: Folder,
    out: Annotated[Path, tyro.conf.arg(aliases=("-o",))],
    rate: float = 30.0,
    workers: int | None = None,
    scheduler: str | None = None,
    layout: Layout | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Turn a folder of motion files into a chunked Zarr store, in parallel; run it again to go on after a stop.

    Args:
        directory: A folder of .bvh and AMASS .npz files, also .bvh in .zip.
        out: The store.
        rate: Frames a second of the store.
        workers: Processes on this machine; all processors by default.
        scheduler: Address of a Dask scheduler to run on instead of this machine, like tcp://host:8786.
        layout: Of which published data set the folder is; recognised by what is in it if not given.
        reading: What the files do not say of themselves.
    """
    from bodysense.lab.store import prepare as prepare_store

    prepare_store(directory, out, rate=rate, workers=workers, scheduler=scheduler, layout=layout, options=reading)


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
