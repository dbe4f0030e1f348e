"""The motion that a table is made of: a named folder or store, how much of it is used, and what is missing.

The clips of a place, whether it is a folder of motion files or a prepared store.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.catalogue import CATALOGUE, Entry
from bodysense.io.datasets.layouts import Layout
from bodysense.io.datasets.splits import SPLITS, Split, empty_split
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense_lab.spread import spread
from bodysense_lab.store import read_store

if TYPE_CHECKING:
    from bodysense.io.datasets.sources import Source

Item = TypeVar("Item")
OPTIONS = tuple(field.name.replace("_", "-") for field in fields(ReadingOptions))


def open_clips(
    directory: str | Path,
    split: Split | Literal["all"] = "all",
    categories: Collection[str] | None = None,
    layout: Layout | None = None,
    at_most: int | None = None,
    options: ReadingOptions = AS_FOUND,
) -> Iterator[Clip]:
    """The clips of a folder or a store one after the other, in canonical form, at their own frame rates.

    `categories` None takes all; `layout` None recognises a folder's (`io.datasets.layouts`); `at_most` limits them,
    spread evenly; `options` say what motion files do not. Raises BodysenseError where nothing is left, and for the
    first file that cannot be read (`prepare` skips such files and says why).
    """
    chosen, clip_at = _choose(directory, split, categories, layout, options)
    return map(clip_at, spread_evenly(chosen, at_most))


def spread_evenly(items: Sequence[Item], at_most: int | None) -> Sequence[Item]:
    """Return at most `at_most` items, spread evenly over all; None: all."""
    if at_most is None or at_most >= len(items):
        return items
    return [items[(2 * k + 1) * len(items) // (2 * at_most)] for k in range(at_most)]


def learned_clips(directory: str | Path, split: Split, limit: int | None = None) -> Iterator[Clip]:
    """Return the clips of a split that a training reads: all, or `limit` of them for a trial.

    A trial's are spread evenly, and half of them have fingers if there are any, for these are rare. Raises as
    `open_clips` does.
    """
    if limit is None:
        return open_clips(directory, split)
    first = list(open_clips(directory, split, at_most=limit))
    plain = [clip for clip in first if not clip.has_fingers]
    known = {(clip.person, clip.name) for clip in first}
    lacking = (limit + 1) // 2 - (len(first) - len(plain))
    if lacking <= 0 or not plain:
        return iter(first)
    others = open_clips(directory, split, at_most=_LOOKED_THROUGH)
    fingers = (clip for clip in others if clip.has_fingers and (clip.person, clip.name) not in known)
    more = list(islice(fingers, lacking))
    dropped = {id(clip) for clip in plain[len(plain) - len(more) :]}
    return iter([clip for clip in first if id(clip) not in dropped] + more)


def learned_count(directory: str | Path, split: Split, limit: int | None = None) -> int:
    """Return how many clips `learned_clips` gives at most. Raises as it does."""
    total = count_clips(directory, split)
    return total if limit is None else min(limit, total)


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
            f"{directory}: none of its {len(rows)} clips is of split {split!r} and of {', '.join(categories)}; "
            f"its categories are {known}"
        )
    return chosen, clip_at


def _read(source: Source, options: ReadingOptions, directory: str | Path) -> Clip:
    """A clip of a folder. Not every command that reads folders has the options that its error may ask for."""
    from bodysense.io.datasets.sources import read_source

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


QUICK_CLIPS, QUICK_FINGER_CLIPS = 12, 4  # at most; the latter only where the former have too few fingers
QUICK_SECONDS = 6.0
_LOOKED_THROUGH = 64  # clips, for some with fingers


@dataclass(frozen=True)
class DataSet:
    """A folder of motion or a prepared store, under the name by which tables call it."""

    name: str
    path: Path
    split: Split | Literal["all"] = "test"
    quick: bool = False  # only the first seconds of a few clips, spread over all

    def clips(self) -> Iterator[Clip]:
        """Yield its clips, canonical, at their own rates. Raises BodysenseError if there are no clips."""
        if not self.quick:
            yield from open_clips(self.path, self.split)
            return
        first = set()
        fingers = 0
        for clip in open_clips(self.path, self.split, at_most=QUICK_CLIPS):
            first.add((clip.person, clip.name))
            fingers += clip.has_fingers
            yield _beginning(clip)
        if fingers < QUICK_FINGER_CLIPS:  # those with fingers may be few: look through more
            others = open_clips(self.path, self.split, at_most=_LOOKED_THROUGH)
            some = (clip for clip in others if clip.has_fingers and (clip.person, clip.name) not in first)
            yield from map(_beginning, islice(some, QUICK_FINGER_CLIPS - fingers))

    def count(self) -> int:
        """How many clips these are."""
        total = count_clips(self.path, self.split)
        return min(total, QUICK_CLIPS + QUICK_FINGER_CLIPS) if self.quick else total

    @property
    def label(self) -> str:
        """For names of files: what was scored."""
        return f"{self.name}-{self.split}{'-quick' if self.quick else ''}"


@dataclass(frozen=True)
class Census:
    """How much motion was used."""

    clips: int = 0
    people: frozenset[str] = frozenset()
    seconds: float = 0.0
    finger_clips: int = 0
    finger_seconds: float = 0.0

    def __add__(self, other: Census) -> Census:
        return Census(
            self.clips + other.clips,
            self.people | other.people,
            self.seconds + other.seconds,
            self.finger_clips + other.finger_clips,
            self.finger_seconds + other.finger_seconds,
        )

    def numbers(self) -> dict[str, float]:
        """For the flat object."""
        return {"clips": self.clips, "people": len(self.people), "minutes": self.seconds / 60}


def census_of(clip: Clip) -> Census:
    """One clip. A person that is not known is not counted."""
    people = frozenset([clip.person] if clip.person else [])
    fingers = clip.has_fingers
    return Census(1, people, clip.seconds, int(fingers), clip.seconds * fingers)


def gathered(
    work: Callable[[Clip], Mapping[Any, Any]], clips: Iterable[Clip], jobs: int, advance: Callable[[Clip], None]
) -> tuple[dict[Any, Any], Census]:
    """Return the results of `work` on clips, merged by key, and the amount of motion.

    `jobs` processes work; `advance` is called after every clip.
    """
    found: dict[Any, Any] = {}
    census = Census()
    for clip, parts in spread(work, clips, jobs):
        census += census_of(clip)
        for key, part in parts.items():
            if key in found:
                found[key].merge(part)
            else:
                found[key] = part
        advance(clip)
    return found, census


def named_data(text: str, split: Split | Literal["all"] = "test", quick: bool = False) -> DataSet:
    """The data set that 'NAME=FOLDER' or 'FOLDER' says; without a name it has the folder's.

    Raises BodysenseError where there is no such folder; of a name in the catalogue it says where to get the data.
    """
    name, equals, folder = text.partition("=")
    path = Path(folder if equals else text)
    name = name if equals else path.resolve().name
    if not name or "/" in name:
        raise BodysenseError(f"--data {text!r}: no name before the '='; write NAME=FOLDER")
    name = set_name(name)
    if name in (one.name for one in CATALOGUE):
        return DataSet(name, require(name, path), split, quick)
    if not path.is_dir():
        raise BodysenseError(f"{path}: no such folder; give a folder of motion files, or a prepared store")
    return DataSet(name, path, split, quick)


def entry(name: str) -> Entry:
    """Return the collection of that name. Raises BodysenseError with the valid names."""
    for one in CATALOGUE:
        if one.name.lower() == name.lower():
            return one
    raise BodysenseError(f"unknown data set {name!r}; valid are {', '.join(one.name for one in CATALOGUE)}")


def require(name: str, directory: str | Path | None) -> Path:
    """Return the folder or store of a data set that a table needs.

    Raises BodysenseError if no folder is given or it holds no motion. The message says which data set is missing,
    where to get it and under which licence.
    """
    data = entry(name)
    there = "no folder of it is given"
    if directory is not None:
        directory = Path(directory)
        if (directory / "zarr.json").is_file():
            return directory
        from bodysense.io.datasets.sources import list_sources

        try:
            list_sources(directory)
            return directory
        except BodysenseError as error:
            there = str(error).partition(";")[0]
    raise BodysenseError(
        f"the data set {data.name} is missing ({there}); get it at {data.where} (licence: {data.licence}) and give its "
        "folder, or a store made of it by `bodysense data prepare`"
    )


def set_name(text: str) -> str:
    """The name of a data set, as the catalogue spells it if it is there."""
    return next((one.name for one in CATALOGUE if one.name.lower() == text.lower()), text)


def describe(data: DataSet, census: Census) -> str:
    """One sentence on what was used."""
    people = f" of {len(census.people)} people" if census.people else ""
    text = f"{data.name} ({data.path}, {data.split}): {census.clips} clips{people}, {census.seconds / 60:.1f} minutes"
    text += f"; fingers are recorded in {census.finger_clips} of them, {census.finger_seconds / 60:.1f} minutes."
    if data.quick:
        text += f" --quick: all but the first {QUICK_SECONDS:g} s of these clips was left out, and all others."
    return text


def missing(published: Sequence[str], used: Iterable[DataSet]) -> tuple[str, ...]:
    """A sentence for every data set of the published figures that was not used: where to get it, and its licence."""
    names = [data.name for data in used]
    return tuple(
        f"{one.name}, on which figures were published, is missing: ours are of the data above instead. Get it at "
        f"{one.where} (licence: {one.licence}) and give it as --data {one.name}=FOLDER."
        for one in map(entry, published)
        if one.name not in names
    )


def _beginning(clip: Clip) -> Clip:
    return replace(clip, pose=clip.pose[: max(2, round(QUICK_SECONDS * clip.frame_rate))])
