"""Clips of a folder or a store that a list chooses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.sources import list_sources, read_source
from bodysense.io.datasets.splits import Split
from bodysense_lab.core.options import SplitReader
from bodysense_lab.core.progress import with_progress_log
from bodysense_lab.data.clips import clips_of, spread_evenly
from bodysense_lab.data.store import is_store, read_store
from bodysense_lab.papers.hmd_vae.options import VaeRun
from bodysense_lab.papers.hmd_vae.split_list import read_split_file


def vae_clips_of(run: VaeRun) -> SplitReader:
    """Return the reader of the motion that a run learns from: split by person, or by its list."""
    if run.split_file is None:
        return clips_of(run)
    listing = run.split_file

    def read(split: Split) -> Iterator[Clip]:
        total = sum(which == split for which in read_split_file(listing).values())
        clips = listed_clips(run.data, split, listing, run.limit)
        return with_progress_log(clips, f"reading the {split} split", min(total, run.limit or total))

    return read


def listed_clips(directory: Path, split: Split, split_file: Path, limit: int | None = None) -> Iterator[Clip]:
    """Yield the clips of a folder or store that a list puts into a split; `limit` is their number for a trial."""
    listed = read_split_file(split_file)
    if is_store(directory):
        store = read_store(directory)
        known = {row.source: index for index, row in enumerate(store.table.clips)}
        clip_at = {key: (lambda index=index: store.clip(index)) for key, index in known.items()}
    else:
        sources = {source.key(Path(directory)): source for source in list_sources(directory)}
        clip_at = {key: (lambda source=source: read_source(source)) for key, source in sources.items()}
    unknown = [key for key in listed if key not in clip_at]
    if unknown:
        raise BodysenseError(
            f"{split_file}: {len(unknown)} of {len(listed)} motions are not in {directory}, {unknown[0]!r} for one; "
            "give the folder to which the paths in the list are relative"
        )
    chosen = [key for key, which in listed.items() if which == split]
    if not chosen:
        raise BodysenseError(f"{split_file}: no line of it ends in {split!r}; each is 'PATH train' or 'PATH test'")
    yield from (clip_at[key]() for key in spread_evenly(chosen, limit))
