"""Preparation of a store: motion files are read in parallel, and their clips are appended to one Zarr group.

The store is built in `<store>.part` and renamed when it is complete. A stopped run resumes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.layouts import Layout
from bodysense.io.datasets.reasons import lines_by_kind
from bodysense.io.datasets.sources import Source, list_sources, read_source
from bodysense.io.formats.body_model import read_model
from bodysense.io.placement import BodyPlacement, Footing, body_in_file, footing_of, placement_of
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.io.resample import resample
from bodysense.parallel import parallel_map
from bodysense_lab.data.bodies import body_lines, pool_footings
from bodysense_lab.data.store import (
    ARRAYS,
    FORMAT,
    Skipped,
    Store,
    StoredClip,
    Table,
    is_store,
    read_store,
    read_table,
    zarr_package,
)

CHUNK = 512  # frames that are compressed together; a random window reads one or two chunks
BATCH = 64  # clips between two saves of the table; a killed run loses at most these


def prepare(
    directory: str | Path,
    store_path: str | Path,
    rate: float = 30.0,
    workers: int | None = None,
    scheduler: str | None = None,
    layout: Layout | None = None,
    options: ReadingOptions = AS_FOUND,
    sources: Sequence[Source] | None = None,
) -> Store:
    """Turn a folder of motion files into a store, in parallel, and print the skipped files with the reasons.

    A stopped run resumes when it is started again. A finished store is not changed.

    Args:
        directory: folder of motion files.
        store_path: store to write.
        rate: frame rate of the store, Hz.
        workers: processes on this machine; one for each processor if None; 1: this process only.
        scheduler: address of a Dask scheduler ('tcp://host:8786') whose cluster does the work instead. It must see
            the same folders.
        layout: published data set that the folder is (`io.datasets.layouts`); recognised if None.
        options: properties that the files do not contain.
        sources: the folder's files; listed if None.

    Raises BodysenseError if the folder contains no motion, if no file of it can be read, and if `store_path` was
    made from other files, with other options or at another rate.
    """
    directory, store_path = Path(directory), Path(store_path)
    if options.smpl_model is not None and not options.smpl_model.is_dir():
        read_model(options.smpl_model)  # a wrong file is reported once, not as unreadable motions
    listed = {source.key(directory): source for source in sources or list_sources(directory, layout)}
    if is_store(store_path):
        store = read_store(store_path)
        _check_reading_options(store_path, options)
        _check_same_files(store_path, store.table, rate, listed, whole=True)
        return store
    if store_path.exists():
        raise BodysenseError(f"{store_path} exists and is not a store; give another place or remove it")
    part = store_path.with_name(f"{store_path.name}.part")
    group = _open_part(part, rate, options)
    _check_reading_options(part, options)
    table = read_table(group)
    _check_same_files(part, table, rate, listed, whole=False)
    if scheduler is not None:  # workers may run in another folder, so they need absolute paths
        listed = {key: replace(source, path=source.path.resolve()) for key, source in listed.items()}
        files = {name: value.resolve() for name, value in vars(options).items() if isinstance(value, Path)}
        options = replace(options, **files)
    done = {row.source for row in (*table.clips, *table.skipped)}
    todo = {key: source for key, source in listed.items() if key not in done}
    table = replace(table, bodies=_find_bodies(group, listed, workers, scheduler, options))
    todo = {key: replace(source, placement=table.bodies.get(source.person)) for key, source in todo.items()}

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns) as progress:
        task = progress.add_task(f"preparing {directory.name}", total=len(listed), completed=len(done))
        for batch in _prepare_batches(todo, rate, workers, scheduler, options):
            table = _append(group, table, batch)
            progress.advance(task, len(batch))
    if not table.clips:
        reason = table.skipped[0].reason
        raise BodysenseError(f"{directory}: none of its {len(listed)} files can be read; the first: {reason}")
    _publish(group, table, part, store_path)
    for line in (*body_lines(table.bodies), *lines_by_kind((row.source, row.reason) for row in table.skipped)):
        Console().print(line, markup=False, soft_wrap=True)
    return read_store(store_path)


def _open_part(part: Path, rate: float, options: ReadingOptions) -> Any:
    """Open the unfinished store; create it if it does not exist."""
    zarr = zarr_package()
    if not (np.isfinite(rate) and rate > 0):
        raise BodysenseError(f"frame rate {rate:g} Hz is not possible; give a positive number, e.g. 30")
    ours = default_skeleton()
    about = {"format": FORMAT, "rate": rate, "joints": ours.joints, "end_sites": ours.end_sites}
    about["reading"] = _stored_options(options)
    try:
        if not is_store(part):
            zarr.create_group(part, zarr_format=3, attributes={**about, "clips": [], "skipped": []})
        group = zarr.open_group(part, mode="r+")
        if group.attrs.get("format") != FORMAT:
            raise BodysenseError(f"{part} was not begun by this version; remove it and run again")
        for key, tail in ARRAYS.items():
            if key not in group:
                group.create_array(key, shape=(0, *tail), chunks=(CHUNK, *tail), dtype="float32")
    except (ValueError, OSError) as error:
        raise BodysenseError(f"{part}: cannot be written ({error}); choose another place, or remove it") from None
    return group


def _stored_options(options: ReadingOptions) -> dict[str, str]:
    """Return the reading options as a store saves them."""
    return {name: str(value) for name, value in asdict(options).items() if value not in (None, False)}


def _check_reading_options(path: Path, options: ReadingOptions) -> None:
    """Raise BodysenseError unless a store was made with these options."""
    before = zarr_package().open_group(path, mode="r").attrs.get("reading", {})
    if before != _stored_options(options):
        before_text = " ".join(f"--{name.replace('_', '-')} {value}" for name, value in before.items()) or "none"
        raise BodysenseError(f"{path} was made with other options ({before_text}); give another place or remove it")


def _check_same_files(path: Path, table: Table, rate: float, sources: Mapping[str, Source], whole: bool) -> None:
    """Raise BodysenseError unless a store was made from these files, at this rate; `whole`: from all of them."""
    if table.rate != rate:
        raise BodysenseError(f"{path} is at {table.rate:g} Hz, not {rate:g}; give another place or remove it")
    rows = [*table.clips, *table.skipped]
    for row in rows:
        if row.source not in sources or (not whole and sources[row.source].file.sha256() != row.sha256):
            raise BodysenseError(
                f"{path} was made from another version of {row.source}; give another place or remove it"
            )
    if whole and len(rows) != len(sources):
        raise BodysenseError(
            f"{path} was made from {len(rows)} files, but there are {len(sources)} now; give another place or remove it"
        )


def _find_bodies(
    group: Any,
    sources: Mapping[str, Source],
    workers: int | None,
    scheduler: str | None,
    options: ReadingOptions,
) -> dict[str, BodyPlacement]:
    """Return height and floor of every person in AMASS files without a known skeleton, and save them in the store."""
    if "bodies" not in group.attrs:
        npz_sources = [
            one for one in sources.values() if one.skeleton is None and one.file.place.suffix.lower() == ".npz"
        ]
        parts: dict[str, list[Footing]] = {}
        count = _processes(workers) if npz_sources else 1
        for source, footing in parallel_map(partial(_footing, model=options.smpl_model), npz_sources, count, scheduler):
            if footing is not None:
                parts.setdefault(source.person, []).append(footing)
        has_bones = options.smpl_model is not None
        found = {person: placement_of(pool_footings(ones), has_bones) for person, ones in parts.items()}
        group.attrs["bodies"] = {person: asdict(one) for person, one in found.items()}
    return dict(read_table(group).bodies)


def _footing(source: Source, model: Path | None) -> Footing | None:
    """Return a motion's footing; None if it cannot be read. `_prepare_source` reports the reason."""
    try:
        return footing_of(body_in_file(source.path, model))
    except BodysenseError:
        return None


def _prepare_source(item: tuple[str, Source], rate: float, options: ReadingOptions) -> tuple[Clip | str, str]:
    """Return the clip of a source at `rate`, or the reason why it cannot be read, and its file's hash."""
    _, source = item
    sha256 = source.file.sha256()
    try:
        clip = resample(read_source(source, options), rate)
    except BodysenseError as error:
        return str(error), sha256
    pose = clip.pose
    small = Pose(pose.skeleton, pose.root_position.astype(np.float32), pose.rotation.astype(np.float32))
    return replace(clip, pose=small), sha256


def _prepare_batches(
    sources: Mapping[str, Source], rate: float, workers: int | None, scheduler: str | None, options: ReadingOptions
) -> Iterator[list[tuple[str, Source, Clip | str, str]]]:
    """Yield the results of `_prepare_source`: batches of (key, source, clip or reason, hash)."""
    results = parallel_map(
        partial(_prepare_source, rate=rate, options=options), sources.items(), _processes(workers), scheduler
    )
    while batch := [(*item, *result) for item, result in islice(results, BATCH)]:
        yield batch


def _processes(workers: int | None) -> int:
    """Return the number of processes; one for each processor if None."""
    workers = os.cpu_count() or 1 if workers is None else workers
    if workers < 1:
        raise BodysenseError(f"{workers} workers are not possible; give at least 1")
    return workers


def _append(group: Any, table: Table, batch: Sequence[tuple[str, Source, Clip | str, str]]) -> Table:
    """Append a batch of arrays, then update the table; rows without an entry in the table are overwritten later."""
    clips, skipped, new = list(table.clips), list(table.skipped), []
    start = table.frames
    for key, source, clip, sha256 in batch:
        if isinstance(clip, str):
            skipped.append(Skipped(key, sha256, clip))
            continue
        clips.append(
            StoredClip(
                name=clip.name,
                source=key,
                sha256=sha256,
                start=start,
                length=len(clip),
                person=source.person,
                split=source.split,
                category=source.category,
                has_fingers=clip.has_fingers,
            )
        )
        start += len(clip)
        new.append(clip)
    if new:
        for key, known, values in (
            ("rotation", table.frames, np.concatenate([clip.pose.rotation for clip in new])),
            ("root_position", table.frames, np.concatenate([clip.pose.root_position for clip in new])),
            ("rest_offset", len(table.clips), np.stack([clip.pose.skeleton.rest_offset for clip in new])),
        ):
            group[key].resize((known + len(values), *values.shape[1:]))
            group[key][known:] = values
    group.attrs.update({"clips": [asdict(row) for row in clips], "skipped": [asdict(row) for row in skipped]})
    return replace(table, clips=tuple(clips), skipped=tuple(skipped))


def _publish(group: Any, table: Table, part: Path, store_path: Path) -> None:
    """Mark a store as complete and rename it."""
    counts = {"rotation": table.frames, "root_position": table.frames, "rest_offset": len(table.clips)}
    for key, count in counts.items():
        group[key].resize((count, *group[key].shape[1:]))  # a killed run may have written more rows than its table has
    group.attrs["complete"] = True
    os.replace(part, store_path)
