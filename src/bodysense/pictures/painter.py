"""Painter of shaded meshes on a floor, with the nearest surface in each sample of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.surface import Mesh
from bodysense.pictures.camera import FollowingCamera

if TYPE_CHECKING:
    from PIL.Image import Image

_FINE = 2  # samples per pixel, across and down
_THINNEST = 1e-6  # square samples of twice a triangle's area; thinner ones are not drawn
_NEAR = 0.05  # m: surfaces that are nearer are drawn at this distance
# The page's lights (web/src/view/scene.ts) as shares of reflected light: from above, from below, and of lamps, whose
# directions are in the camera's axes along the floor.
_FROM_ABOVE, _FROM_BELOW = 0.49, 0.31
_LAMPS = (
    (np.array([1.6, 3.4, 2.4]) / np.linalg.norm([1.6, 3.4, 2.4]), 0.67),
    (np.array([-2.5, 2.6, -3.0]) / np.linalg.norm([-2.5, 2.6, -3.0]), 0.35),
)
_SKY, _FLOOR, _LINE = (232, 237, 242), (209, 212, 214), (173, 178, 184)
_GRID, _LINE_WIDTH = 0.5, 0.012  # m
_CELL, _CELLS = 0.04, 96  # m and number of a shadow's cells each way
_SHADOW_HEIGHT, _SHADOW_BLUR, _SHADOW_DEPTH = 0.35, 0.07, 0.5  # m, m, share: how it fades, how soft, how dark


@dataclass(frozen=True, eq=False)
class BodyPainter:
    """Painter of the pictures of one camera, at any position on its path."""

    camera: FollowingCamera

    def draw(self, mesh: Mesh, eye: np.ndarray) -> np.ndarray:
        """Return a picture (H, W, 3) uint8 of a mesh in the world, seen from `eye` (3,) m (`FollowingCamera.eye`)."""
        ground = np.asarray(self._ground(mesh, eye))
        high, wide = ground.shape[:2]
        x, y, back = ((mesh.position - eye) @ self.camera.axes).astype(np.float32).T
        depth = np.maximum(-back, np.float32(_NEAR))
        focus = np.float32(self.camera.focal_length * high * _FINE)
        place = np.stack([wide * _FINE / 2 + focus * x / depth, high * _FINE / 2 - focus * y / depth], axis=-1)
        light = mesh.color * self._light(mesh.normal)[:, None]
        first = np.clip(np.floor(place.min(axis=0) / _FINE), 0, [wide, high]).astype(int)
        last = np.clip(np.ceil(place.max(axis=0) / _FINE), first, [wide, high]).astype(int)
        size = (int(last[1] - first[1]) * _FINE, int(last[0] - first[0]) * _FINE)
        color, cover = rasterize(place - (first * _FINE).astype(np.float32), depth, light, mesh.triangle, size)
        color, cover = _pixel_sums(color), _pixel_sums(cover.astype(np.float32))
        drawn = np.nonzero(cover)
        samples = cover[drawn][:, None]
        share = samples / _FINE**2
        picture = ground.copy()
        part = picture[first[1] : last[1], first[0] : last[0]]
        part[drawn] = np.round(255 * _srgb(color[drawn] / samples) * share + part[drawn] * (1 - share))
        return picture

    def _light(self, normal: np.ndarray) -> np.ndarray:
        """Return how much light (V,) surfaces with unit normals (V, 3) reflect."""
        toward = self.camera.axes[:, 2] * [1.0, 0.0, 1.0]
        back = toward / np.linalg.norm(toward)
        turn = np.stack([[back[2], 0.0, -back[0]], [0.0, 1.0, 0.0], back], axis=1)
        light = (_FROM_ABOVE + _FROM_BELOW) / 2 + (_FROM_ABOVE - _FROM_BELOW) / 2 * normal[:, 1]
        for lamp, bright in _LAMPS:
            light = light + bright * np.maximum(normal @ (turn @ lamp), 0)
        return light.astype(np.float32)

    def _ground(self, mesh: Mesh, eye: np.ndarray) -> Image:
        """Draw the sky, and the floor with its lines and the shadow of the body."""
        from PIL import Image

        place, pixel, sky = self._floor
        beside = np.abs(((place + eye[[0, 2], None, None].astype(np.float32)) / _GRID + 0.5) % 1 - 0.5) * _GRID
        line = ((_LINE_WIDTH / 2 + pixel / 2 - beside) / pixel).clip(0, 1).max(axis=0)
        picture = Image.new("RGB", sky.size, _FLOOR)
        picture.paste(_LINE, mask=Image.fromarray((255 * line).astype(np.uint8)))
        picture.paste((0, 0, 0), mask=self._shadow(mesh, eye))
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

    def _shadow(self, mesh: Mesh, eye: np.ndarray) -> Image:
        """Draw the shadow of the mesh on the floor, as a mask: soft, and darker near contact.

        The shadow is drawn from above, in cells of the floor, and then projected into the picture.
        """
        from PIL import Image, ImageFilter

        position = mesh.position
        corner = position[:, [0, 2]].mean(axis=0) - _CELL * _CELLS / 2
        column, row = np.floor((position[:, [0, 2]] - corner) / _CELL).astype(int).T
        inside = (column >= 0) & (column < _CELLS) & (row >= 0) & (row < _CELLS)
        dark = 255 * _SHADOW_DEPTH * np.exp(-(position[:, 1] - self.camera.floor).clip(0) / _SHADOW_HEIGHT)
        cells = np.zeros((_CELLS, _CELLS), np.uint8)
        np.maximum.at(cells, (row[inside], column[inside]), dark[inside].astype(np.uint8))
        above = Image.fromarray(cells)
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


def rasterize(
    place: np.ndarray, depth: np.ndarray, color: np.ndarray, triangle: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return colours (H, W, 3) and covers (H, W) of the nearest triangles in a picture of a size (H, W).

    Args:
        place: (V, 2) of vertices in the picture, across and down, in pixels.
        depth: (V,) m.
        color: (V, 3).
        triangle: (F, 3) vertices; triangles that are clockwise in the picture face away and are not drawn.
    """
    high, wide = size
    nearest = np.full(high * wide, np.inf, np.float32)
    image = np.zeros((high * wide, 3), np.float32)
    place, depth = place.astype(np.float32), depth.astype(np.float32)
    zero, one, two = (place[triangle[:, k]] for k in range(3))  # (F, 2) each
    area = (one[:, 0] - zero[:, 0]) * (two[:, 1] - zero[:, 1]) - (one[:, 1] - zero[:, 1]) * (two[:, 0] - zero[:, 0])
    front = np.flatnonzero(area < -_THINNEST)
    zero, one, two = zero[front], one[front], two[front]
    first = np.ceil(np.minimum(np.minimum(zero, one), two) - 0.5).clip(0).astype(np.int32)
    last = np.floor(np.maximum(np.maximum(zero, one), two) - 0.5).astype(np.int32)
    extent = np.minimum(last, np.array([wide - 1, high - 1], np.int32)) - first + 1  # pixels, across and down
    shown = np.flatnonzero((extent[:, 0] > 0) & (extent[:, 1] > 0))
    first, extent, zero = first[shown], extent[shown], zero[shown]
    one, two, area, corners = one[shown] - zero, two[shown] - zero, area[front[shown]], triangle[front[shown]]
    # The shares of the second and the third corner are linear in the picture.
    second_step = np.stack([two[:, 1], -two[:, 0]], axis=1) / area[:, None]
    third_step = np.stack([-one[:, 1], one[:, 0]], axis=1) / area[:, None]
    begin = first.astype(np.float32) + np.float32(0.5) - zero
    second_begin, third_begin = (begin * second_step).sum(axis=1), (begin * third_step).sum(axis=1)
    count = extent[:, 0] * extent[:, 1]
    owner = np.repeat(np.arange(len(shown), dtype=np.int32), count)
    step = np.arange(len(owner), dtype=np.int32) - np.repeat((np.cumsum(count) - count).astype(np.int32), count)
    down, across = np.divmod(step, extent[owner, 0])
    right, below = across.astype(np.float32), down.astype(np.float32)
    second = second_begin[owner] + second_step[owner, 0] * right + second_step[owner, 1] * below
    third = third_begin[owner] + third_step[owner, 0] * right + third_step[owner, 1] * below
    hit = np.flatnonzero((second >= 0) & (third >= 0) & (second + third <= 1))
    owner, second, third = owner[hit], second[hit], third[hit]
    pixel = (first[owner, 1] + down[hit]) * wide + first[owner, 0] + across[hit]
    far = depth[corners]
    there = far[owner, 0] + second * (far[:, 1] - far[:, 0])[owner] + third * (far[:, 2] - far[:, 0])[owner]
    np.minimum.at(nearest, pixel, there)
    won = np.flatnonzero(there == nearest[pixel])
    owner, pixel, second, third = corners[owner[won]], pixel[won], second[won, None], third[won, None]
    a, b, c = (color[owner[:, k]] for k in range(3))
    image[pixel] = a + second * (b - a) + third * (c - a)
    return image.reshape(high, wide, 3), np.isfinite(nearest).reshape(high, wide)


def _pixel_sums(samples: np.ndarray) -> np.ndarray:
    """Return the sums (H, W, …) of the samples (_FINE * H, _FINE * W, …) of each pixel."""
    parts = [samples[row::_FINE, column::_FINE] for row in range(_FINE) for column in range(_FINE)]
    return np.sum(parts, axis=0)


def _srgb(linear: np.ndarray) -> np.ndarray:
    """Return sRGB values of linear light, 0 to 1."""
    light = np.clip(linear, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** np.float32(1 / 2.4) - 0.055)
