"""Bodies side by side, untracked parts in red, as an animated WebP or a picture of a few moments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.body.skin import UNSEEN, BodySkin, fit_skin, place_skin
from bodysense.files import written_beside
from bodysense.pictures.animation import write_pictures
from bodysense.pictures.camera import Lens, follow_body
from bodysense.pictures.painter import BodyPainter

LENS = Lens(width=360, height=420, aim=0.93, view_height=2.0)
_INK, _BAND = (34, 48, 60), 34  # colour of the captions, and their height in pixels


@dataclass(frozen=True, eq=False)
class View:
    """One body of a comparison."""

    title: str
    pose: Pose  # (T,)
    tracked: np.ndarray | None = None  # (T, P) bool: the rest is painted red


def draw_views(
    views: Sequence[View], rate: float, frames: Iterable[int] | None = None, lens: Lens = LENS
) -> Iterator[np.ndarray]:
    """Yield pictures (H, W, 3) uint8 of bodies side by side, seen by one camera, which follows the first body.

    `frames` are drawn, all if omitted.
    """
    camera = follow_body(views[0].pose, rate, lens)
    painter, heading = BodyPainter(camera), _captions(views, lens)
    bodies = [(fit_skin(view.pose.skeleton), place_skin(fit_skin(view.pose.skeleton), view.pose)) for view in views]
    for frame in range(len(camera)) if frames is None else frames:
        pictures = []
        for view, (skin, balls) in zip(views, bodies, strict=True):
            drawn = skin if view.tracked is None else _with_untracked_red(skin, view.pose.skeleton, view.tracked[frame])
            pictures.append(painter.draw(drawn, balls[frame], camera.eye(frame)))
        yield np.concatenate([heading, np.concatenate(pictures, axis=1)])


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


def _with_untracked_red(skin: BodySkin, skeleton: Skeleton, tracked: np.ndarray) -> BodySkin:
    """Return the skin with links in red whose nearest points are not `tracked` (P,)."""
    seen = tracked[_nearest_points(skeleton)]
    return replace(skin, color=np.where(seen[skin.link].all(axis=1), skin.color, UNSEEN))


@lru_cache(maxsize=8)
def _nearest_points(skeleton: Skeleton) -> np.ndarray:
    """Return for each ball of the skin (N,) the nearest point in the rest pose: its joint or a child of the joint."""
    skin, rest = fit_skin(skeleton), skeleton.path @ skeleton.rest_offset
    place = rest[skin.joint] + skin.center
    near = np.linalg.norm(place[:, None] - rest, axis=-1)
    parents = np.array(skeleton.parents)
    own = (np.arange(len(rest)) == skin.joint[:, None]) | (parents == skin.joint[:, None])
    return np.where(own, near, np.inf).argmin(axis=1)


def _captions(views: Sequence[View], lens: Lens) -> np.ndarray:
    """Draw the titles of the views: (_BAND, W, 3) uint8."""
    from PIL import Image, ImageDraw, ImageFont

    band = Image.new("RGB", (lens.width * len(views), _BAND), (255, 255, 255))
    draw, font = ImageDraw.Draw(band), ImageFont.load_default(16)
    for k, view in enumerate(views):
        draw.text(((k + 0.5) * lens.width, _BAND / 2), view.title, fill=_INK, font=font, anchor="mm")
    return np.asarray(band)
