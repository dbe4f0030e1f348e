"""Folders as subjects: motion data with its splits, or any files that `read_subject` reads."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.io.datasets.sources import Source, list_sources
from bodysense_conform.sources.files import ENDINGS, motion_subject, read_subject
from bodysense_conform.subject import Subject


@dataclass(frozen=True)
class Job:
    """One file, and the windows of it that are judged."""

    path: Path
    source: Source | None  # None: any file of `ENDINGS`
    window: float | None  # s; None: the whole file, once
    every: float  # of the windows one in so many, evenly spread; 1: all
    first: float  # windows, of all files together, before this one


def jobs(folder: Path, window: float | None, splits: Collection[str], limit: int | None) -> list[Job]:
    """The files of a folder to be judged, sorted. Raises BodysenseError where there is none."""
    found = _files(folder, splits)
    if not found:
        chosen = f" of the splits {', '.join(splits)}" if splits else ""
        raise BodysenseError(f"{folder}: no file{chosen} in it that ends in {', '.join(ENDINGS)}; give another folder")
    if window is None:
        if limit is not None and limit < len(found):
            found = [found[k] for k in np.linspace(0, len(found) - 1, limit).round().astype(int)]
        return [Job(path, source, None, 1.0, 0.0) for path, source in found]
    counts = [_windows(subject_of(path, source), window) for path, source in found] if limit else [0] * len(found)
    every = max(sum(counts) / limit, 1.0) if limit else 1.0
    before = np.concatenate([[0], np.cumsum(counts)])
    return [
        Job(path, source, window, every, float(first)) for (path, source), first in zip(found, before, strict=False)
    ]


def subjects(job: Job) -> Iterator[Subject]:
    """The subjects of a job."""
    subject = subject_of(job.path, job.source)
    if job.window is None:
        yield subject
        return
    for k in range(_windows(subject, job.window)):
        place = job.first + k
        if int((place + 1) / job.every) > int(place / job.every):
            start = subject.time[0] + k * job.window
            yield cut(subject, start, start + job.window)


def cut(subject: Subject, start: float, end: float) -> Subject:
    """The frames of a subject from `start` to before `end`, s."""
    keep = (subject.time >= start) & (subject.time < end)
    measured = None if subject.measured is None else subject.measured[keep]
    name = f"{subject.name}@{start - subject.time[0]:.1f}"
    transport = subject.transport
    arrays = {
        key: None if (values := getattr(transport, key)) is None else values[keep]
        for key in ("log_time", "available", "device_time", "all_tracked")
    }
    return replace(
        subject,
        name=name,
        time=subject.time[keep],
        position=subject.position[keep],
        rotation=subject.rotation[keep],
        valid=subject.valid[keep],
        measured=measured,
        transport=replace(transport, **arrays),
    )


def subject_of(path: Path, source: Source | None) -> Subject:
    """The subject of a file."""
    return read_subject(path) if source is None else motion_subject(source)


def _windows(subject: Subject, window: float) -> int:
    """Whole windows of a subject."""
    return int((subject.seconds + max(subject.interval, 0)) / window + 1e-6)


def _files(folder: Path, splits: Collection[str]) -> list[tuple[Path, Source | None]]:
    """Files and what their folder says of them; motion data where it is described, or splits are asked for."""
    described = (folder / "splits.json").is_file() or (folder.parent / "splits.json").is_file()
    if described or splits:
        sources = [one for one in list_sources(folder) if not splits or one.split in splits]
        return [(one.file.place, one) for one in sources]
    paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in ENDINGS and path.is_file())
    return [(path, None) for path in paths]
