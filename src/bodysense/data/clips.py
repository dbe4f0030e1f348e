"""The clips of a place, whether it is a folder of motion files or a prepared store."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

from bodysense.data.clip import Clip
from bodysense.data.sources import list_sources, read_source
from bodysense.data.splits import SPLITS, Split
from bodysense.data.store import read_store
from bodysense.errors import BodysenseError


def open_clips(
    directory: str | Path,
    split: Split | Literal["all"] = "all",
    categories: Collection[str] | None = None,
) -> Iterator[Clip]:
    """The clips of a folder or a store one after the other, in canonical form, at their own frame rates.

    `categories` None takes all. Raises BodysenseError where nothing is left, and for the first file that cannot be
    read (`prepare` skips such files and says why).
    """
    if split != "all" and split not in SPLITS:
        raise BodysenseError(f"unknown split {split!r}; valid are {', '.join(SPLITS)} and all")
    rows: Sequence[Any]
    if (Path(directory) / "zarr.json").is_file():
        store = read_store(directory)
        rows, clip_at = store.table.clips, store.clip
    else:
        sources = list_sources(directory)
        rows, clip_at = sources, lambda index: read_source(sources[index])
    chosen = [
        index
        for index, row in enumerate(rows)
        if split in ("all", row.split) and (categories is None or row.category in categories)
    ]
    if not chosen:
        known = ", ".join(sorted({row.category for row in rows if row.category})) or "none"
        raise BodysenseError(
            f"{directory}: none of its {len(rows)} clips is of split {split!r}"
            + ("" if categories is None else f" and of {', '.join(categories)}; its categories are {known}")
        )
    return map(clip_at, chosen)
