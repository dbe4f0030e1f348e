"""Scene of a rendered video: character, clothes, light, room and camera, drawn at random."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from bodysense.body.keypoints import Camera
from bodysense.body.pose import Pose
from bodysense.geometry.rotation import (
    matrix_to_quaternion,
    quaternion_to_matrix,
    slerp,
)
from bodysense_lab.papers.pahmt.camera_view import VIEW_POINTS, CameraRange, sample_cameras, view_points
from bodysense_lab.rendering.character import FIGURES, FigureName

Color = tuple[float, float, float]  # red, green, blue, sRGB, 0 to 1

SKINS = ((0.95, 0.79, 0.70), (0.89, 0.69, 0.57), (0.78, 0.57, 0.43), (0.61, 0.42, 0.30), (0.43, 0.29, 0.21))
HAIRS = ((0.08, 0.06, 0.05), (0.22, 0.14, 0.09), (0.42, 0.29, 0.17), (0.66, 0.52, 0.32), (0.55, 0.55, 0.55))
# Cameras at arm's length to across a room, roughly in front of the person.
ROOM = CameraRange(
    distance=(1.2, 2.3),
    height=(-0.3, 0.3),
    heading=(-35.0, 35.0),
    field_of_view=(40.0, 55.0),
    aspect=(4 / 3, 4 / 3),
    aim=(-0.1, 0.1),
    roll=(-3.0, 3.0),
)

WHOLE = replace(ROOM, distance=(2.3, 3.2), field_of_view=(45.0, 58.0))  # so far away that the whole person is visible
# Webcam on a screen: at head height, at the distance of a person at a desk, visible from head to waist.
WEBCAM = replace(
    ROOM, distance=(0.8, 1.2), height=(0.1, 0.3), heading=(-15.0, 15.0), field_of_view=(45.0, 55.0), aim=(-0.05, 0.05)
)
WEBCAM_RISE = 0.2  # m from the middle of the trunk up to the point at which a webcam points


@dataclass(frozen=True)
class Clothes:
    """Colours (sRGB, 0 to 1) and lengths of garments."""

    shirt: Color
    trousers: Color
    shoes: Color
    sleeve: float  # its end: 0 at the shoulder, 1 at the elbow, 2 at the wrist
    collar: float  # m from the base of the neck down to the neckline
    stripes: float  # m between stripes of the shirt; 0: plain


@dataclass(frozen=True, eq=False)
class Lamp:
    """A distant lamp."""

    toward: np.ndarray  # (3,) unit direction to the lamp, in the room's axes
    color: np.ndarray  # (3,) linear, red, green, blue


@dataclass(frozen=True, eq=False)
class Furniture:
    """A box on the floor, rotated about +Y."""

    middle: np.ndarray  # (3,) m, in the room's axes, from the body's place
    size: np.ndarray  # (3,) m
    turn: float  # rad
    color: Color


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything in a video except motion and camera. The room's axes: +y up, +z level and toward the camera."""

    figure: FigureName
    skin: Color
    hair: Color
    clothes: Clothes
    lamps: tuple[Lamp, Lamp]  # the first casts shadows
    sky: np.ndarray  # (3,) linear, light from above; half of it comes from below
    wall: Color
    floor: Color
    wall_distance: float  # m behind the body
    furniture: tuple[Furniture, ...] = field(default=(), repr=False)
    noise: float = 0.01  # standard deviation of the sensor's noise; white is 1


def sample_scene(rng: np.random.Generator, figure: FigureName | None = None) -> Scene:
    """Draw a random scene; the character is also random if `figure` is None."""
    shade = float(rng.uniform(0.25, 0.9))
    stripes = float(rng.choice([0.0, 0.0, 0.03, 0.08]))
    clothes = Clothes(
        shirt=_color(rng, 0.12, 0.9),
        trousers=_color(rng, 0.08, 0.5),
        shoes=_color(rng, 0.05, 0.8),
        sleeve=float(rng.choice([0.6, 0.75, 1.5, 1.9])),
        collar=float(rng.uniform(0.02, 0.07)),
        stripes=stripes,
    )
    key = float(rng.uniform(1.6, 2.6))
    lamps = (
        Lamp(_toward(rng, 55.0, (25.0, 60.0)), key * _tint(rng)),
        Lamp(_toward(rng, 90.0, (5.0, 40.0)), key * float(rng.uniform(0.15, 0.4)) * _tint(rng)),
    )
    return Scene(
        figure=figure or FIGURES[rng.integers(len(FIGURES))],
        skin=_near(rng, SKINS),
        hair=_near(rng, HAIRS),
        clothes=clothes,
        lamps=lamps,
        sky=float(rng.uniform(0.35, 0.7)) * _tint(rng),
        wall=_color(rng, shade - 0.1, shade + 0.1),
        floor=_color(rng, 0.15, 0.7),
        wall_distance=float(rng.uniform(0.8, 2.5)),
        furniture=tuple(_furniture(rng) for _ in range(rng.integers(0, 5))),
        noise=float(rng.uniform(0.003, 0.015)),
    )


def sample_camera(pose: Pose, rng: np.random.Generator, where: CameraRange = ROOM, rise: float = 0.0) -> Camera:
    """Draw a still camera for the median position of a body (T, …).

    It points `rise` m above the middle of the trunk.
    """
    middle = np.median(view_points(pose), axis=0)
    middle[:, VIEW_POINTS.index("hip"), 1] += 2 * rise  # cameras point between hips and shoulders
    camera = sample_cameras(middle[None], rng, where)
    return Camera(camera.position[0], camera.axes[0], camera.focal[0], camera.aspect[0])


def move_camera(first: Camera, last: Camera, count: int) -> Camera:
    """Return a camera that moves and turns steadily from one to another in `count` pictures, with the first one's lens.

    Its `position` and `axes` have an axis of time.
    """
    share = np.linspace(0.0, 1.0, count)
    begin, end = matrix_to_quaternion(first.axes), matrix_to_quaternion(last.axes)
    turned = quaternion_to_matrix(slerp(np.tile(begin, (count, 1)), np.tile(end, (count, 1)), share))
    return replace(first, position=first.position + share[:, None] * (last.position - first.position), axes=turned)


def _color(rng: np.random.Generator, dark: float, bright: float) -> Color:
    """Draw a colour with a brightness from `dark` to `bright`; low saturations are more frequent."""
    grey, loud = rng.uniform(dark, bright), 0.3 * rng.random() ** 2
    red, green, blue = np.clip(grey + loud * rng.uniform(-1, 1, 3), 0.02, 0.95).tolist()
    return red, green, blue


def _near(rng: np.random.Generator, colors: tuple[Color, ...]) -> Color:
    """Draw one of the colours, a little darker or brighter."""
    red, green, blue = np.clip(np.array(colors[rng.integers(len(colors))]) * rng.uniform(0.92, 1.06), 0, 1).tolist()
    return red, green, blue


def _tint(rng: np.random.Generator) -> np.ndarray:
    """Draw the colour of a light, from warm to cold."""
    warm = rng.uniform(-0.12, 0.12)
    return np.array([1 + warm, 1.0, 1 - warm])


def _toward(rng: np.random.Generator, aside: float, up: tuple[float, float]) -> np.ndarray:
    """Draw a direction up to `aside` degrees aside of the camera's, and `up` degrees (lowest, highest) above level."""
    angle, rise = np.radians(rng.uniform(-aside, aside)), np.radians(rng.uniform(*up))
    return np.array([np.sin(angle) * np.cos(rise), np.sin(rise), np.cos(angle) * np.cos(rise)])


def _furniture(rng: np.random.Generator) -> Furniture:
    size = np.array([rng.uniform(0.3, 1.4), rng.uniform(0.4, 1.8), rng.uniform(0.25, 0.6)])
    middle = np.array([rng.choice([-1, 1]) * rng.uniform(0.7, 2.4), size[1] / 2, rng.uniform(-2.4, -0.6)])
    return Furniture(middle, size, float(rng.uniform(-0.5, 0.5)), _color(rng, 0.1, 0.8))
