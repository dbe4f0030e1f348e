"""Recognition and opening of sources."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.device import simulate
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_log
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.formats.recording import Recording, write_recording
from bodysense.io.formats.smpl import joint_places
from bodysense.io.markers.options import MarkerOptions
from bodysense.io.reading_options import ReadingOptions
from bodysense.sources.kinds import kind_of
from bodysense.sources.open import MarkerSource, MotionSource, RecordingSource, VideoSource, open_source
from bodysense.takes.track import track


def test_every_kind_of_source_is_recognised(tmp_path: Path, waving_clip: Clip) -> None:
    seen = simulate(waving_clip, "three_point", None)
    write_bvh(tmp_path / "a.bvh", waving_clip)
    write_recording(tmp_path / "a.npz", Recording(seen, waving_clip.pose.skeleton))
    (tmp_path / "a.mp4").write_bytes(b"film")
    motion = open_source(tmp_path / "a.bvh")
    assert isinstance(motion, MotionSource) and motion.joint_file == tmp_path / "a.bvh" and len(motion.clip) == 90
    assert open_source(motion) is motion and "read " in motion.remarks[0]
    assert isinstance(open_source(tmp_path / "a.npz"), RecordingSource)
    assert isinstance(open_source(str(tmp_path / "a.mp4")), VideoSource)
    (tmp_path / "a.png").write_bytes(b"")
    assert kind_of(tmp_path) == "video"  # a folder of images, whatever else is in it
    in_memory = open_source(waving_clip)
    assert isinstance(in_memory, MotionSource) and in_memory.clip is waving_clip and in_memory.joint_file is None
    frames = open_source(seen)
    assert isinstance(frames, RecordingSource) and not frames.recording.known


def test_options_are_those_of_the_kind(tmp_path: Path, waving_clip: Clip) -> None:
    write_bvh(tmp_path / "a.bvh", waving_clip)
    (tmp_path / "a.mp4").write_bytes(b"film")
    with pytest.raises(BodysenseError, match=r"a motion; --unlabelled: for markers \(\.c3d, .* leave it out"):
        open_source(tmp_path / "a.bvh", markers=MarkerOptions(unlabelled="left"))
    for options, message in (
        (ReadingOptions(unit="mm"), "--unit"),
        (ReadingOptions(smpl_model=tmp_path), "--smpl-model"),
    ):
        with pytest.raises(BodysenseError, match=f"a video; {message}: for motions and recordings, leave it out"):
            open_source(tmp_path / "a.mp4", options)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("take.mvn", r"export the take as \.mvnx or \.bvh"),
        ("take.vmd", "MikuMikuDance, is not read; import model and motion in Blender"),
        ("keypoints.json", "OpenPose, .* give the video itself"),
        ("take.bvh.gz", "gunzip"),
        ("take.amc", "convert it to BVH"),
        ("take.usda", "convert it with Blender"),
        ("take.dae", "convert it with Blender"),
        ("take.mot", "with OpenSim"),
        ("take.txt", r"unknown kind of file .* markers \(\.c3d, .*recordings \(\.npz, .*videos \(\.mp4"),
    ],
)
def test_unsupported_files_are_refused_with_the_fix(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / name).write_bytes(b"{}")
    with pytest.raises(BodysenseError, match=rf"{name}: .*{message}"):
        kind_of(tmp_path / name)


def test_results_of_romp_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", results=np.array({"smpl_thetas": 1}, dtype=object))
    with pytest.raises(BodysenseError, match="results of ROMP or BEV, a pickle within an archive"):
        track(tmp_path / "a.npz")


@pytest.mark.parametrize("ending", ["npy", "npz"])
def test_joint_positions_are_opened_as_markers(tmp_path: Path, ending: str) -> None:
    """An array (T, 22, 3) with +Z up; rotation vectors can have the same shape."""
    clip = packaged_performance()
    truth = np.asarray(forward_kinematics(clip.pose)[0])[200:230, :22]
    path, up = tmp_path / f"a.{ending}", truth[:, :, [0, 2, 1]] * [1, -1, 1]
    np.save(path, up) if ending == "npy" else np.savez(path, poses=up)
    opened = open_source(path)
    assert isinstance(opened, MarkerSource) and "of joint places (30, 22, 3), not of rotations" in opened.remarks[0]
    found = np.asarray(forward_kinematics(track(opened).clip.pose)[0])[:, :22]
    heights = (found - found[:, :1])[..., 1] - (truth - truth[:, :1])[..., 1]
    assert np.abs(heights).mean() < 0.02


def _places() -> np.ndarray:
    return np.asarray(forward_kinematics(packaged_performance().pose)[0])[200:230, :22]


@pytest.mark.parametrize("how", ["noise", "whole millimetres", "flat", "hidden joint"])
def test_joint_positions_may_be_noisy(tmp_path: Path, how: str) -> None:
    """Positions with noise are not read as rotation vectors, which would give a knotted body."""
    truth = _places()
    hidden = truth.copy()
    hidden[10:20, 20] = np.nan
    given = {
        "noise": truth + np.random.default_rng(0).normal(0, 0.012, truth.shape),
        "whole millimetres": (1000 * truth).astype(int),
        "flat": truth.reshape(30, 66),
        "hidden joint": hidden,
    }[how]
    np.save(tmp_path / "a.npy", given)
    opened = open_source(tmp_path / "a.npy")
    assert isinstance(opened, MarkerSource)
    seen = opened.recording.observation
    assert seen.has_position[10:20, seen.points.index("left_wrist")].any() == (how != "hidden joint")
    assert np.linalg.norm(seen.position - truth, axis=-1)[seen.has_position].max() < 0.06


def test_joint_positions_have_the_rate_of_their_file(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", poses=_places(), fps=60.0)
    opened = open_source(tmp_path / "a.npz")
    assert isinstance(opened, MarkerSource) and not any("no frame rate" in line for line in opened.remarks)
    assert np.diff(opened.recording.observation.time) == pytest.approx(1 / 60)


def test_a_folder_of_unsupported_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "film_000000000000_keypoints.json").write_text("{}")
    with pytest.raises(BodysenseError, match="a folder without images; JSON of key points"):
        open_source(tmp_path)
    (tmp_path / "a.png").write_bytes(b"")
    assert isinstance(open_source(tmp_path), VideoSource)


@pytest.mark.parametrize("held", [False, True])
def test_rotation_vectors_are_not_taken_for_positions(tmp_path: Path, held: bool) -> None:
    turns = np.asarray(quaternion_log(packaged_performance().pose.rotation[200:230, :22]))
    np.save(tmp_path / "a.npy", np.tile(turns[:1], (30, 1, 1)) if held else turns)
    assert joint_places(tmp_path / "a.npy") is None
    assert isinstance(open_source(tmp_path / "a.npy"), MotionSource)
