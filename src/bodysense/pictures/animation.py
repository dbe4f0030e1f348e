"""Animations of a shaded body on a floor, as an animated WebP, which every browser plays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skin import COLORS, BodySkin, fit_skin, place_skin
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.pictures.sheet import FollowingCamera

_FINE = 2  # samples a pixel, across and down
_MELT = 0.012  # m: links that come closer than this along a ray melt into one skin
_LAMP = np.array([-0.45, 0.7, 0.55]) / np.linalg.norm([-0.45, 0.7, 0.55])  # toward it, camera's axes
_SKY, _FLOOR, _LINE = np.array([[0.91, 0.93, 0.95], [0.82, 0.83, 0.84], [0.68, 0.70, 0.72]], np.float32)
_GRID, _LINE_WIDTH = 0.5, 0.012  # m
_CELL, _CELLS = 0.04, 80  # m and number of a shadow's cells each way
_SHADOW_HEIGHT, _SHADOW_BLUR, _SHADOW_WEIGHT = 0.35, 0.07, 0.06  # m, m, m²: how it fades, how soft, how deep
_FAR, _TINY = np.float32(1e3), np.float32(1e-37)  # stand for never met, and keep divisions finite


@dataclass(frozen=True, eq=False)
class BodyRenderer:
    """Constants of all pictures: the rays of the camera and the points where they meet the floor."""

    camera: FollowingCamera

    @cached_property
    def _rays(self) -> np.ndarray:
        """(3, H, W) through the samples, camera's axes."""
        return np.ascontiguousarray(np.moveaxis(self.camera.rays(_FINE), -1, 0), dtype=np.float32)

    @cached_property
    def _floor(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where pixels see the floor.

        World x and z from the camera (2, H, W), a pixel's width along each (2, H, W), and how far it has faded into
        the sky, 0 to 1 (H, W).
        """
        ray = np.moveaxis(self.camera.rays() @ self.camera.axes.T, -1, 0)
        reach = self.camera.scale * self.camera.lens.eye / np.maximum(-ray[1], 0.02)
        place = reach * ray[[0, 2]]
        pixel = np.maximum(*(np.abs(np.gradient(place, axis=axis)) for axis in (1, 2)))
        far = np.clip((reach / self.camera.scale - 5) / 9, 0, 1)
        return place.astype(np.float32), pixel.clip(1e-4).astype(np.float32), far.astype(np.float32)

    def draw(self, skin: BodySkin, balls: np.ndarray, frame: int) -> np.ndarray:
        """(H, W, 3) uint8: a body at one frame of the camera, its balls at (N, 3) m, world."""
        eye = self.camera.eye(frame)
        picture = self._background(skin, balls, eye)
        self._paint_body(picture, skin, ((balls - eye) @ self.camera.axes).astype(np.float32))
        return np.round(255 * np.moveaxis(picture, 0, -1).clip(0, 1)).astype(np.uint8)

    def _paint_body(self, picture: np.ndarray, skin: BodySkin, balls: np.ndarray) -> None:
        """Paint over a picture (3, H, W) a body whose balls are at (N, 3) m in the camera's axes.

        Where several links lie along a ray, each counts the less the farther it lies behind the first: a smooth union
        of depths, which hides the seams between links.
        """
        left, right, top, bottom = self._windows(skin, balls)
        ahead = np.linalg.norm(balls, axis=-1)
        middle = float(((ahead - skin.radius).min() + (ahead + skin.radius).max()) / 2)
        # All samples that the body can touch, a whole number of pixels.
        x0, x1 = left.min() // _FINE * _FINE, -(-right.max() // _FINE) * _FINE
        y0, y1 = top.min() // _FINE * _FINE, -(-bottom.max() // _FINE) * _FINE
        if x1 <= x0 or y1 <= y0:
            return
        rays = self._rays[:, y0:y1, x0:x1]
        # Sums over links: of the weights of each colour, and of weighted normals.
        weight = np.zeros((len(COLORS), *rays.shape[1:]), np.float32)
        normal = np.zeros_like(rays)
        for k, (first, second) in enumerate(skin.link):
            window = np.s_[top[k] - y0 : bottom[k] - y0, left[k] - x0 : right[k] - x0]
            ray = rays[:, *window]
            if ray.size:
                hit, distance, facing = _meet_link(ray, balls[first], balls[second], *skin.radius[[first, second]])
                share = np.exp(((middle - distance) / _MELT).clip(-80, 80)) * hit
                weight[skin.color[k]][window] += share
                normal[:, *window] += share * facing
        total = weight.sum(axis=0)
        covered = total > 0
        total = np.maximum(total, _TINY)
        light = _light(normal / total, rays) / total
        painted = picture[:, y0 // _FINE : y1 // _FINE, x0 // _FINE : x1 // _FINE]
        color = (np.tensordot(COLORS.T, weight, 1) * light).clip(0, 1)
        painted[...] = painted * (1 - _coarse(covered)) + _coarse(color)

    def _windows(self, skin: BodySkin, balls: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Samples of the picture that each link can touch: left, right, top, bottom (L,); empty beyond its edges."""
        _, high, wide = self._rays.shape
        focus = self.camera.focal_length * high
        ahead = np.maximum(-balls[:, 2], 2 * skin.radius)  # what touches the camera is not drawn aright
        bounds = []
        for beside, size in ((balls[:, 0], wide), (-balls[:, 1], high)):
            # Slopes of the two tangents from the camera to a ball, in the plane of this axis and the depth.
            reach = skin.radius * np.sqrt(beside**2 + ahead**2 - skin.radius**2)
            lower, upper = ((beside * ahead + sign * reach) / (ahead**2 - skin.radius**2) for sign in (-1, 1))
            first = size / 2 + focus * lower[skin.link].min(axis=1)
            last = size / 2 + focus * upper[skin.link].max(axis=1)
            bounds += [np.floor(first).clip(0, size).astype(int), np.ceil(last).clip(0, size).astype(int)]
        return bounds[0], bounds[1], bounds[2], bounds[3]

    def _background(self, skin: BodySkin, balls: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """(3, H, W): sky, and the floor with its lines and the body's shadow."""
        place, pixel, far = self._floor
        x, z = place + eye[[0, 2], None, None].astype(np.float32)
        light = 1 - _shadow(skin, balls, self.camera.floor, x, z)
        line = np.zeros_like(x)
        for along, width in ((x, pixel[0]), (z, pixel[1])):
            beside = np.abs((along / _GRID + 0.5) % 1 - 0.5) * _GRID
            line = np.maximum(line, ((_LINE_WIDTH / 2 + width / 2 - beside) / width).clip(0, 1))
        line *= 1 - far
        floor = (_FLOOR[:, None, None] + line * (_LINE - _FLOOR)[:, None, None]) * light
        return floor + far * (_SKY[:, None, None] - floor)


def draw_pose(pose: Pose, camera: FollowingCamera) -> Iterator[np.ndarray]:
    """Yield pictures (H, W, 3) uint8 of a posed body (T, …). Raises BodysenseError unless the camera has T frames."""
    if len(pose.root_position) != len(camera):
        raise BodysenseError(f"a camera of {len(camera)} frames cannot show {len(pose.root_position)}; frame it anew")
    skin, renderer = fit_skin(pose.skeleton), BodyRenderer(camera)
    for frame, balls in enumerate(place_skin(skin, pose)):
        yield renderer.draw(skin, balls, frame)


def write_animation(path: str | Path, pose: Pose, camera: FollowingCamera, rate: float) -> None:
    """Write a posed body (T, …) at `rate` Hz as an animated WebP that repeats for ever."""
    write_pictures(path, draw_pose(pose, camera), rate)


def write_pictures(path: str | Path, drawn: Iterable[np.ndarray], rate: float) -> None:
    """Write pictures (H, W, 3) uint8 at `rate` Hz as an animated WebP that repeats for ever."""
    from PIL import Image, features

    if not features.check("webp"):
        raise BodysenseError(f"{path}: this Pillow writes no WebP; pip install --force-reinstall pillow")
    pictures = [Image.fromarray(picture) for picture in drawn]
    # Whole milliseconds whose sum stays right.
    ends = np.round(1000 * np.arange(len(pictures) + 1) / rate).astype(int)
    with written_beside(path) as beside:
        pictures[0].save(
            beside,
            format="WEBP",
            save_all=True,
            append_images=pictures[1:],
            duration=np.diff(ends).tolist(),
            loop=0,
            quality=80,
            method=2,
        )


def _meet_link(
    ray: np.ndarray, first: np.ndarray, second: np.ndarray, first_radius: float, second_radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where unit rays (3, H, W) from the origin enter the hull of two balls with centres (3,) m.

    Returns whether they do (H, W), the distance in metres (H, W) and the outward normal (3, H, W), which are any
    numbers where they do not. A ray enters through the cone that touches both balls if it meets it between the circles
    of touch, otherwise through a ball.
    """
    r1, r2 = float(first_radius), float(second_radius)
    to_first, to_second = _along(ray, first), _along(ray, second)
    root1 = to_first**2 + (r1**2 - float(first @ first))
    root2 = to_second**2 + (r2**2 - float(second @ second))
    enter1 = np.where(root1 > 0, to_first - np.sqrt(np.maximum(root1, 0)), _FAR)
    enter2 = np.where(root2 > 0, to_second - np.sqrt(np.maximum(root2, 0)), _FAR)
    distance = np.minimum(enter1, enter2)
    share = (enter2 < enter1).astype(np.float32)  # of the way from the first ball to the second

    axis, narrowing = second - first, r1 - r2
    length = float(axis @ axis)
    reach = length - narrowing**2
    if reach > 1e-3 * length:  # neither ball holds the other
        along, start = to_second - to_first, -float(axis @ first) - narrowing * r1
        a = reach - along**2
        b = reach * to_first + start * along
        c = reach * float(first @ first) - start**2 + (narrowing**2 - length) * r1**2
        root = b * b - a * c
        enter = (b - np.sqrt(np.maximum(root, 0))) / np.where(a == 0, _TINY, a)
        place = (start + enter * along) / reach
        side = (root > 0) & (place > 0) & (place < 1)
        distance = np.where(side, enter, distance)
        share = np.where(side, place, share)
    # The skin is touched from inside by a ball on the axis whose radius goes from one end's to the other's.
    normal = (distance * ray - _column(first) - share * _column(axis)) / (r1 - narrowing * share)
    return distance < _FAR, distance, normal


def _light(normal: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Brightness (H, W) of surfaces with normals (3, H, W) of any length: lamp and sky, darker where they turn away."""
    length = np.maximum(np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2), _TINY)
    lamp = np.maximum(_along(normal, _LAMP), 0)
    toward = np.maximum(-(normal[0] * ray[0] + normal[1] * ray[1] + normal[2] * ray[2]), 0)
    return (0.55 + (0.15 * normal[1] + 0.6 * lamp) / length) * (0.65 + 0.35 * toward / length)


def _along(vectors: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Dot product of vectors (3, H, W) with one (3,)."""
    x, y, z = (float(value) for value in direction)
    return vectors[0] * x + vectors[1] * y + vectors[2] * z


def _shadow(skin: BodySkin, balls: np.ndarray, floor: float, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """How much light a body takes from the floor at world x and z (H, W), m: soft, and deeper near contact."""
    share = np.linspace(0, 1, 7)[:, None, None]
    point = ((1 - share) * balls[skin.link[:, 0]] + share * balls[skin.link[:, 1]]).reshape(-1, 3)
    weight = np.tile(skin.radius[skin.link].mean(axis=1) ** 2, len(share))
    weight = weight * np.exp(-(point[:, 1] - floor).clip(0) / _SHADOW_HEIGHT)
    corner = (np.floor(balls[:, [0, 2]].mean(axis=0) / _CELL) - _CELLS // 2).astype(np.float32)
    cell = np.round(point[:, [0, 2]] / _CELL - corner).astype(int).clip(0, _CELLS - 1)
    dark = np.bincount(cell[:, 0] * _CELLS + cell[:, 1], weight, _CELLS**2).reshape(_CELLS, _CELLS)
    blur = np.exp(-0.5 * (np.subtract.outer(np.arange(_CELLS), np.arange(_CELLS)) * _CELL / _SHADOW_BLUR) ** 2)
    dark = 0.6 * (1 - np.exp(-blur @ dark @ blur / _SHADOW_WEIGHT)).astype(np.float32)
    shadow = np.zeros_like(x)
    u, v = x / _CELL - corner[0], z / _CELL - corner[1]
    inside = (u >= 0) & (u < _CELLS - 1) & (v >= 0) & (v < _CELLS - 1)
    u, v = u[inside], v[inside]
    i, j = u.astype(int), v.astype(int)
    u, v = u - i, v - j
    near, far = (1 - v) * dark[i, j] + v * dark[i, j + 1], (1 - v) * dark[i + 1, j] + v * dark[i + 1, j + 1]
    shadow[inside] = (1 - u) * near + u * far
    return shadow


def _column(vector: np.ndarray) -> np.ndarray:
    return vector[:, None, None]


def _coarse(samples: np.ndarray) -> np.ndarray:
    """Pixels from samples (..., H · fine, W · fine): their means."""
    *batch, high, wide = samples.shape
    rows = samples.reshape(*batch, high // _FINE, _FINE, wide).sum(axis=-2, dtype=np.float32)
    return rows.reshape(*rows.shape[:-1], wide // _FINE, _FINE).sum(axis=-1) / _FINE**2
