"""Clips of a folder of motion files or of a prepared store."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import fields
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.layouts import Layout
from bodysense.io.datasets.splits import SPLITS, Split, empty_split
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense_lab.core.options import MotionRun, SplitReader
from bodysense_lab.core.progress import with_progress_log
from bodysense_lab.data.store import read_store

if TYPE_CHECKING:
    from bodysense.io.datasets.sources import Source

Item = TypeVar("Item")
FINGER_SEARCH_CLIPS = 64  # clips in which more clips with fingers are searched for
READING_OPTIONS = tuple(field.name.replace("_", "-") for field in fields(ReadingOptions))


def open_clips(
    directory: str | Path,
    split: Split | Literal["all"] = "all",
    categories: Collection[str] | None = None,
    layout: Layout | None = None,
    at_most: int | None = None,
    options: ReadingOptions = AS_FOUND,
) -> Iterator[Clip]:
    """Return an iterator over the clips of a folder or a store, in canonical form, at their own frame rates.

    Args:
        directory: folder of motion files or prepared store.
        split: split to read.
        categories: categories to read; all if None.
        layout: published data set that the folder is (`io.datasets.layouts`); recognised if None.
        at_most: maximum number of clips, spread evenly over all; all if None.
        options: properties that motion files do not contain.

    Raises BodysenseError if no clip is selected, and for the first file that cannot be read. (`prepare` skips such
    files and prints the reason.)
    """
    chosen, clip_at = _select_clips(directory, split, categories, layout, options)
    return map(clip_at, spread_evenly(chosen, at_most))


def spread_evenly(items: Sequence[Item], at_most: int | None) -> Sequence[Item]:
    """Return at most `at_most` items, spread evenly over all; all if None."""
    if at_most is None or at_most >= len(items):
        return items
    return [items[(2 * k + 1) * len(items) // (2 * at_most)] for k in range(at_most)]


def training_clips(directory: str | Path, split: Split, limit: int | None = None) -> Iterator[Clip]:
    """Return the clips of a split that a training reads: all, or `limit` of them for a trial.

    Clips of a trial are spread evenly. Half of them have fingers if enough are found, because clips with fingers are
    rare. Errors: see `open_clips`.
    """
    if limit is None:
        return open_clips(directory, split)
    first = list(open_clips(directory, split, at_most=limit))
    plain = [clip for clip in first if not clip.has_fingers]
    known = {(clip.person, clip.name) for clip in first}
    lacking = (limit + 1) // 2 - (len(first) - len(plain))
    if lacking <= 0 or not plain:
        return iter(first)
    others = open_clips(directory, split, at_most=FINGER_SEARCH_CLIPS)
    fingers = (clip for clip in others if clip.has_fingers and (clip.person, clip.name) not in known)
    more = list(islice(fingers, lacking))
    dropped = {id(clip) for clip in plain[len(plain) - len(more) :]}
    return iter([clip for clip in first if id(clip) not in dropped] + more)


def read_clips(directory: Path, split: Split, limit: int | None = None) -> Iterator[Clip]:
    """Return the clips of a split that a training reads; display progress over them. Errors: see `training_clips`."""
    total = count_training_clips(directory, split, limit)
    return with_progress_log(training_clips(directory, split, limit), f"reading the {split} split", total)


def clips_of(run: MotionRun) -> SplitReader:
    """Return the reader of the motion that a run learns from."""
    return partial(read_clips, run.data, limit=run.limit)


def count_training_clips(directory: str | Path, split: Split, limit: int | None = None) -> int:
    """Return the maximum number of clips of `training_clips`. Errors: see `open_clips`."""
    total = count_clips(directory, split)
    return total if limit is None else min(limit, total)


def count_clips(directory: str | Path, split: Split | Literal["all"] = "all") -> int:
    """Return the number of clips of `open_clips`. Errors: see `open_clips`."""
    return len(_select_clips(directory, split, None, None, AS_FOUND)[0])


def _select_clips(
    directory: str | Path,
    split: Split | Literal["all"],
    categories: Collection[str] | None,
    layout: Layout | None,
    options: ReadingOptions,
) -> tuple[list[int], Callable[[int], Clip]]:
    """Return the indices of the selected clips, and a function that reads the clip at an index."""
    if split != "all" and split not in SPLITS:
        raise BodysenseError(f"unknown split {split!r}; valid are {', '.join(SPLITS)} and all")
    rows: Sequence[Any]
    if (Path(directory) / "zarr.json").is_file():
        if options != AS_FOUND:
            raise BodysenseError(f"{directory}: a prepared store needs no reading options; give them to data prepare")
        store = read_store(directory)
        rows, clip_at = store.table.clips, store.clip
    else:
        from bodysense.io.datasets.sources import list_sources

        sources = list_sources(directory, layout)
        rows, clip_at = sources, lambda index: _read(sources[index], options, directory)
    chosen = [
        index
        for index, row in enumerate(rows)
        if split in ("all", row.split) and (categories is None or row.category in categories)
    ]
    if not chosen:
        if categories is None:
            raise BodysenseError(empty_split(str(directory), split, (row.split for row in rows)))
        known = ", ".join(sorted({row.category for row in rows if row.category})) or "none"
        raise BodysenseError(
            f"{directory}: none of its {len(rows)} clips is in split {split!r} and in {', '.join(categories)}; "
            f"its categories are {known}"
        )
    return chosen, clip_at


def _read(source: Source, options: ReadingOptions, directory: str | Path) -> Clip:
    """Read a clip of a folder.

    Some commands that read folders lack the option that an error message suggests. Then the message also names `data
    prepare`, which has it.
    """
    from bodysense.io.datasets.sources import read_source

    try:
        return read_source(source, options)
    except BodysenseError as error:
        option = next((name for name in READING_OPTIONS if f"--{name}" in str(error)), None)
        if option is None:
            raise
        raise BodysenseError(
            f"{error}; if a command has no --{option}, give it the store that `bodysense data prepare {directory} "
            f"-o STORE.zarr --{option} …` writes"
        ) from None
