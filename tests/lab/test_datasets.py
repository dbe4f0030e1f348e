"""Data sets of the tables: names, counts, the quick part, and what is said of those that are missing."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from bodysense.errors import BodysenseError
from bodysense.io.bvh import write_bvh
from bodysense.io.clip import Clip
from bodysense_lab.datasets import (
    QUICK_SECONDS,
    Census,
    DataSet,
    census_of,
    describe_data,
    missing_data_remarks,
    open_data_set,
)


def test_names(data: DataSet) -> None:
    assert open_data_set(str(data.path)).name == "motion"
    named = open_data_set(f"ours={data.path}", "val", quick=True)
    assert (named.name, named.path, named.split, named.quick) == ("ours", data.path, "val", True)
    assert open_data_set(f"unoc={data.path}").name == "UNOC", "as the catalogue spells it"
    assert named.label != replace(named, quick=False).label != replace(named, split="test", quick=False).label


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{}/none", "no such folder"),
        ("mine={}/none", "no such folder"),
        ("={}", "no name before"),
        ("UNOC={}/none", "github.com/facebookresearch/UNOC (licence: MIT)"),
    ],
)
def test_what_is_not_there(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(BodysenseError) as error:
        open_data_set(text.format(tmp_path))
    assert said in str(error.value)


def test_census(data: DataSet, waving_clip: Clip) -> None:
    clips = list(data.clips())
    census = sum((census_of(clip) for clip in clips), start=Census())
    assert (census.clips, len(census.people), census.finger_clips) == (2, 2, 2) and data.count() == 2
    assert census.seconds == pytest.approx(72 / 30) == census.finger_seconds
    bare = census_of(replace(waving_clip, has_fingers=False, person=""))
    assert (bare.finger_clips, bare.finger_seconds, bare.people) == (0, 0.0, frozenset())
    text = describe_data(data, census)
    assert "2 clips of 2 people" in text and str(data.path) in text and "--quick" not in text
    assert "--quick: a sample" in describe_data(replace(data, quick=True), census)


def test_what_is_missing_is_named_with_its_licence(data: DataSet) -> None:
    said = missing_data_remarks(("UNOC", "TWH16.2M"), [data])
    assert len(said) == 2 and "MIT" in said[0] and "CC BY-NC 4.0" in said[1]
    assert missing_data_remarks(("UNOC",), [replace(data, name="UNOC")]) == ()


def test_quick_is_the_beginning_of_a_few(tmp_path: Path, waving_clip: Clip) -> None:
    """At most so many, no clip twice, cut; and all of a small set."""
    write_bvh(tmp_path / "p00_a.bvh", replace(waving_clip, pose=waving_clip.pose[:8], frame_rate=1.0))
    for k in range(1, 30):
        shutil.copy(tmp_path / "p00_a.bvh", tmp_path / f"p{k:02}_a.bvh")
    whole = DataSet("many", tmp_path, "all")
    quick = list(replace(whole, quick=True).clips())
    people = [clip.person for clip in quick]
    assert len(people) == len(set(people)) < 30 == whole.count()
    assert {len(clip) for clip in quick} == {int(QUICK_SECONDS)} and replace(whole, quick=True).count() >= len(quick)


def test_quick_looks_for_fingers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waving_clip: Clip) -> None:
    """Where one in twelve has fingers, some of them are among the few."""
    from bodysense_lab import datasets

    clips = [replace(waving_clip, name=str(k), has_fingers=k % 12 == 0) for k in range(60)]
    spread = {12: clips[1::5], 64: clips}
    monkeypatch.setattr(datasets, "open_clips", lambda path, split, at_most: iter(spread[at_most]))
    chosen = list(DataSet("x", tmp_path, "all", quick=True).clips())
    names = [clip.name for clip in chosen]
    assert len(names) == len(set(names)) and sum(clip.has_fingers for clip in chosen) == datasets.QUICK_FINGER_CLIPS
