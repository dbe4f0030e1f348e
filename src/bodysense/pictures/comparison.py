"""Bodies and stick figures side by side, untracked parts in red: an animated WebP, or a picture of a few moments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.body.surface import UNSEEN, Mesh, fit_surface, nearest_points
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.pictures.animation import write_pictures
from bodysense.pictures.camera import Lens, follow_body
from bodysense.pictures.painter import BodyPainter

LENS = Lens(width=360, height=420, aim=0.93, view_height=2.0)
_INK, _BAND = (34, 48, 60), 34  # colour of the captions, and their height in pixels
_THICK, _THIN = 0.018, 0.006  # m, radius of a stick figure's bones, and of its fingers
_STICK = np.array([0.04, 0.04, 0.05], np.float32)  # linear red, green, blue of a stick figure
_AROUND, _RINGS = 8, 3  # vertices around a bone, and rings at each of its ends


@dataclass(frozen=True, eq=False)
class View:
    """One body of a comparison."""

    title: str
    pose: Pose  # (T,)
    tracked: np.ndarray | None = None  # (T, P) bool: the rest is painted red
    position: np.ndarray | None = None  # (T, P, 3) m, world: drawn as a stick figure instead of the posed body


def draw_views(
    views: Sequence[View], rate: float, frames: Iterable[int] | None = None, lens: Lens = LENS
) -> Iterator[np.ndarray]:
    """Yield pictures (H, W, 3) uint8 of bodies side by side, seen by one camera, which follows the first body.

    `frames` are drawn, all if omitted.
    """
    heading = caption([view.title for view in views], lens.width)
    for picture in _side_by_side(views, rate, frames, lens):
        yield np.concatenate([heading, picture])


def draw_rows(views: Sequence[View], rate: float, frames: Iterable[int], lens: Lens = LENS) -> np.ndarray:
    """Return a picture (H, W, 3) uint8 with a column for each view, under its title, and a row for each frame.

    A row is seen from the front left of the first body in its frame.
    """
    rows = [caption([view.title for view in views], lens.width)]
    for frame in frames:
        rows += _side_by_side([_at(view, slice(frame, frame + 1)) for view in views], rate, None, lens)
    return np.concatenate(rows)


def write_comparison(path: str | Path, views: Sequence[View], rate: float, lens: Lens = LENS) -> None:
    """Write bodies side by side, at `rate` Hz, as an animated WebP that repeats for ever."""
    write_pictures(path, draw_views(views, rate, lens=lens), rate)


def write_moments(path: str | Path, views: Sequence[View], rate: float, moments: int = 4, lens: Lens = LENS) -> None:
    """Write a picture (PNG) of a few moments, evenly spaced, two in a row."""
    from PIL import Image

    count = len(views[0].pose.root_position)
    chosen = np.linspace(0, count - 1, moments + 2).round().astype(int)[1:-1]
    pictures = list(draw_views(views, rate, chosen.tolist(), lens))
    rows = [np.concatenate(pictures[first : first + 2], axis=1) for first in range(0, moments - 1, 2)]
    with written_beside(path) as beside:
        Image.fromarray(np.concatenate(rows)).save(beside)


def write_picture(path: str | Path, picture: np.ndarray) -> None:
    """Write a picture (H, W, 3) uint8 as .png or .webp. Raises BodysenseError for other endings."""
    from PIL import Image

    kind = Path(path).suffix.lower()
    if kind not in (".png", ".webp"):
        raise BodysenseError(f"{path}: a picture is written as .png or .webp; give a name with this ending")
    with written_beside(path) as beside:
        Image.fromarray(picture).save(beside, format=kind[1:], quality=82, method=6)


def caption(titles: Sequence[str], width: int) -> np.ndarray:
    """Return a band (H, W, 3) uint8 with titles, each above a column of `width` pixels."""
    from PIL import Image, ImageDraw, ImageFont

    band = Image.new("RGB", (width * len(titles), _BAND), (255, 255, 255))
    draw, font = ImageDraw.Draw(band), ImageFont.load_default(16)
    for k, title in enumerate(titles):
        draw.text(((k + 0.5) * width, _BAND / 2), title, fill=_INK, font=font, anchor="mm")
    return np.asarray(band)


def _side_by_side(views: Sequence[View], rate: float, frames: Iterable[int] | None, lens: Lens) -> Iterator[np.ndarray]:
    """Yield pictures (H, W, 3) uint8 of the views of a frame, without titles."""
    camera = follow_body(views[0].pose, rate, lens)
    painter = BodyPainter(camera)
    for frame in range(len(camera)) if frames is None else frames:
        drawn = [painter.draw(_mesh(view, frame), camera.eye(frame)) for view in views]
        yield np.concatenate(drawn, axis=1)


def _at(view: View, frames: slice) -> View:
    """Return some frames of a view."""
    tracked, position = (None if one is None else one[frames] for one in (view.tracked, view.position))
    return View(view.title, view.pose[frames], tracked, position)


def _mesh(view: View, frame: int) -> Mesh:
    """Return the posed body or the stick figure of a frame, with parts that are not tracked in red."""
    skeleton = view.pose.skeleton
    if view.position is not None:
        mesh, point = stick_figure(skeleton, view.position[frame])
    else:
        (mesh,) = fit_surface(skeleton).placed(view.pose[frame : frame + 1])
        point = nearest_points(skeleton)
    if view.tracked is None:
        return mesh
    return replace(mesh, color=np.where(view.tracked[frame, point, None], mesh.color, UNSEEN))


def stick_figure(skeleton: Skeleton, position: np.ndarray) -> tuple[Mesh, np.ndarray]:
    """Return round bones between points at (P, 3) m, and the point (V,) that each vertex belongs to."""
    point = np.arange(1, len(skeleton.points))
    ends = np.stack([position[np.array(skeleton.parents)[1:]], position[1:]], axis=1)  # (L, 2, 3)
    radius = np.where(skeleton.wrist_of[1:] >= 0, _THIN, _THICK) * skeleton.height / 1.7
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    axis = np.where(length > 1e-9, along / np.maximum(length, 1e-9), [0.0, 1.0, 0.0])
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    round_ = np.stack([across, np.cross(axis, across)], axis=1)  # (L, 2, 3)
    angle = np.arange(_AROUND) * (2 * np.pi / _AROUND)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ round_  # (L, A, 3)
    latitude = np.linspace(0, np.pi / 2, _RINGS)
    latitude = np.stack([latitude - np.pi / 2, latitude])[:, :, None, None]  # (2, R, 1, 1)
    normal = np.sin(latitude) * axis[:, None, None, None] + np.cos(latitude) * circle[:, None, None]  # (L, 2, R, A, 3)
    place = ends[:, :, None, None] + radius[:, None, None, None, None] * normal
    ring, around = np.arange(2 * _RINGS - 1)[:, None] * _AROUND, np.arange(_AROUND)
    a, b = ring + around, ring + (around + 1) % _AROUND
    triangle = np.concatenate(
        [np.stack([a, b, b + _AROUND], axis=-1), np.stack([a, b + _AROUND, a + _AROUND], axis=-1)]
    )
    size = 2 * _RINGS * _AROUND
    mesh = Mesh(
        place.reshape(-1, 3),
        normal.reshape(-1, 3),
        np.tile(_STICK, (size * len(point), 1)),
        (np.arange(len(point))[:, None, None] * size + triangle.reshape(-1, 3)).reshape(-1, 3),
    )
    return mesh, np.repeat(point, size)
