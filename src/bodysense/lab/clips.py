"""The clips of a place, whether it is a folder of motion files or a prepared store."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.layouts import Layout
from bodysense.io.datasets.sources import Source, list_sources, read_source
from bodysense.io.datasets.splits import SPLITS, Split, empty_split
from bodysense.io.rigs.options import AS_FOUND, ReadingOptions
from bodysense.lab.store import read_store

OPTIONS = tuple(field.name for field in fields(ReadingOptions))


def open_clips(
    directory: str | Path,
    split: Split | Literal["all"] = "all",
    categories: Collection[str] | None = None,
    layout: Layout | None = None,
    at_most: int | None = None,
    options: ReadingOptions = AS_FOUND,
) -> Iterator[Clip]:
    """The clips of a folder or a store one after the other, in canonical form, at their own frame rates.

    `categories` None takes all; `layout` None recognises a folder's (`io.datasets.layouts`); `at_most` takes so many,
    spread evenly; `options` say what motion files do not. Raises BodysenseError where nothing is left, and for the
    first file that cannot be read (`prepare` skips such files and says why).
    """
    chosen, clip_at = _choose(directory, split, categories, layout, options)
    if at_most is not None and at_most < len(chosen):
        chosen = [chosen[(2 * k + 1) * len(chosen) // (2 * at_most)] for k in range(at_most)]
    return map(clip_at, chosen)


def count_clips(directory: str | Path, split: Split | Literal["all"] = "all") -> int:
    """How many clips `open_clips` gives. Raises as it does."""
    return len(_choose(directory, split, None, None, AS_FOUND)[0])


def _choose(
    directory: str | Path,
    split: Split | Literal["all"],
    categories: Collection[str] | None,
    layout: Layout | None,
    options: ReadingOptions,
) -> tuple[list[int], Callable[[int], Clip]]:
    """Places of the clips asked for, and what reads the clip at a place."""
    if split != "all" and split not in SPLITS:
        raise BodysenseError(f"unknown split {split!r}; valid are {', '.join(SPLITS)} and all")
    rows: Sequence[Any]
    if (Path(directory) / "zarr.json").is_file():
        if options != AS_FOUND:
            raise BodysenseError(f"{directory}: a store was read when it was prepared; tell data prepare")
        store = read_store(directory)
        rows, clip_at = store.table.clips, store.clip
    else:
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
            f"{directory}: none of its {len(rows)} clips is of split {split!r} and of {', '.join(categories)}; "
            f"its categories are {known}"
        )
    return chosen, clip_at


def _read(source: Source, options: ReadingOptions, directory: str | Path) -> Clip:
    """A clip of a folder. Not every command that reads folders has the options that its error may ask for."""
    try:
        return read_source(source, options)
    except BodysenseError as error:
        asked = next((name for name in OPTIONS if f"--{name}" in str(error)), None)
        if asked is None:
            raise
        raise BodysenseError(
            f"{error}; where a command has no --{asked}, give it the store that `bodysense data prepare {directory} "
            f"-o STORE.zarr --{asked} …` writes"
        ) from None
