from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from bodysense.cli import main
from bodysense.devices.video.pictures import Picture
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh

av = pytest.importorskip("av")
pytestmark = pytest.mark.skipif(find_spec("mediapipe") is None, reason="needs mediapipe, of the extra video")


def write(path: Path, pictures: np.ndarray, rate: int = 15) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.height, stream.width, stream.pix_fmt = *pictures.shape[1:3], "yuv420p"
        stream.options = {"crf": "12", "tune": "zerolatency"}
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())
    return path


def track(*arguments: object) -> int:
    return main(["track", *map(str, arguments)])


def test_a_video_becomes_a_motion(
    tmp_path: Path,
    landmarkers: Path,
    filmed: tuple[np.ndarray, Clip],
    capsys: pytest.CaptureFixture[str],
) -> None:
    video, model = write(tmp_path / "in.mp4", filmed[0]), tmp_path / "own.onnx"
    model.write_bytes((files("bodysense.weights") / "arms.onnx").read_bytes())
    out, overlay = tmp_path / "out.bvh", tmp_path / "overlay.mp4"
    options = ("--landmarkers", landmarkers, "--people", 1, "--model", model, "--height", 1.6, "--rig", "mixamo")
    assert track(video, "-o", out, "--overlay", overlay, *options) == 0
    clip = read_bvh(out)
    assert len(clip) == len(filmed[0]) and clip.frame_rate == 15
    assert clip.pose.skeleton.joints[0] == "mixamorig:Hips"
    assert clip.pose.skeleton.height == pytest.approx(1.6, abs=0.1)  # to the top of the head
    with av.open(str(overlay)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == len(clip) and frames[0].shape == (320, 320 + 256, 3)
    output = " ".join(capsys.readouterr().out.split())
    assert "8 frames the person in 100% of the pictures, their left hand in 100%, right in 100%" in output


@pytest.mark.slow
def test_one_picture_and_a_folder_of_them(tmp_path: Path, landmarkers: Path, filmed: tuple[np.ndarray, Clip]) -> None:
    from PIL import Image

    one = write(tmp_path / "one.mp4", filmed[0][:1])
    rest = ("--landmarkers", landmarkers, "--people", 1)
    assert track(one, "-o", tmp_path / "one.bvh", *rest) == 0
    assert len(read_bvh(tmp_path / "one.bvh")) == 1
    folder = tmp_path / "folder"
    folder.mkdir()
    for number, picture in enumerate(filmed[0][:3]):
        Image.fromarray(picture).save(folder / f"{number}.png")
    assert track(folder, "-o", tmp_path / "folder.bvh", *rest, "--image-rate", 24, "--look-ahead", 0) == 0
    clip = read_bvh(tmp_path / "folder.bvh")
    assert len(clip) == 3 and clip.frame_rate == 24


@pytest.mark.slow
def test_a_video_that_breaks_off_gives_a_part(
    tmp_path: Path, landmarkers: Path, filmed: tuple[np.ndarray, Clip], capsys: pytest.CaptureFixture[str]
) -> None:
    content = write(tmp_path / "whole.mkv", filmed[0].repeat(3, axis=0)).read_bytes()
    (tmp_path / "cut.mkv").write_bytes(content[: len(content) * 2 // 3])
    out = tmp_path / "out.bvh"
    rest = ("--landmarkers", landmarkers, "--people", 1)
    assert track(tmp_path / "cut.mkv", "-o", out, *rest) == 0
    assert 3 <= len(read_bvh(out)) < 24
    assert "warning" in (output := capsys.readouterr().out) and "damaged" in output


def test_a_webcam_is_tracked_live_until_ctrl_c(
    tmp_path: Path,
    landmarkers: Path,
    filmed: tuple[np.ndarray, Clip],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from bodysense.devices.video import pictures as video

    def pictures() -> Iterator[Picture]:
        for k in range(3):
            yield Picture(k / 15, filmed[0][k])
        raise KeyboardInterrupt

    webcam = video.Video("webcam 0", 15.0, None, pictures(), lambda: None)
    monkeypatch.setattr(video, "_open_webcam", lambda index: webcam)
    monkeypatch.chdir(tmp_path)
    assert track(0, "-o", "out.bvh", "--landmarkers", landmarkers, "--people", 1) == 0
    assert len(read_bvh(Path("out.bvh"))) == 3  # none waited for frames to come
    assert "look-ahead 0 s" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_the_person_of_the_given_number_is_followed(
    tmp_path: Path, landmarkers: Path, filmed: tuple[np.ndarray, Clip], capsys: pytest.CaptureFixture[str]
) -> None:
    video, out = write(tmp_path / "in.mp4", filmed[0]), tmp_path / "out.bvh"
    rest = ("--landmarkers", landmarkers, "--people", 1)
    assert track(video, "-o", out, "--follow", 1, *rest) == 0
    assert "the person in 100%" in " ".join(capsys.readouterr().out.split())
    out.unlink()
    assert track(video, "-o", out, "--follow", 2, *rest) == 2
    assert "--follow 2: only 1 was found in in.mp4; give 1, or" in capsys.readouterr().err and not out.exists()


def test_a_video_without_a_person_is_refused(
    tmp_path: Path, landmarkers: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video = write(tmp_path / "empty.mp4", np.full((3, 96, 128, 3), 120, np.uint8))
    assert track(video, "-o", tmp_path / "a.bvh", "--landmarkers", landmarkers) == 2
    assert "empty.mp4: no person was found in its 3 pictures" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["empty.mp4"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("text.mp4",), "text.mp4: not a video that can be read"),
        (("none.mp4",), "none.mp4: no such file"),
        (("text.mp4", "--device", "three_point"), "are not for videos"),
        (("text.mp4", "--names", "names.json"), "a video; --names: for markers (.c3d"),
        (("text.mp4", "--look-ahead", "3"), "--look-ahead 3: give 0 to 0.5 s"),
        (("text.mp4", "--follow", "0"), "--follow 0: people are numbered from 1"),
        (("text.mp4", "--person", "2"), "--person 2: no such wearer's file; --follow 2 follows that person"),
        (("text.mp4", "--missing", "head"), "--missing, --noise and --save-person are not for videos"),
        (("text.mp4", "--rig", "source"), "--rig source: only a .bvh or .fbx file has a rig of its own"),
        (("text.mp4", "--roll", "200"), "--roll 200: give -180 to 180 degrees"),
        (("text.mp4", "--tilt", "nan"), "--tilt nan: give -90 to 90 degrees"),
        (("text.mp4", "--seconds", "0"), "--seconds 0: give more than 0"),
        (("text.mp4", "--overlay", "none/a.mp4"), "the folder none does not exist"),
        (("a.npz", "--overlay", "a.mp4"), "a.npz: not a video; --overlay"),
        (("text.mp4", "--landmarkers", "."), "there is no pose_landmarker_full.task"),
    ],
)
def test_invalid_options_are_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("text.mp4").write_text("this is no video\n" * 50)
    np.savez("a.npz", x=np.zeros(3))
    if "--landmarkers" in arguments:
        write(Path("text.mp4"), np.zeros((1, 64, 64, 3), np.uint8))
    assert track(*arguments, "-o", "out.bvh") == 2
    output = capsys.readouterr().err
    assert message in output and output.count("\n") == 1
    assert not Path("out.bvh").exists()
