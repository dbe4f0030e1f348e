"""Pictures from video files, folders of images and webcams."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from bodysense.devices.video.pictures import LARGEST, Picture, VideoBrokenError, is_video, open_video
from bodysense.errors import BodysenseError

av = pytest.importorskip("av")
RED, GREEN, BLUE = (220, 30, 30), (30, 200, 30), (30, 30, 220)


def corners(high: int = 96, wide: int = 160) -> np.ndarray:
    """Return a blue picture with a red upper left corner and a green upper right one."""
    picture = np.empty((high, wide, 3), np.uint8)
    picture[...] = BLUE
    picture[: high // 2, : wide // 2], picture[: high // 2, wide // 2 :] = RED, GREEN
    return picture


def write(
    path: Path, times: list[float], picture: np.ndarray, rotation: int = 0, shape: int = 1, step: int = 0
) -> Path:
    """Write a video of one picture, which moves by `step` pixels per frame."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=30)
        stream.height, stream.width, stream.pix_fmt = *picture.shape[:2], "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        if shape != 1:
            stream.codec_context.sample_aspect_ratio = Fraction(shape)
        if rotation:
            stream.set_display_rotation(rotation)
        for k, time in enumerate(times):
            frame = av.VideoFrame.from_ndarray(np.roll(picture, k * step, axis=1), format="rgb24")
            frame.time_base, frame.pts = Fraction(1, 1000), round(1000 * time)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def read(path: Path | str) -> list[Picture]:
    with open_video(str(path)) as video:
        return list(video.pictures)


def is_like(pixels: np.ndarray, color: tuple[int, int, int]) -> bool:
    return bool(np.abs(pixels.reshape(-1, 3).mean(axis=0) - color).max() < 40)


@pytest.mark.parametrize("times", [[0.0, 0.04, 0.08, 0.12], [0.5, 0.533, 0.7, 0.75, 1.4], [0.0]])
def test_times_are_those_of_the_container(tmp_path: Path, times: list[float]) -> None:
    pictures = read(write(tmp_path / "a.mp4", times, corners()))
    np.testing.assert_allclose([picture.time for picture in pictures], np.array(times) - times[0], atol=2e-3)
    assert all(picture.pixels.shape == (96, 160, 3) for picture in pictures)


def test_the_rate_of_a_browsers_clock_is_ignored(tmp_path: Path) -> None:
    """A browser's recording states a rate of 1000 Hz and no length."""
    path = tmp_path / "a.webm"
    with av.open(str(path), "w", options={"live": "1"}) as container:
        stream = container.add_stream("libvpx", rate=1000)
        stream.height, stream.width, stream.pix_fmt = 96, 160, "yuv420p"
        for k in range(9):
            frame = av.VideoFrame.from_ndarray(corners(), format="rgb24")
            frame.time_base, frame.pts = Fraction(1, 1000), 40 * k
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with open_video(str(path)) as video:
        assert video.rate == pytest.approx(25.0)
        assert [picture.time for picture in video.pictures] == pytest.approx([k / 25 for k in range(9)])


@pytest.mark.parametrize("rotation", [90, 180])
def test_pictures_are_upright(tmp_path: Path, rotation: int) -> None:
    """A rotated camera stores rotated pictures and the angle, anticlockwise, that makes them upright."""
    stored = np.ascontiguousarray(np.rot90(corners(), -rotation // 90))
    (picture,) = read(write(tmp_path / "a.mp4", [0.0], stored, rotation))
    assert picture.pixels.shape == (96, 160, 3)
    assert is_like(picture.pixels[4:40, 4:70], RED) and is_like(picture.pixels[4:40, 90:156], GREEN)


def test_pixels_become_square_and_large_pictures_are_scaled_down(tmp_path: Path) -> None:
    (wide,) = read(write(tmp_path / "wide.mkv", [0.0], corners(), shape=2))
    assert wide.pixels.shape == (96, 320, 3)
    (large,) = read(write(tmp_path / "large.mp4", [0.0], corners(1000, 2000)))
    assert large.pixels.shape == (LARGEST // 2, LARGEST, 3)


def read_damaged(path: Path) -> tuple[list[float], str]:
    """Return the times of readable pictures, and the message of the error after them."""
    times = []
    with open_video(str(path)) as video, pytest.raises(VideoBrokenError) as error:
        for picture in video.pictures:
            times.append(picture.time)
    return times, str(error.value)


def test_pictures_of_a_cut_off_video_are_read(tmp_path: Path) -> None:
    content = write(tmp_path / "whole.mkv", [k / 30 for k in range(60)], corners()).read_bytes()
    (tmp_path / "cut.mkv").write_bytes(content[: len(content) // 2])
    times, message = read_damaged(tmp_path / "cut.mkv")
    assert 5 < len(times) < 55
    np.testing.assert_allclose(times, np.arange(len(times)) / 30, atol=2e-3)
    assert f"cut.mkv: damaged, read up to {times[-1]:.2f} s" in message and "\n" not in message


def test_pictures_around_a_damaged_part_are_read(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (12, 20, 3)).astype(np.uint8).repeat(8, 0).repeat(8, 1)
    content = bytearray(write(tmp_path / "whole.mkv", [k / 30 for k in range(60)], noise, step=1).read_bytes())
    hole = slice(len(content) // 3, len(content) // 2)
    content[hole] = bytes(hole.stop - hole.start)
    (tmp_path / "hole.mkv").write_bytes(content)
    times, message = read_damaged(tmp_path / "hole.mkv")
    assert times[0] == 0 and times[-1] > 1.9 and 5 < len(times) < 60
    assert "hole.mkv: damaged in places" in message


@pytest.mark.parametrize("content", [b"", b"1\n00:00:01,000 --> 00:00:02,000\nhello\n\n" * 20, b"no video " * 500])
def test_a_text_named_mp4_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "notes.mp4"
    path.write_bytes(content)
    with pytest.raises(BodysenseError, match=r"notes\.mp4: (not a video|the file has no video)") as error:
        read(path)
    assert "\n" not in str(error.value)


def test_a_file_without_its_index_is_refused(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.mp4", [k / 30 for k in range(9)], corners())
    (tmp_path / "cut.mp4").write_bytes(whole.read_bytes()[:-500])  # the index of an MP4 is at its end
    with pytest.raises(BodysenseError, match="is it complete"):
        read(tmp_path / "cut.mp4")


def test_sound_alone_is_refused(tmp_path: Path) -> None:
    with av.open(str(tmp_path / "sound.mp4"), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    with pytest.raises(BodysenseError, match="the file has no video"):
        read(tmp_path / "sound.mp4")


def test_a_folder_of_images_in_natural_order(tmp_path: Path) -> None:
    from PIL import Image

    for number, color in ((10, BLUE), (9, RED)):
        Image.new("RGB", (64, 48), color).save(tmp_path / f"frame{number}.png")
    (tmp_path / "notes.txt").write_text("no image")
    with open_video(str(tmp_path), rate=10.0) as video:
        assert video.count == 2
        first, second = video.pictures
    assert is_like(first.pixels, RED) and is_like(second.pixels, BLUE)
    assert (first.time, second.time) == (0.0, 0.1)
    (tmp_path / "frame11.png").write_bytes(b"broken")
    with pytest.raises(VideoBrokenError, match="frame11"):
        read(tmp_path)


def test_an_image_is_rotated_by_its_orientation(tmp_path: Path) -> None:
    from PIL import Image

    exif = Image.Exif()
    exif[0x0112] = 6  # turn clockwise by a quarter
    Image.fromarray(np.ascontiguousarray(np.rot90(corners()))).save(tmp_path / "a.jpg", exif=exif)
    (picture,) = read(tmp_path)
    assert picture.pixels.shape == (96, 160, 3) and is_like(picture.pixels[4:40, 4:70], RED)


class Camera:
    """A camera in place of OpenCV's: it yields two pictures with blue as the first channel, then it is unplugged."""

    released = False

    def __init__(self, index: int) -> None:
        self.remaining = [corners()[..., ::-1]] * 2

    def isOpened(self) -> bool:
        return True

    def set(self, *_: object) -> None: ...

    def get(self, _: object) -> float:
        return 25.0

    def read(self) -> tuple[bool, np.ndarray | None]:
        return (True, self.remaining.pop()) if self.remaining else (False, None)

    def release(self) -> None:
        Camera.released = True


def test_a_webcam_yields_pictures_until_it_is_unplugged(monkeypatch: pytest.MonkeyPatch) -> None:
    cv2 = pytest.importorskip("cv2", reason="webcams need OpenCV, which bodysense[video] brings")
    monkeypatch.setattr(cv2, "VideoCapture", Camera)
    found: list[Picture] = []
    with pytest.raises(VideoBrokenError, match="webcam 3: no more pictures"), open_video("3") as video:
        assert video.rate == 25 and video.count is None
        for picture in video.pictures:
            found.append(picture)
    assert len(found) == 2 and 0 <= found[0].time <= found[1].time and Camera.released
    assert is_like(found[0].pixels[4:40, 4:70], RED)


@pytest.mark.parametrize(
    ("source", "message"),
    [("none.mp4", "no such file"), ("empty", "the folder has no images"), ("987", "webcam 987: not found")],
)
def test_missing_sources_are_refused(
    tmp_path: Path, source: str, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    if source.isdecimal():
        pytest.importorskip("cv2", reason="webcams need OpenCV, which bodysense[video] brings")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BodysenseError, match=message):
        open_video(source if source.isdecimal() else str(tmp_path / source))
    assert capfd.readouterr().err == ""


def test_sources_that_count_as_videos(tmp_path: Path) -> None:
    assert is_video("0") and is_video(str(tmp_path)) and is_video("a.MP4") and is_video("a.png")
    assert not is_video("a.bvh") and not is_video("a.npz") and not is_video("a.csv")
