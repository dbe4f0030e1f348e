"""Bodies and stick figures side by side, untracked parts in red: an animated WebP, or a picture of a few moments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.body.skin import SHOES, UNSEEN, BodySkin, fit_skin, place_skin
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.pictures.animation import write_pictures
from bodysense.pictures.camera import Lens, follow_body
from bodysense.pictures.painter import BodyPainter

LENS = Lens(width=360, height=420, aim=0.93, view_height=2.0)
_INK, _BAND = (34, 48, 60), 34  # colour of the captions, and their height in pixels
_THICK, _THIN = 0.018, 0.006  # m, radius of a stick figure's bones, and of its fingers


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


@dataclass(frozen=True, eq=False)
class _Figure:
    """A view's balls: of the posed body, or of a stick figure."""

    skin: BodySkin
    balls: np.ndarray  # (T, N, 3) m
    point: np.ndarray  # (N,) point of the skeleton whose tracking colours each ball


def _side_by_side(views: Sequence[View], rate: float, frames: Iterable[int] | None, lens: Lens) -> Iterator[np.ndarray]:
    """Yield pictures (H, W, 3) uint8 of the views of a frame, without titles."""
    camera = follow_body(views[0].pose, rate, lens)
    painter, figures = BodyPainter(camera), [_figure(view) for view in views]
    for frame in range(len(camera)) if frames is None else frames:
        yield np.concatenate(
            [
                painter.draw(_coloured(figure, view.tracked, frame), figure.balls[frame], camera.eye(frame))
                for view, figure in zip(views, figures, strict=True)
            ],
            axis=1,
        )


def _at(view: View, frames: slice) -> View:
    """Return some frames of a view."""
    tracked, position = (None if one is None else one[frames] for one in (view.tracked, view.position))
    return View(view.title, view.pose[frames], tracked, position)


def _figure(view: View) -> _Figure:
    skeleton = view.pose.skeleton
    if view.position is None:
        skin = fit_skin(skeleton)
        return _Figure(skin, place_skin(skin, view.pose), _nearest_points(skeleton))
    return _Figure(_stick_skin(skeleton), view.position, np.arange(len(skeleton.points)))


@lru_cache(maxsize=8)
def _stick_skin(skeleton: Skeleton) -> BodySkin:
    """Return a ball at every point, and a link along every bone."""
    point = np.arange(len(skeleton.points))
    link = np.stack([point[1:], np.array(skeleton.parents)[1:]], axis=-1)
    return BodySkin(
        joint=point,
        center=np.zeros((len(point), 3)),
        radius=np.where(skeleton.wrist_of >= 0, _THIN, _THICK) * skeleton.height / 1.7,
        link=link,
        color=np.full(len(link), SHOES),
        part=np.arange(len(link)),  # each bone is in front of or behind every other
    )


def _coloured(figure: _Figure, tracked: np.ndarray | None, frame: int) -> BodySkin:
    """Return the skin with links in red whose points are not `tracked` (T, P) in a frame."""
    if tracked is None:
        return figure.skin
    seen = tracked[frame][figure.point][figure.skin.link].all(axis=1)
    return replace(figure.skin, color=np.where(seen, figure.skin.color, UNSEEN))


@lru_cache(maxsize=8)
def _nearest_points(skeleton: Skeleton) -> np.ndarray:
    """Return for each ball of the skin (N,) the nearest point in the rest pose: its joint or a child of the joint."""
    skin, rest = fit_skin(skeleton), skeleton.path @ skeleton.rest_offset
    place = rest[skin.joint] + skin.center
    near = np.linalg.norm(place[:, None] - rest, axis=-1)
    parents = np.array(skeleton.parents)
    own = (np.arange(len(rest)) == skin.joint[:, None]) | (parents == skin.joint[:, None])
    return np.where(own, near, np.inf).argmin(axis=1)
