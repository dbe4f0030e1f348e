"""Frames of many clips in flat arrays: at 30 Hz, long enough, some held out, split as a list says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.resample import resample
from bodysense_lab.papers.hmd_vae.frames import (
    TEST_LENGTH,
    held_out,
    read_body_frames,
)
from bodysense_lab.papers.hmd_vae.listed_clips import listed_clips
from bodysense_lab.papers.hmd_vae.split_list import read_split_file


def shorter(clip: Clip, frames: int) -> Clip:
    return replace(clip, pose=clip.pose[:frames])


def test_clips_lie_one_after_the_other(waving_clip: Clip) -> None:
    frames = read_body_frames([waving_clip, shorter(waving_clip, 63), shorter(waving_clip, 64)])
    assert frames.length.tolist() == [90, 64] and frames.start.tolist() == [0, 90]  # 63 frames are too few
    position, rotation = forward_kinematics(waving_clip.pose)
    places = waving_clip.pose.skeleton.indices(BODY)
    np.testing.assert_allclose(frames.position[:90], position[:, places], atol=1e-5)
    np.testing.assert_allclose(frames.rotation[90:], rotation[:64, places], atol=1e-6)


def test_a_whole_multiple_of_the_rate_is_thinned(waving_clip: Clip) -> None:
    fast = resample(waving_clip, 120.0)
    thinned = replace(fast, pose=fast.pose[::4], frame_rate=30.0)
    np.testing.assert_array_equal(read_body_frames([fast]).position, read_body_frames([thinned]).position)


@pytest.mark.parametrize("rate", [12.0, 24.0, 100.0])
def test_other_rates_come_to_the_same_rate(waving_clip: Clip, rate: float) -> None:
    frames = read_body_frames([replace(waving_clip, frame_rate=rate)] if rate < 30 else [resample(waving_clip, rate)])
    seconds = (90 - 1) / rate if rate < 30 else (90 - 1) / 30
    assert abs((frames.length[0] - 1) / 30 - seconds) < 1 / 30 + 1 / rate


def test_a_trial_reads_some_of_a_list(tmp_path: Path, waving_clip: Clip) -> None:
    names = [f"{letter}.bvh" for letter in "abc"]
    for name in names:
        write_bvh(tmp_path / name, waving_clip)
    (tmp_path / "split.txt").write_text("".join(f"{name} train\n" for name in names))
    assert [clip.name for clip in listed_clips(tmp_path, "train", tmp_path / "split.txt", 1)] == ["b"]


def test_clips_that_are_too_short_are_refused(waving_clip: Clip) -> None:
    with pytest.raises(BodysenseError, match=f"none of the clips has {TEST_LENGTH} frames at 30 Hz"):
        read_body_frames([shorter(waving_clip, 20)])


def test_windows_of_some_clips(waving_clip: Clip) -> None:
    frames = read_body_frames([waving_clip, shorter(waving_clip, 70), waving_clip])
    some = frames.windows(16, clips=np.array([1, 2]))
    assert set(some.clip.tolist()) == {1, 2} and some.start.min() == 90
    ends = frames.start + frames.length
    assert (some.frames()[:, -1] < ends[some.clip]).all()
    assert len(frames.windows(16)) == sum((n - 16) // 4 + 1 for n in (90, 70, 90))


def test_a_twentieth_of_every_data_set_is_held_out() -> None:
    people = [f"cmu_{k}" for k in range(200)] + [f"kit_{k}" for k in range(40)] + ["anna", "otto"] * 10 + ["lone_one"]
    people += [f"MPI_HDM05_{k}" for k in range(20)] + [f"MPI_Limits_{k}" for k in range(60)]
    chosen = held_out(people, np.random.default_rng(0))
    sets = np.array([name[: name.rfind("_")] if "_" in name else "" for name in people])
    counts = {name: int(chosen[sets == name].sum()) for name in np.unique(sets)}
    assert counts == {"cmu": 10, "kit": 2, "": 1, "lone": 0, "MPI_HDM05": 1, "MPI_Limits": 3}
    np.testing.assert_array_equal(chosen, held_out(people, np.random.default_rng(0)))


def test_a_list_decides(tmp_path: Path, waving_clip: Clip) -> None:
    data = tmp_path / "data"
    for name in ("a/one", "a/two", "b/three"):
        (data / name).parent.mkdir(parents=True, exist_ok=True)
        write_bvh(data / f"{name}.bvh", waving_clip)
    listing = tmp_path / "split.txt"
    listing.write_text("# a protocol\n./a/one.bvh train\nb/three.bvh   test\na\\two.bvh train\n\n")
    assert [clip.person for clip in listed_clips(data, "train", listing)] == ["a", "a"]
    assert [clip.person for clip in listed_clips(data, "test", listing)] == ["b"]
    listing.write_text("a/one.bvh train\nc/four.bvh test\n")
    with pytest.raises(BodysenseError, match=r"1 of 2 motions are not in .*'c/four\.bvh' for one"):
        next(listed_clips(data, "train", listing))
    listing.write_text("a/one.bvh train\n")
    with pytest.raises(BodysenseError, match="no line of it ends in 'test'"):
        next(listed_clips(data, "test", listing))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a.bvh validation", r"line 1: 'a\.bvh validation' is not 'PATH train' or 'PATH test'"),
        ("train", "line 1: 'train' is not"),
        ("a.bvh train\n./a.bvh test", r"line 2: a\.bvh is in train and in test; keep one"),
    ],
)
def test_unreadable_lists_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "split.txt").write_text(text)
    with pytest.raises(BodysenseError, match=message):
        read_split_file(tmp_path / "split.txt")


def test_a_missing_list_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BodysenseError, match=r"gone\.txt: cannot be read .*; give a list of lines 'PATH train'"):
        read_split_file(tmp_path / "gone.txt")
