"""`bodysense data prepare`: motion files as a store that trainings read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from bodysense.cli.options import Reading
from bodysense.data.layouts import Layout
from bodysense.lab.options import Output
from bodysense.rigs.options import AS_FOUND

Folder = Annotated[Path, tyro.conf.Positional]


def prepare(
    directory: Folder,
    out: Output,
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
