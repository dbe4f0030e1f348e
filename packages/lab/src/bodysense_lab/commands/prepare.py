"""`bodysense data prepare`: training data from motion files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from bodysense.cli.options import Reading, check_rate
from bodysense.errors import BodysenseError
from bodysense.io.datasets.layouts import Layout
from bodysense.io.reading_options import AS_FOUND
from bodysense.ranges import Processes
from bodysense_lab.core.options import Output

Folder = Annotated[Path, tyro.conf.Positional]


def prepare(
    directory: Folder,
    out: Output,
    rate: float = 30.0,
    workers: Processes | None = None,
    scheduler: str | None = None,
    layout: Layout | None = None,
    split_lists: Path | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Turn a folder of motion files into a chunked Zarr store, in parallel; run it again to resume after a stop.

    Args:
        directory: folder of .bvh and AMASS .npz files, also .bvh in .zip.
        out: store to write.
        rate: frame rate of the store, Hz.
        workers: processes on this machine; all processors if omitted.
        scheduler: address of a Dask scheduler to run on instead of this machine, like tcp://host:8786.
        layout: published data set that the folder is; recognised by its files if omitted.
        split_lists: folder data_split of a clone of github.com/eth-siplab/AvatarPoser; only files of AMASS in its lists
            are read, with the published split.
        reading: properties that the files do not contain.
    """
    from bodysense_lab.data.preparation import prepare as prepare_store

    check_rate("--rate", rate)
    sources = None
    if split_lists is not None:
        from bodysense_lab.completion.score.amass_p1 import listed_sources

        if layout is not None:
            raise BodysenseError(f"--layout {layout}: --split-lists is for AMASS; leave one of the two out")
        sources, missing = listed_sources(directory, split_lists)
        print(f"{len(sources)} files of the lists; {missing} are not in {directory}")
    prepare_store(
        directory,
        out,
        rate=rate,
        workers=workers,
        scheduler=scheduler,
        layout=layout,
        options=reading,
        sources=sources,
    )
