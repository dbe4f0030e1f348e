"""Motion files written frame by frame equal those written whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh
from bodysense.io.motion_files import motion_stream, write_motion


@pytest.mark.parametrize("ending", ["glb", "vrma"])
def test_a_motion_that_is_written_as_it_comes_is_the_same(waving_clip: Clip, tmp_path: Path, ending: str) -> None:
    """Equal but for rounding to BVH's digits."""
    clip, name = waving_clip, f"waves.{ending}"
    (tmp_path / "whole").mkdir()
    write_motion(tmp_path / "whole" / "waves.bvh", clip)
    read = read_bvh(tmp_path / "whole" / "waves.bvh").pose
    order = read.skeleton.indices(clip.pose.skeleton.joints)
    kept = type(read)(clip.pose.skeleton, read.root_position, np.asarray(read.rotation)[:, order])
    write_motion(tmp_path / "whole" / name, Clip("waves", kept, clip.frame_rate))
    with motion_stream(tmp_path / name, clip.pose.skeleton, clip.frame_rate) as motion:
        for begin in range(0, len(clip), 7):
            motion.append(clip.time[begin : begin + 7], clip.pose[begin : begin + 7])
    assert motion.frames == len(clip)
    assert {path.name for path in tmp_path.iterdir()} == {"whole", name}
    assert (tmp_path / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


@pytest.mark.parametrize("ending", ["glb", "vrma"])
def test_without_a_frame_there_is_no_file(waving_clip: Clip, tmp_path: Path, ending: str) -> None:
    with motion_stream(tmp_path / f"none.{ending}", waving_clip.pose.skeleton, 30):
        pass
    with pytest.raises(ZeroDivisionError), motion_stream(tmp_path / f"broken.{ending}", waving_clip.pose.skeleton, 30):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())
