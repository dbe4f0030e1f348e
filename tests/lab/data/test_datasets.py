"""Data sets of the tables: names, counts, quick samples, and remarks about missing ones."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense_lab.data.datasets import (
    QUICK_SECONDS,
    Census,
    DataSet,
    census_of,
    describe_data,
    missing_data_remarks,
    open_data_set,
)


def test_names_are_those_of_the_option_or_the_folder(data: DataSet) -> None:
    assert open_data_set(str(data.path)).name == "motion"
    named = open_data_set(f"ours={data.path}", "val", quick=True)
    assert (named.name, named.path, named.split, named.quick) == ("ours", data.path, "val", True)
    assert open_data_set(f"unoc={data.path}").name == "UNOC", "as the catalogue spells it"
    assert named.label != replace(named, quick=False).label != replace(named, split="test", quick=False).label


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}/none", "no such folder"),
        ("mine={}/none", "no such folder"),
        ("={}", "no name before"),
        ("UNOC={}/none", "github.com/facebookresearch/UNOC (licence: MIT)"),
    ],
)
def test_missing_folders_and_names_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(BodysenseError) as error:
        open_data_set(text.format(tmp_path))
    assert message in str(error.value)


def test_a_census_counts_clips_people_and_seconds(data: DataSet, waving_clip: Clip) -> None:
    clips = list(data.clips())
    census = sum((census_of(clip) for clip in clips), start=Census())
    assert (census.clips, len(census.people), census.finger_clips) == (2, 2, 2) and data.count() == 2
    assert census.seconds == pytest.approx(72 / 30) == census.finger_seconds
    bare = census_of(replace(waving_clip, has_fingers=False, person=""))
    assert (bare.finger_clips, bare.finger_seconds, bare.people) == (0, 0.0, frozenset())
    text = describe_data(data, census)
    assert "2 clips of 2 people" in text and str(data.path) in text and "--quick" not in text
    assert "--quick: a sample" in describe_data(replace(data, quick=True), census)


def test_missing_data_sets_are_named_with_their_licence(data: DataSet) -> None:
    remarks = missing_data_remarks(("UNOC", "TWH16.2M"), [data])
    assert len(remarks) == 2 and "MIT" in remarks[0] and "CC BY-NC 4.0" in remarks[1]
    assert missing_data_remarks(("UNOC",), [replace(data, name="UNOC")]) == ()


def test_quick_takes_the_first_seconds_of_a_few_clips(tmp_path: Path, waving_clip: Clip) -> None:
    """Clips are cut and never repeated, and their number is limited; a small set is used completely."""
    write_bvh(tmp_path / "p00_a.bvh", replace(waving_clip, pose=waving_clip.pose[:8], frame_rate=1.0))
    for k in range(1, 30):
        shutil.copy(tmp_path / "p00_a.bvh", tmp_path / f"p{k:02}_a.bvh")
    whole = DataSet("many", tmp_path, "all")
    quick = list(replace(whole, quick=True).clips())
    people = [clip.person for clip in quick]
    assert len(people) == len(set(people)) < 30 == whole.count()
    assert {len(clip) for clip in quick} == {int(QUICK_SECONDS)} and replace(whole, quick=True).count() >= len(quick)


def test_quick_includes_clips_with_fingers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waving_clip: Clip) -> None:
    """If one clip in twelve has fingers, the sample contains some of them."""
    from bodysense_lab.data import datasets

    clips = [replace(waving_clip, name=str(k), has_fingers=k % 12 == 0) for k in range(60)]
    spread = {12: clips[1::5], 64: clips}
    monkeypatch.setattr(datasets, "open_clips", lambda path, split, at_most: iter(spread[at_most]))
    chosen = list(DataSet("x", tmp_path, "all", quick=True).clips())
    names = [clip.name for clip in chosen]
    assert len(names) == len(set(names)) and sum(clip.has_fingers for clip in chosen) == datasets.QUICK_FINGER_CLIPS
