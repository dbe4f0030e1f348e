"""Painter of a shaded body on a floor: each part of the body is drawn as outlines in a few shades, from far to near."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.skin import COLORS, BodySkin
from bodysense.pictures.camera import FollowingCamera

if TYPE_CHECKING:
    from PIL.Image import Image

_FINE = 2  # samples per pixel, across and down
_SHADES = ((1.0, 0.72), (0.87, 0.81), (0.74, 0.9), (0.58, 0.98), (0.42, 1.06))  # share of a radius, brightness there
_LAMP = np.array([-0.35, -0.6])  # offset of the brightest line toward the lamp, across and down, in radii
_CORNERS = 12  # of an outline, at each end of a link
_SKY, _FLOOR, _LINE = (232, 237, 242), (209, 212, 214), (173, 178, 184)
_GRID, _LINE_WIDTH = 0.5, 0.012  # m
_CELL, _CELLS = 0.04, 96  # m and number of a shadow's cells each way
_SHADOW_HEIGHT, _SHADOW_BLUR, _SHADOW_DEPTH = 0.35, 0.07, 0.5  # m, m, share: how it fades, how soft, how dark


@dataclass(frozen=True, eq=False)
class BodyPainter:
    """Painter of the pictures of one camera, at any position on its path."""

    camera: FollowingCamera

    def draw(self, skin: BodySkin, balls: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """Return a picture (H, W, 3) uint8 of a body.

        Its balls are at (N, 3) m, and the camera at `eye` (3,) m (`FollowingCamera.eye`), both in the world.
        """
        from PIL import Image, ImageDraw

        ground = self._ground(skin, balls, eye)
        picture = ground.resize((ground.width * _FINE, ground.height * _FINE), Image.Resampling.NEAREST)
        pen = ImageDraw.Draw(picture)
        x, y, back = ((balls - eye) @ self.camera.axes).T
        depth = np.maximum(-back, 2 * skin.radius)  # balls that touch the camera are drawn too far away
        focus = self.camera.focal_length * picture.height
        middle = np.stack([picture.width / 2 + focus * x / depth, picture.height / 2 - focus * y / depth], axis=-1)
        radius = focus * skin.radius / depth
        outlines = [
            _outlines(skin, middle + (1 - share) * radius[:, None] * _LAMP, share * radius) for share, _ in _SHADES
        ]
        colors = np.round(255 * np.clip([COLORS[skin.color] * light for _, light in _SHADES], 0, 1)).astype(int)
        behind = np.bincount(skin.part, depth[skin.link].mean(axis=1)) / np.maximum(np.bincount(skin.part), 1)
        # Colours have a fixed order within a part. Sorted by depth, shirt and trousers would flicker.
        order = np.lexsort((-skin.color, -behind[skin.part]))
        group = (skin.part * len(COLORS) + skin.color)[order]
        for links in np.split(order, np.flatnonzero(np.diff(group)) + 1):
            for outline, color in zip(outlines, colors, strict=True):
                for link in links:
                    pen.polygon(outline[link].ravel().tolist(), fill=tuple(color[link].tolist()))
        return np.asarray(picture.reduce(_FINE))

    def _ground(self, skin: BodySkin, balls: np.ndarray, eye: np.ndarray) -> Image:
        """Draw the sky, and the floor with its lines and the shadow of the body."""
        from PIL import Image

        place, pixel, sky = self._floor
        beside = np.abs(((place + eye[[0, 2], None, None].astype(np.float32)) / _GRID + 0.5) % 1 - 0.5) * _GRID
        line = ((_LINE_WIDTH / 2 + pixel / 2 - beside) / pixel).clip(0, 1).max(axis=0)
        picture = Image.new("RGB", sky.size, _FLOOR)
        picture.paste(_LINE, mask=Image.fromarray((255 * line).astype(np.uint8)))
        picture.paste((0, 0, 0), mask=self._shadow(skin, balls, eye))
        picture.paste(_SKY, mask=sky)
        return picture

    @cached_property
    def _floor(self) -> tuple[np.ndarray, np.ndarray, Image]:
        """Points of the floor in the pixels.

        World x and z relative to the camera (2, H, W), the width of a pixel along each (2, H, W), and the mask by which
        the floor fades into the sky.
        """
        from PIL import Image

        ray = np.moveaxis(self.camera.rays() @ self.camera.axes.T, -1, 0)
        reach = self.camera.lens.eye / np.maximum(-ray[1], 0.02)
        place = self.camera.scale * reach * ray[[0, 2]]
        pixel = np.maximum(*(np.abs(np.gradient(place, axis=axis)) for axis in (1, 2)))
        sky = (255 * np.clip((reach - 5) / 9, 0, 1)).astype(np.uint8)
        return place.astype(np.float32), pixel.clip(1e-4).astype(np.float32), Image.fromarray(sky)

    def _shadow(self, skin: BodySkin, balls: np.ndarray, eye: np.ndarray) -> Image:
        """Draw the shadow of the body on the floor, as a mask: soft, and darker near contact.

        The shadow is drawn from above, the highest links first, and then projected into the picture.
        """
        from PIL import Image, ImageDraw, ImageFilter

        above = Image.new("L", (_CELLS, _CELLS))
        pen = ImageDraw.Draw(above)
        corner = balls[:, [0, 2]].mean(axis=0) - _CELL * _CELLS / 2
        height = (balls[:, 1] - self.camera.floor).clip(0)[skin.link].mean(axis=1)
        outlines = _outlines(skin, (balls[:, [0, 2]] - corner) / _CELL, skin.radius / _CELL)
        dark = 255 * _SHADOW_DEPTH * np.exp(-height / _SHADOW_HEIGHT)
        for link in np.argsort(dark):
            pen.polygon(outlines[link].ravel().tolist(), fill=int(dark[link]))
        above = above.filter(ImageFilter.GaussianBlur(_SHADOW_BLUR / _CELL))
        high, wide = self.camera.lens.height, self.camera.lens.width
        focus = self.camera.focal_length * high
        # Directions (x, y, z) through pixels (column, row, 1), and the cells (x, z) where they meet the floor.
        ray = self.camera.axes @ np.array(
            [[1 / focus, 0, -wide / 2 / focus], [0, -1 / focus, high / 2 / focus], [0, 0, -1]]
        )
        cells = ((eye[1] - self.camera.floor) * ray[[0, 2]] - (eye[[0, 2]] - corner)[:, None] * ray[1]) / _CELL
        homography = (np.concatenate([cells.ravel(), -ray[1]]) / -ray[1, 2])[:8].tolist()
        return above.transform((wide, high), Image.Transform.PERSPECTIVE, homography, Image.Resampling.BILINEAR)


def _outlines(skin: BodySkin, middle: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return the corners (L, 2 * _CORNERS, 2) of the hulls of links whose balls are discs with middles (N, 2)."""
    (first, second), size = middle[skin.link].swapaxes(0, 1), radius[skin.link]
    along = second - first
    # The tangents touch both discs at this angle from the axis.
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
    touch = np.arccos(np.clip((size[:, 0] - size[:, 1]) / length, -1, 1))[:, None]
    share = np.linspace(0, 1, _CORNERS)
    angle = np.concatenate([touch + share * 2 * (np.pi - touch), (2 * share - 1) * touch], axis=1)
    angle += np.arctan2(along[:, 1], along[:, 0])[:, None]
    reach = np.repeat(size, _CORNERS, axis=1)[..., None]
    return np.repeat(np.stack([first, second], axis=1), _CORNERS, axis=1) + reach * np.stack(
        [np.cos(angle), np.sin(angle)], axis=-1
    )
