"""Episodes on disk, mapped into memory: networks that read the same features share them, across processes."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.lab.unoc.episodes import Episode

_ARRAYS = ("features", "known", "offset", "visible")


def cached_episodes(folder: Path, identity: dict[str, Any], make: Callable[[], Iterable[Episode]]) -> list[Episode]:
    """The episodes in `folder`, made first where it does not exist.

    The folder appears whole or not at all. Raises BodysenseError when it holds episodes of another `identity`, which
    must be JSON, and when there are none to make.
    """
    if not folder.is_dir():
        _write(folder, identity, make())
    index = json.loads((folder / "index.json").read_text(encoding="utf-8"))
    if index["identity"] != identity:
        changed = [name for name in identity if index["identity"].get(name) != identity[name]]
        raise BodysenseError(
            f"{folder} was made from something else ({', '.join(changed)} differ); take it away or choose another --out"
        )
    arrays = {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in _ARRAYS}
    episodes, start = [], 0
    for row in index["clips"]:
        part = {name: values[start : start + row["frames"]] for name, values in arrays.items()}
        episodes.append(Episode(name=row["name"], category=row["category"], fingers=row["fingers"], **part))
        start += row["frames"]
    return episodes


def _write(folder: Path, identity: dict[str, Any], episodes: Iterable[Episode]) -> None:
    beside = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    beside.mkdir(parents=True)
    clips, shapes, types = [], {}, {}
    try:
        with _Files(beside) as files:
            for episode in episodes:
                clips.append(
                    {
                        "name": episode.name,
                        "category": episode.category,
                        "fingers": episode.fingers,
                        "frames": len(episode),
                    }
                )
                for name in _ARRAYS:
                    values = np.ascontiguousarray(getattr(episode, name))
                    shapes[name], types[name] = values.shape[1:], values.dtype
                    files.append(name, values)
        if not clips:
            raise BodysenseError(f"{folder}: there is no clip to make episodes of")
        frames = sum(row["frames"] for row in clips)
        for name in _ARRAYS:
            raw = np.memmap(beside / f"{name}.raw", types[name], "r", shape=(frames, *shapes[name]))
            np.save(beside / f"{name}.npy", raw)
            del raw
            (beside / f"{name}.raw").unlink()
        (beside / "index.json").write_text(json.dumps({"identity": identity, "clips": clips}), encoding="utf-8")
        try:
            os.replace(beside, folder)
        except OSError:
            if not folder.is_dir():  # otherwise another process, on this machine or another, was done first
                raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)


class _Files:
    """Raw files that grow an episode at a time."""

    def __init__(self, folder: Path) -> None:
        self._open = {name: (folder / f"{name}.raw").open("wb") for name in _ARRAYS}

    def __enter__(self) -> _Files:
        return self

    def append(self, name: str, values: np.ndarray) -> None:
        self._open[name].write(values.tobytes())

    def __exit__(self, *_: object) -> None:
        for file in self._open.values():
            file.close()
