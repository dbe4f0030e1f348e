"""The corpus cache is valid until the data change."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from people.split import person_of, write_people

from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense_lab.completion.data import corpus_cache
from bodysense_lab.completion.data.corpus_cache import read_corpus


def test_motion_is_read_once_until_it_changes(
    tmp_path: Path, waving_clip: Clip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    data = write_people(tmp_path / "data", {"train": [waving_clip]})
    reads, read_clips = [], corpus_cache.read_clips

    def counted(*arguments: object):
        reads.append(arguments)
        return read_clips(*arguments)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(corpus_cache, "read_clips", counted)
    first, again = (read_corpus(data, "train") for _ in range(2))
    assert len(reads) == 1 and len(again) == 1
    np.testing.assert_array_equal(first.rotation, again.rotation)
    write_bvh(data / person_of("train") / "1.bvh", replace(waving_clip, pose=waving_clip.pose[:40]))
    assert len(read_corpus(data, "train")) == 2 and len(reads) == 2
    assert len(read_corpus(data, "train", 1)) == 1 and len(reads) == 3
