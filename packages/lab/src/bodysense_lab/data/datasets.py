"""Data sets of tables: a named folder or store, the amount of motion used, and remarks about missing data sets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Literal

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.catalogue import CATALOGUE, Entry
from bodysense.io.datasets.splits import Split
from bodysense.parallel import parallel_map
from bodysense_lab.data.clips import FINGER_SEARCH_CLIPS, count_clips, open_clips

QUICK_CLIPS = 12  # maximum number of clips with --quick
QUICK_FINGER_CLIPS = 4  # clips with fingers that are added if those have fewer
QUICK_SECONDS = 6.0


@dataclass(frozen=True)
class DataSet:
    """A folder of motion or a prepared store, with its name in tables."""

    name: str
    path: Path
    split: Split | Literal["all"] = "test"
    quick: bool = False  # whether only the first seconds of a few clips are used

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
            yield _first_seconds(clip)
        if fingers < QUICK_FINGER_CLIPS:  # clips with fingers may be rare: search more clips
            others = open_clips(self.path, self.split, at_most=FINGER_SEARCH_CLIPS)
            some = (clip for clip in others if clip.has_fingers and (clip.person, clip.name) not in first)
            yield from map(_first_seconds, islice(some, QUICK_FINGER_CLIPS - fingers))

    def count(self) -> int:
        """Return the number of clips, at most."""
        total = count_clips(self.path, self.split)
        return min(total, QUICK_CLIPS + QUICK_FINGER_CLIPS) if self.quick else total

    @property
    def label(self) -> str:
        """Label for names of files: name, split and whether it is a quick sample."""
        return f"{self.name}-{self.split}{'-quick' if self.quick else ''}"


@dataclass(frozen=True)
class Census:
    """Amount of motion that was used."""

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
        """Return the figures of the flat object."""
        return {"clips": self.clips, "people": len(self.people), "minutes": self.seconds / 60}


def census_of(clip: Clip) -> Census:
    """Return the census of one clip; an unknown person is not counted."""
    people = frozenset([clip.person] if clip.person else [])
    fingers = clip.has_fingers
    return Census(1, people, clip.seconds, int(fingers), clip.seconds * fingers)


def gather_results(
    work: Callable[[Clip], Mapping[Any, Any]], clips: Iterable[Clip], jobs: int, advance: Callable[[Clip], None]
) -> tuple[dict[Any, Any], Census]:
    """Return the results of `work` on clips, merged by key, and the amount of motion.

    The work runs in `jobs` processes; `advance` is called after every clip.
    """
    found: dict[Any, Any] = {}
    census = Census()
    for clip, parts in parallel_map(work, clips, jobs):
        census += census_of(clip)
        for key, part in parts.items():
            if key in found:
                found[key].merge(part)
            else:
                found[key] = part
        advance(clip)
    return found, census


def open_data_set(text: str, split: Split | Literal["all"] = "test", quick: bool = False) -> DataSet:
    """Return the data set of 'NAME=FOLDER' or 'FOLDER'; the default name is the folder's.

    Raises BodysenseError if the folder does not exist. For a name of the catalogue the message says where to get the
    data.
    """
    name, equals, folder = text.partition("=")
    path = Path(folder if equals else text)
    name = name if equals else path.resolve().name
    if not name or "/" in name:
        raise BodysenseError(f"--data {text!r}: no name before the '='; write NAME=FOLDER")
    name = catalogue_name(name)
    if name in (one.name for one in CATALOGUE):
        return DataSet(name, require_data(name, path), split, quick)
    if not path.is_dir():
        raise BodysenseError(f"{path}: no such folder; give a folder of motion files, or a prepared store")
    return DataSet(name, path, split, quick)


def catalogue_entry(name: str) -> Entry:
    """Return the catalogue's entry of a data set. Raises BodysenseError for an unknown name."""
    for one in CATALOGUE:
        if one.name.lower() == name.lower():
            return one
    raise BodysenseError(f"unknown data set {name!r}; valid are {', '.join(one.name for one in CATALOGUE)}")


def require_data(name: str, directory: str | Path | None) -> Path:
    """Return the folder or store of a data set that a table needs.

    Raises BodysenseError if no folder is given or it contains no motion. The message says which data set is missing,
    where to get it, and its licence.
    """
    data = catalogue_entry(name)
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


def catalogue_name(text: str) -> str:
    """Return the name of a data set, in the catalogue's spelling if it is there."""
    return next((one.name for one in CATALOGUE if one.name.lower() == text.lower()), text)


def describe_data(data: DataSet, census: Census) -> str:
    """Return a sentence about the motion that was used."""
    people = f" of {len(census.people)} people" if census.people else ""
    text = f"{data.name} ({data.path}, {data.split}): {census.clips} clips{people}, {census.seconds / 60:.1f} minutes"
    text += f"; fingers are recorded in {census.finger_clips} of them, {census.finger_seconds / 60:.1f} minutes."
    if data.quick:
        text += f" --quick: a sample; only the first {QUICK_SECONDS:g} s of its clips were scored."
    return text


def missing_data_remarks(published: Sequence[str], used: Iterable[DataSet]) -> tuple[str, ...]:
    """Return a sentence for every data set of the published figures that was not used: its source and its licence."""
    names = [data.name for data in used]
    return tuple(
        f"{one.name}, of the published figures, is missing: our figures are of the data above. Get it at "
        f"{one.where} (licence: {one.licence}) and give it as --data {one.name}=FOLDER."
        for one in map(catalogue_entry, published)
        if one.name not in names
    )


def _first_seconds(clip: Clip) -> Clip:
    return replace(clip, pose=clip.pose[: max(2, round(QUICK_SECONDS * clip.frame_rate))])
