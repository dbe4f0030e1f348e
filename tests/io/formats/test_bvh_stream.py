from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import BvhStream, read_bvh, write_bvh
from bodysense.io.resample import at_constant_rate


@pytest.mark.parametrize(("jitter", "block", "begin"), [(0.0, 1, 2.0), (0.012, 7, 1.7e9), (0.012, 90, 2.0)])
def test_frame_by_frame_is_as_at_once(
    tmp_path: Path, waving_clip: Clip, jitter: float, block: int, begin: float
) -> None:
    time = begin + waving_clip.time + np.random.default_rng(0).uniform(0, jitter, len(waving_clip))
    with BvhStream(tmp_path / "a.bvh", waving_clip.pose.skeleton, 30.0) as stream:
        for start in range(0, len(time), block):
            stream.append(time[start : start + block], waving_clip.pose[start : start + block])
    write_bvh(tmp_path / "b.bvh", at_constant_rate(waving_clip, time))
    found, wanted = read_bvh(tmp_path / "a.bvh"), read_bvh(tmp_path / "b.bvh")
    assert len(found) == len(wanted) == stream.frames and found.frame_rate == wanted.frame_rate
    np.testing.assert_allclose(found.pose.root_position, wanted.pose.root_position, atol=1e-6)
    np.testing.assert_allclose(found.pose.rotation, wanted.pose.rotation, atol=1e-5)


def test_one_frame(tmp_path: Path, waving_clip: Clip) -> None:
    with BvhStream(tmp_path / "a.bvh", waving_clip.pose.skeleton, 25.0) as stream:
        stream.append(np.array([0.3]), waving_clip.pose[:1])
        stream.append(np.empty(0), waving_clip.pose[:0])
    assert len(read_bvh(tmp_path / "a.bvh")) == 1


def test_times_that_were_rounded_lose_no_frame(tmp_path: Path, waving_clip: Clip) -> None:
    time = np.floor(waving_clip.time * 1000) / 1000
    with BvhStream(tmp_path / "a.bvh", waving_clip.pose.skeleton, 30.0) as stream:
        stream.append(time, waving_clip.pose)
    found = read_bvh(tmp_path / "a.bvh")
    assert len(found) == len(time) == stream.frames
    np.testing.assert_allclose(found.pose.root_position[-1], waving_clip.pose.root_position[-1], atol=1e-6)


def test_nothing_is_left_of_a_file_that_failed(tmp_path: Path, waving_clip: Clip) -> None:
    clip = replace(waving_clip, name="a")
    with pytest.raises(BodysenseError, match="stop"), BvhStream(tmp_path / "a.bvh", clip.pose.skeleton, 25.0) as stream:
        stream.append(clip.time, clip.pose)
        raise BodysenseError("stop")
    assert not list(tmp_path.iterdir())
