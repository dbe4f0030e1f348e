"""Pictures over time from a video file, a webcam or a folder of images, in order and in bounded memory."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.devices.video.silence import silence
from bodysense.errors import BodysenseError, missing_package
from bodysense.files import natural_order

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

LARGEST = 1280  # pixels of a picture's longer side; larger pictures are scaled down
IMAGES = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff")
VIDEOS = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".mpg", ".mpeg", ".ts", ".mts", ".wmv", ".3gp", ".ogv")
_FASTEST = 250.0  # Hz, largest plausible rate; browsers state 1000, their clock's rate
_SHORT = 0.5  # s; a file that ends earlier than its stated length by more than this is cut off


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture, upright and with square pixels."""

    time: float  # s from the first picture
    pixels: np.ndarray = field(repr=False)  # (H, W, 3) uint8, red, green, blue


@dataclass(frozen=True, eq=False)
class Video:
    """A source of pictures, a context manager. `pictures` can be iterated once."""

    name: str
    rate: float  # Hz, the mean if it varies
    count: int | None  # expected number of pictures; None if unknown
    pictures: Iterator[Picture] = field(repr=False)
    close: Callable[[], None] = field(repr=False)

    def __enter__(self) -> Video:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class VideoBrokenError(BodysenseError):
    """Error of a damaged video, raised after all pictures that can be read."""


def is_video(source: str) -> bool:
    """Whether a source is a webcam's index, a folder, or a file with the extension of a video or an image."""
    return source.isdecimal() or Path(source).is_dir() or Path(source).suffix.lower() in (*VIDEOS, *IMAGES)


def has_images(folder: Path) -> bool:
    """Whether a folder has images, so that it is read as a video."""
    return any(file.suffix.lower() in IMAGES and file.is_file() for file in folder.iterdir())


def open_video(source: str, rate: float = 30.0) -> Video:
    """Open a video file, a folder of images at `rate` Hz, or a webcam by its index ('0').

    Times are the container's. Pictures are rotated upright and have square pixels. Raises BodysenseError if the source
    cannot be opened. The pictures of a damaged file raise `VideoBrokenError` after the last readable one.
    """
    path = Path(source)
    if source.isdecimal() and not path.exists():
        return _open_webcam(int(source))
    if path.is_dir():
        return _open_folder(path, rate)
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file; give a video, a folder of images, or the index of a webcam")
    return _open_file(path)


def _open_file(path: Path) -> Video:
    av = _load("av")
    try:
        container = av.open(str(path))
    except (OSError, ValueError) as error:  # all errors of PyAV are one of these
        raise BodysenseError(f"{path}: not a video that can be read ({_reason(error)}); is it complete?") from None
    stream = next(iter(container.streams.video), None)
    if stream is None or stream.codec_context is None or not stream.codec_context.width:
        container.close()
        raise BodysenseError(f"{path}: the file has no video; give a file with one")
    stream.thread_type = "AUTO"
    rate = float(stream.average_rate or stream.guessed_rate or 0)
    if not 0 < rate <= _FASTEST:
        rate = _measured_rate(path)
    seconds = container.duration / 1e6 if container.duration else None
    if stream.duration and stream.time_base:
        seconds = float(stream.duration * stream.time_base)
    count = stream.frames or (None if seconds is None else round(seconds * rate))
    return Video(path.name, rate, count or None, _decode(path, container, stream, rate, seconds), container.close)


def _measured_rate(path: Path) -> float:
    """Return the mean rate (Hz) of the first pictures."""
    with _load("av").open(str(path)) as container:
        packets = islice(container.demux(container.streams.video[0]), 60)
        times = [float(packet.pts * packet.time_base) for packet in packets if packet.pts is not None]
    length = max(times, default=0.0) - min(times, default=0.0)
    return (len(times) - 1) / length if length > 0 else 30.0


def _decode(
    path: Path, container: InputContainer, stream: VideoStream, rate: float, seconds: float | None
) -> Iterator[Picture]:
    first: float | None = None
    last, broken, reason = -1.0, 0, ""
    for frame in _frames(container, stream):
        if isinstance(frame, Exception):
            broken, reason = broken + 1, _reason(frame)
            continue
        if frame.is_corrupt:
            broken, reason = broken + 1, "pictures are damaged"
            continue
        moment = frame.time if frame.time is not None else (first or 0.0) + last + 1 / rate
        first = moment if first is None else first
        if moment - first <= last:
            continue  # a repeated picture
        last = moment - first
        yield Picture(last, _upright(frame, stream))
    if first is None:
        raise BodysenseError(f"{path}: none of its pictures can be read ({reason or 'it is empty'}); is it complete?")
    is_short = seconds is not None and last + 1 / rate < seconds - max(_SHORT, 2 / rate)
    if is_short:
        reason = reason or f"it should last {seconds:.1f} s"
        raise VideoBrokenError(f"{path}: damaged, read up to {last:.2f} s ({reason}); the readable pictures were used")
    if broken:
        raise VideoBrokenError(f"{path}: damaged in places ({reason}); the readable pictures were used")


def _frames(container: InputContainer, stream: VideoStream) -> Iterator[VideoFrame | Exception]:
    """Iterate over the frames of a file; yield an error for a broken frame, and as the last item if reading fails."""
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets)
        except StopIteration:
            return
        except (OSError, ValueError) as error:
            yield error
            return
        try:
            yield from packet.decode()  # type: ignore[misc]  # frames of a video stream
        except (OSError, ValueError) as error:
            yield error


def _upright(frame: VideoFrame, stream: VideoStream) -> np.ndarray:
    """Return the pixels (H, W, 3) of a frame, rotated and scaled for display."""
    shape = stream.sample_aspect_ratio
    width, height = frame.width * float(shape or 1), float(frame.height)
    scale = min(1.0, LARGEST / max(width, height))
    pixels = frame.to_ndarray(format="rgb24", width=max(round(width * scale), 2), height=max(round(height * scale), 2))
    return np.ascontiguousarray(np.rot90(pixels, round(frame.rotation / 90)))


def _open_folder(path: Path, rate: float) -> Video:
    from PIL import Image, ImageOps

    if not rate > 0:
        raise BodysenseError(f"--image-rate {rate:g}: give a rate in Hz, above 0")
    files = sorted(
        (file for file in path.iterdir() if file.suffix.lower() in IMAGES and file.is_file()),
        key=lambda file: natural_order(file.name),
    )
    if not files:
        raise BodysenseError(f"{path}: the folder has no images; valid are {', '.join(IMAGES)}")

    def pictures() -> Iterator[Picture]:
        for number, file in enumerate(files):
            try:
                with Image.open(file) as image:
                    upright = ImageOps.exif_transpose(image).convert("RGB")
            except (OSError, ValueError, SyntaxError) as error:
                if not number:
                    raise BodysenseError(f"{file}: not an image that can be read ({_reason(error)})") from None
                raise VideoBrokenError(
                    f"{file}: not an image that can be read ({_reason(error)}); the images before it were used"
                ) from None
            upright.thumbnail((LARGEST, LARGEST))
            yield Picture(number / rate, np.array(upright))

    return Video(path.name, rate, len(files), pictures(), lambda: None)


def _open_webcam(index: int) -> Video:
    cv2 = _load("cv2")
    with silence():
        camera = cv2.VideoCapture(index)
    if not camera.isOpened():
        raise BodysenseError(f"webcam {index}: not found, or used by another program; give another index or a file")
    camera.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # the newest picture, not a queued one

    def pictures() -> Iterator[Picture]:
        begun = clock.monotonic()
        while True:
            good, pixels = camera.read()
            if not good:
                raise VideoBrokenError(f"webcam {index}: no more pictures; those before were used")
            yield Picture(clock.monotonic() - begun, np.ascontiguousarray(pixels[..., ::-1]))

    return Video(f"webcam {index}", float(camera.get(cv2.CAP_PROP_FPS) or 30.0), None, pictures(), camera.release)


def _load(name: str) -> Any:
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        raise missing_package(error) from None


def _reason(error: Exception) -> str:
    return (getattr(error, "strerror", None) or " ".join(str(error).split()) or type(error).__name__).rstrip(".")
