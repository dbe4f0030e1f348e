"""Corpora of folders and stores, cached in the user's cache folder."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from bodysense.files import cache_folder, make_folder, written_beside
from bodysense.io.datasets.sources import list_sources
from bodysense.io.datasets.splits import Split
from bodysense_lab.completion.data.corpus import Corpus, corpus_of
from bodysense_lab.data.clips import read_clips
from bodysense_lab.data.store import is_store

FORMAT = "bodysense-corpus-2"


def read_corpus(data: Path, split: Split, limit: int | None = None) -> Corpus:
    """Read the clips of a split of `data`, a folder of motion or a store, or `limit` of them for a trial.

    The corpus is cached in the user's cache folder until the data change. Raises BodysenseError if there is no motion.
    """
    request = f"{data.resolve()} {split} {limit}"
    cached = cache_folder() / f"corpus-{hashlib.sha256(request.encode()).hexdigest()[:16]}.npz"
    content = content_digest(data)
    if cached.is_file():
        with np.load(cached, allow_pickle=False) as saved:
            if str(saved["content"]) == content:
                return Corpus(**{name: saved[name] for name in saved.files if name != "content"})
    corpus = corpus_of(read_clips(data, split, limit))
    make_folder(cached.parent)
    with written_beside(cached) as beside, beside.open("wb") as file:
        np.savez(file, content=content, **vars(corpus))
    return corpus


def content_digest(data: Path) -> str:
    """Return a digest that changes with the motion in a folder or store and with the format of a corpus."""
    if is_store(data):
        seen = [(data / "zarr.json").read_text(encoding="utf-8")]
    else:
        found = [(source, source.path.stat()) for source in list_sources(data)]
        seen = [
            f"{source.key(data)} {source.person} {source.split} {source.category} {file.st_size} {file.st_mtime_ns}"
            for source, file in found
        ]
    return hashlib.sha256("\n".join([FORMAT, *seen]).encode()).hexdigest()
