"""Videos of a completed body: on the left over its source video, on the right from the side."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.keypoints import Camera
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.surface import fit_surface
from bodysense.devices.video.person import PersonTrack
from bodysense.devices.video.pictures import Picture
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.pictures.camera import FollowingCamera, Lens
from bodysense.pictures.painter import BodyPainter

if TYPE_CHECKING:
    from PIL.Image import Image

    from bodysense.devices.video.device import VideoFrames

_LEFT, _RIGHT, _MIDDLE = (255, 176, 46), (64, 200, 255), (255, 255, 255)  # the person's sides, and between them
_DISC = (20, 24, 28)
NUMBERED = 2.0  # s at the beginning of a video in which people's numbers are displayed
_FINE = 2  # samples per pixel, across and down
_TURN = np.radians(28.0)  # direction of the camera for the body on the right


class Overlay(AbstractContextManager["Overlay"]):
    """A video, written picture by picture: on the left the source with the body over it, on the right the body.

    The file appears if the block succeeds. Raises BodysenseError if it cannot be written.
    """

    def __init__(self, path: str | Path, rate: float) -> None:
        """Prepare a video at `path` with about `rate` pictures a second; each picture has its own time."""
        self._path, self._rate = Path(path), rate
        self._stack = ExitStack()
        self._stream: Any = None
        self._last = -1

    def __enter__(self) -> Overlay:
        import av

        with ExitStack() as stack:
            part = stack.enter_context(written_beside(self._path))
            try:
                self._container = stack.enter_context(av.open(str(part), "w"))
            except (OSError, ValueError):
                raise BodysenseError(f"{self._path}: no video of this kind can be written; name it .mp4") from None
            self._stack = stack.pop_all()
        return self

    def add(
        self,
        pictures: Sequence[Picture],
        pose: Pose,
        frames: VideoFrames,
        people: Sequence[Sequence[PersonTrack]] = (),
    ) -> None:
        """Add pictures of `frames`, all of one size, with a body (T, …) in the world where a person is seen.

        `people` are the people in each picture. If there are several, their numbers are drawn on the first pictures.
        """
        for k, picture in enumerate(pictures):
            seen_by = Camera(*(values[k] for values in vars(frames.camera).values()))
            pixels = picture.pixels
            if people and len(people[k]) > 1 and picture.time < NUMBERED:
                pixels = draw_numbers(pixels, people[k])
            self.show(picture.time, pixels, pose[k] if frames.person.has_body[k] else None, seen_by)

    def show(self, time: float, pixels: np.ndarray, pose: Pose | None, camera: Camera) -> None:
        """Add one picture (H, W, 3) at `time` s with a body in the world, if any, and the camera that sees it."""
        import av

        picture = side_by_side(pixels, pose, camera)
        if self._stream is None:
            self._stream = self._container.add_stream("libx264", rate=Fraction(self._rate).limit_denominator(1001))
            self._stream.width, self._stream.height = picture.shape[1], picture.shape[0]
            self._stream.pix_fmt, self._stream.options = "yuv420p", {"crf": "20", "preset": "veryfast"}
            self._stream.codec_context.time_base = Fraction(1, 1000)
        frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame.time_base = Fraction(1, 1000)
        frame.pts = self._last = max(round(1000 * time), self._last + 1)
        self._container.mux(self._stream.encode(frame))

    def __exit__(self, *error: object) -> None:
        if error[0] is None and self._stream is not None:
            self._container.mux(self._stream.encode())
        self._stack.__exit__(*error)  # type: ignore[arg-type]


def draw_numbers(pixels: np.ndarray, people: Sequence[PersonTrack]) -> np.ndarray:
    """Draw each person's number on their trunk; return the picture (H, W, 3)."""
    from PIL import Image, ImageDraw, ImageFont

    whole = Image.fromarray(pixels)
    draw, (wide, high) = ImageDraw.Draw(whole), whole.size
    size = max(high // 14, 12)
    font, radius = ImageFont.load_default(size), 0.8 * size
    for one in people:
        x, y = one.place * high * [1, -1] + [wide / 2, high / 2]
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=_DISC, outline=_MIDDLE, width=2)
        draw.text((x, y), str(one.number), fill=_MIDDLE, font=font, anchor="mm")
    return np.array(whole)


def side_by_side(pixels: np.ndarray, pose: Pose | None, camera: Camera) -> np.ndarray:
    """Draw a body over a picture, and to the right of it the body from its left: (H, W′, 3) uint8, even sizes.

    `pixels` (H, W, 3) is the picture of `camera`. Without a body it is unchanged, next to an empty field.
    """
    from PIL import Image

    high, wide = (size // 2 * 2 for size in pixels.shape[:2])
    beside = round(0.8 * high / 2) * 2
    whole = Image.new("RGB", (wide + beside, high))
    if pose is None:
        whole.paste(Image.fromarray(pixels[:high, :wide]))
        return np.array(whole)
    whole.paste(_draw_over(pixels[:high, :wide], pose, camera))
    whole.paste(Image.fromarray(_draw_side_view((beside, high), pose)), (wide, 0))
    return np.array(whole)


def _draw_over(pixels: np.ndarray, pose: Pose, camera: Camera) -> Image:
    """Draw the bones of the skeleton over a picture."""
    from PIL import Image, ImageDraw

    high, wide = pixels.shape[:2]
    skeleton = pose.skeleton
    seen = (np.asarray(forward_kinematics(pose)[0]) - camera.position) @ camera.axes
    places = camera.focal * seen[:, :2] / np.maximum(-seen[:, 2:], 0.1)
    x, y = (_FINE * (places * high * [1, -1] + [wide / 2, high / 2])).T
    layer = Image.new("RGBA", (wide * _FINE, high * _FINE))
    draw = ImageDraw.Draw(layer)
    thick = high / 160 * _FINE
    for is_rim in (True, False):  # a dark rim under all bones
        for point, parent in enumerate(skeleton.parents[1:], start=1):
            width = thick * (1.7 if is_rim else 1.0) * (0.5 if skeleton.wrist_of[point] >= 0 else 1.0)
            name = skeleton.points[point]
            of_side = _LEFT if name.startswith("left") else _RIGHT if name.startswith("right") else _MIDDLE
            color = (20, 24, 28, 110) if is_rim else (*of_side, 235)
            draw.line([(x[parent], y[parent]), (x[point], y[point])], fill=color, width=max(round(width), 1))
    whole = Image.fromarray(pixels).convert("RGBA")
    whole.alpha_composite(layer.reduce(_FINE))
    return whole.convert("RGB")


@lru_cache(maxsize=4)
def _painter(width: int, height: int, floor: float, scale: float) -> BodyPainter:
    """Return the painter of the body on the right, for a body at the origin."""
    lens = Lens(width, height, eye=1.5, view_height=2.2)
    return BodyPainter(FollowingCamera(lens, follow=np.zeros((1, 2)), turn=_TURN, floor=floor, scale=scale))


def _draw_side_view(size: tuple[int, int], pose: Pose) -> np.ndarray:
    """Return a picture of the body on a floor, from the camera's right."""
    skeleton = pose.skeleton
    ground = float((skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0])[:, 1].min())
    painter = _painter(*size, ground, skeleton.height / 1.7)
    (mesh,) = fit_surface(skeleton).placed(Pose(skeleton, pose.root_position[None], pose.rotation[None]))
    return painter.draw(mesh, painter.camera.eye(0) + pose.root_position * [1, 0, 1])
