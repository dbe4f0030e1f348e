"""Rendered films of a person at a desk, with their truth: seated on any seat, at a table, standing, coming in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.arms import SIDES
from bodysense.body.keypoints import Camera
from bodysense.body.pose import Pose, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense_lab.rendering.character import FigureName, load_figure
from bodysense_lab.rendering.renderer import open_renderer
from bodysense_lab.rendering.scene import Furniture, sample_scene

RATE = 15.0  # Hz
HIP_OVER_SEAT = 0.095  # m, height of hip joints over the seat
TABLE = 0.72  # m, height of its top


@dataclass(frozen=True)
class Film:
    """One film: a person and a camera."""

    seat: float | None  # m, height of the seat; None: the person stands
    tilt: float = 0.0  # degrees by which the camera looks down
    height: float = 1.2  # m, of the camera over the floor
    distance: float = 1.6  # m, of the camera from the person
    at_table: bool = False
    present: tuple[float, float] = (0.0, 1.0)  # shares of the film between which the person is in the picture
    seconds: float = 2.0
    figure: FigureName = "man"
    seed: int = 1

    @property
    def frames(self) -> int:
        """Number of pictures."""
        return round(self.seconds * RATE)

    @property
    def is_present(self) -> np.ndarray:
        """(T,) whether the person is in the picture."""
        share = np.arange(self.frames) / self.frames
        return (share >= self.present[0]) & (share < self.present[1])


def seated_pose(skeleton: Skeleton, seat: float) -> Pose:
    """Return one pose on a seat `seat` m high: upright trunk, vertical shanks, feet on the floor, arms bent."""
    standing = standing_pose(skeleton)
    rest = skeleton.path @ skeleton.rest_offset
    hip, knee = (rest[skeleton.index(f"left_{part}"), 1] for part in ("hip", "knee"))
    thigh = np.linalg.norm(np.diff(rest[skeleton.indices(("left_hip", "left_knee"))], axis=0))
    height = skeleton.rest_offset[0, 1] + knee  # m, of the knees over vertical shanks
    sink = np.arcsin(np.clip((seat + HIP_OVER_SEAT - height) / thigh, -0.8, 0.8))  # of the thigh below level
    rotation = standing.rotation.copy()
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        bend = np.pi / 2 - sink
        rotation[skeleton.index(f"{side}_hip")] = quaternion_exp(np.array([-bend, 0.0, 0.0]))
        rotation[skeleton.index(f"{side}_knee")] = quaternion_exp(np.array([bend, 0.0, 0.0]))
        elbow = skeleton.index(f"{side}_elbow")
        turn = quaternion_exp(np.array([0.0, -1.1 * sign, 0.0]))
        rotation[elbow] = quaternion_multiply(turn, rotation[elbow])
    return Pose(skeleton, np.array([0.0, seat + HIP_OVER_SEAT - hip, 0.0]), rotation)


def truth(film: Film) -> Pose:
    """Return the poses (T, …) of the person, who nods and sways a little."""
    skeleton = load_figure(film.figure).skeleton
    one = standing_pose(skeleton) if film.seat is None else seated_pose(skeleton, film.seat)
    time = np.arange(film.frames) / RATE
    rotation = np.tile(one.rotation, (film.frames, 1, 1))
    for joint, axis, size in (("spine1", (1.0, 0.0, 0.3), 0.05), ("head", (0.4, 1.0, 0.0), 0.2)):
        place = skeleton.index(joint)
        turn = quaternion_exp(size * np.sin(2.5 * time)[:, None] * np.array(axis))
        rotation[:, place] = quaternion_multiply(turn, rotation[:, place])
    root = np.tile(one.root_position, (film.frames, 1))
    return Pose(skeleton, root, rotation)


def camera(film: Film) -> Camera:
    """Return the film's camera, in front of the person."""
    angle = np.radians(film.tilt)
    cosine, sine = np.cos(angle), np.sin(angle)
    axes = np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])
    focal = (4 / 3) / 2 / np.tan(np.radians(60.0) / 2)
    return Camera(np.array([0.0, film.height, film.distance]), axes, np.array(focal), np.array(4 / 3))


def pictures(film: Film, height: int = 240) -> Iterator[np.ndarray]:
    """Yield the pictures (H, W, 3), 15 a second. An absent person is behind the camera."""
    pose, lens = truth(film), camera(film)
    scene = replace(sample_scene(np.random.default_rng(film.seed), film.figure), furniture=())
    if film.at_table:
        table = Furniture(np.array([0.0, TABLE / 2, 0.62]), np.array([1.4, TABLE, 0.6]), 0.0, (0.55, 0.42, 0.3))
        scene = replace(scene, furniture=(table,))
    with open_renderer(scene, lens, height, np.zeros(3)) as stage:
        for k, is_present in enumerate(film.is_present):
            away = np.array([0.0, 0.0, 0.0 if is_present else 20.0])
            yield stage.draw(replace(pose[k], root_position=pose.root_position[k] + away))
