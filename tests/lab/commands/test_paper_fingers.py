"""`bodysense papers fingers`: fingers for any motion; its body is unchanged."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.cli.recordings import load_clip
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.reading_options import AS_FOUND


def without_fingers(clip: Clip) -> Clip:
    """Return the motion on a skeleton that ends at the wrists."""
    whole = clip.pose.skeleton
    joints = [k for k in range(len(whole.joints)) if whole.wrist_of[k] < 0]
    skeleton = Skeleton(
        joints=tuple(whole.joints[k] for k in joints),
        end_sites=(),
        parents=tuple(joints.index(whole.parents[k]) if k else -1 for k in joints),
        rest_offset=whole.rest_offset[joints],
    )
    return Clip("bare", Pose(skeleton, clip.pose.root_position, clip.pose.rotation[:, joints]), clip.frame_rate)


@pytest.fixture
def bare(tmp_path: Path, short_clip: Clip) -> Path:
    """The short clip as BVH, without any finger."""
    write_bvh(tmp_path / "bare.bvh", without_fingers(short_clip))
    return tmp_path / "bare.bvh"


def places(file: Path) -> tuple[Clip, np.ndarray]:
    clip = load_clip(file, AS_FOUND)
    return clip, np.asarray(forward_kinematics(clip.pose)[0])


def test_a_body_gets_fingers_and_is_otherwise_unchanged(tmp_path: Path, bare: Path, run) -> None:
    out = tmp_path / "out.bvh"
    assert "20 frames with synthesized fingers" in run("papers", "fingers", bare, "-o", out)
    (before, was), (after, now) = places(bare), places(out)
    skeleton = after.pose.skeleton
    body = np.flatnonzero(skeleton.wrist_of[: len(skeleton.joints)] < 0)
    np.testing.assert_allclose(now[:, body], was[:, body], atol=1e-4)
    np.testing.assert_allclose(after.pose.rotation[:, body], before.pose.rotation[:, body], atol=1e-3)
    assert not before.has_fingers and after.has_fingers
    assert after.frame_rate == pytest.approx(before.frame_rate)
    length = np.linalg.norm(now[:, 1:] - now[:, list(skeleton.parents[1:])], axis=-1)
    np.testing.assert_allclose(length, np.tile(before.pose.skeleton.bone_length[1:], (20, 1)), atol=1e-4)


def test_invalid_files_are_refused(tmp_path: Path, motion: Path, refused) -> None:
    other = files("bodysense.weights") / "body_vae.onnx"
    out = tmp_path / "out.bvh"
    assert "a.bvh: no such file" in refused("papers", "fingers", tmp_path / "a.bvh", "-o", out)
    text = refused("papers", "fingers", motion, "--network", other, "-o", out)
    assert "wanted 'bodysense points 1'" in text and "`bodysense train fingers`" in text
    assert "give a name that ends in .bvh" in refused("papers", "fingers", motion, "-o", tmp_path / "a")
    assert not out.exists()
