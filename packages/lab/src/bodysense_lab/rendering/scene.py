"""Scene: who is filmed, what they wear, and the light, room and camera; drawn at random where nothing is said.

Figure: a body's skin and the weights by which it follows our joints. Three of them travel with the package.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from importlib.resources import files
from typing import Literal, get_args

import numpy as np

from bodysense.body.keypoints import Camera
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import (
    matrix_to_quaternion,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_to_matrix,
    slerp,
)
from bodysense.body.rotation import swing_twist as split
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense_lab.pahmt.camera_view import VIEW_POINTS, CameraRange, sample_cameras, view_points

FigureName = Literal["woman", "man", "heavy"]
FIGURES: tuple[FigureName, ...] = get_args(FigureName)
_STEPS = (0.0, 0.5, 1.0)  # shares of a limb's twist that the skin takes from its near to its far end


@dataclass(frozen=True, eq=False)
class Character:
    """A triangle mesh in the T-pose of its skeleton; world axes, metres."""

    name: str
    skeleton: Skeleton
    vertices: np.ndarray = field(repr=False)  # (V, 3)
    triangles: np.ndarray = field(repr=False)  # (F, 3) indices, counter-clockwise from outside
    joint: np.ndarray = field(repr=False)  # (V, 4) joints that each vertex follows
    weight: np.ndarray = field(repr=False)  # (V, 4) how much; rows sum to 1
    part: np.ndarray = field(repr=False)  # (V,) 0 skin, 1 eye, 2 lip
    eye: np.ndarray = field(repr=False)  # (3,) middle of the left eye
    nose: np.ndarray = field(repr=False)  # (3,) its tip

    @cached_property
    def rest(self) -> np.ndarray:
        """(P, 3) the points of the skeleton in the T-pose."""
        return np.asarray(self.skeleton.rest_offset[0] + self.skeleton.path @ self.skeleton.rest_offset)

    @cached_property
    def normals(self) -> np.ndarray:
        """(V, 3) unit normals in the T-pose."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        normal = np.zeros_like(self.vertices)
        for k in range(3):
            np.add.at(normal, self.triangles[:, k], np.cross(b - a, c - a))
        return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)

    @cached_property
    def _limbs(self) -> tuple[tuple[int, int, int], ...]:
        """(joint of the limb, its child, the joint whose twist it shares): both forearms, both upper arms."""
        names = [(f"{side}_elbow", f"{side}_wrist", f"{side}_wrist") for side in ("left", "right")]
        names += [(f"{side}_shoulder", f"{side}_elbow", f"{side}_shoulder") for side in ("left", "right")]
        return tuple((self.skeleton.index(a), self.skeleton.index(b), self.skeleton.index(c)) for a, b, c in names)

    @cached_property
    def _weights(self) -> np.ndarray:
        """(V, J + 12) weights for the joints, and for three frames along each arm limb in place of its joint."""
        joints = len(self.skeleton.joints)
        weights = np.zeros((len(self.vertices), joints + len(_STEPS) * len(self._limbs)), np.float32)
        np.add.at(weights, (np.arange(len(weights))[:, None], self.joint), self.weight)
        for k, (limb, child, _) in enumerate(self._limbs):
            bone = self.rest[child] - self.rest[limb]
            along = np.clip((self.vertices - self.rest[limb]) @ bone / (bone @ bone), 0, 1)
            share = np.maximum(1 - np.abs(along[:, None] - _STEPS) * (len(_STEPS) - 1), 0)
            first = joints + len(_STEPS) * k
            weights[:, first : first + len(_STEPS)] = weights[:, [limb]] * share
            weights[:, limb] = 0
        return weights

    def skin(self, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
        """Vertices and normals (V, 3), world, of a body in one pose of this figure's skeleton.

        Linear blending; the twist of wrist and shoulder is spread along forearm and upper arm, as skin does it.
        """
        position, rotation = forward_kinematics(pose)
        turns, places = [rotation], [position[: len(rotation)]]
        origins = [self.rest[: len(rotation)]]
        for limb, child, twisted in self._limbs:
            bone = self.rest[child] - self.rest[limb]
            twist = quaternion_log(split(pose.rotation[twisted], bone / np.linalg.norm(bone))[1])
            # An upper arm's own rotation holds the whole of its twist, a forearm's nothing of the wrist's.
            already = 1.0 if twisted == limb else 0.0
            shares = np.array(_STEPS)[:, None] - already
            turns.append(quaternion_multiply(rotation[limb][None], quaternion_exp(shares * twist)))
            places.append(np.tile(position[limb], (len(_STEPS), 1)))
            origins.append(np.tile(self.rest[limb], (len(_STEPS), 1)))
        turn = quaternion_to_matrix(np.concatenate(turns))
        shift = np.concatenate(places) - np.einsum("nij,nj->ni", turn, np.concatenate(origins))
        frames = np.concatenate([turn, shift[..., None]], axis=-1).astype(np.float32).reshape(-1, 12)
        blended = (self._weights @ frames).reshape(-1, 3, 4)
        vertices = np.einsum("vij,vj->vi", blended[..., :3], self.vertices) + blended[..., 3]
        normals = np.einsum("vij,vj->vi", blended[..., :3], self.normals)
        return vertices.astype(np.float32), normals.astype(np.float32)

    def wear(self, pose: Pose) -> Pose:
        """A motion (T, …) of another body of our joints on this one: the same turns, the path scaled as the legs.

        Raises BodysenseError where the pose has other joints.
        """
        if pose.skeleton.joints != self.skeleton.joints:
            raise BodysenseError("figure: the motion has other joints; read it with bodysense.read, which names ours")
        other = pose.skeleton.path @ pose.skeleton.rest_offset
        scale = np.ptp(self.rest[self._legs, 1]) / np.ptp(other[self._legs, 1])
        return Pose(self.skeleton, pose.root_position * scale, pose.rotation)

    @cached_property
    def _legs(self) -> np.ndarray:
        return self.skeleton.indices(("left_hip", "left_knee", "left_ankle", "left_foot"))


@lru_cache(maxsize=len(FIGURES))
def load_figure(name: FigureName) -> Character:
    """One of the packaged figures. Raises BodysenseError for another name."""
    if name not in FIGURES:
        raise BodysenseError(f"unknown figure {name!r}; valid are {', '.join(FIGURES)}")
    packaged = files("bodysense_lab.rendering").joinpath("figures.npz")
    with packaged.open("rb") as file, np.load(file) as data:
        place = list(data["names"]).index(name)
        return Character(
            name=name,
            skeleton=default_skeleton().with_offsets(data["rest_offset"][place]),
            vertices=(data["vertices"][place] * data["grain"]).astype(np.float32),
            triangles=data["triangles"].astype(np.int32),
            joint=data["joint"].astype(np.intp),
            weight=data["weight"] / np.float32(255),
            part=data["part"],
            eye=data["eye"][place],
            nose=data["nose"][place],
        )


Color = tuple[float, float, float]  # red, green, blue, sRGB, 0 to 1

SKINS = ((0.95, 0.79, 0.70), (0.89, 0.69, 0.57), (0.78, 0.57, 0.43), (0.61, 0.42, 0.30), (0.43, 0.29, 0.21))
HAIRS = ((0.08, 0.06, 0.05), (0.22, 0.14, 0.09), (0.42, 0.29, 0.17), (0.66, 0.52, 0.32), (0.55, 0.55, 0.55))
# A person that is filmed at arm's length to across a room, from about the front.
ROOM = CameraRange(
    distance=(1.2, 2.3),
    height=(-0.3, 0.3),
    heading=(-35.0, 35.0),
    field_of_view=(40.0, 55.0),
    aspect=(4 / 3, 4 / 3),
    aim=(-0.1, 0.1),
    roll=(-3.0, 3.0),
)

WHOLE = replace(ROOM, distance=(2.3, 3.2), field_of_view=(45.0, 58.0))  # so far away that a person is seen whole
# On a screen: at head height, as far away as a person at a desk, who is seen from head to waist.
WEBCAM = replace(
    ROOM, distance=(0.8, 1.2), height=(0.1, 0.3), heading=(-15.0, 15.0), field_of_view=(45.0, 55.0), aim=(-0.05, 0.05)
)
WEBCAM_RISE = 0.2  # m over the middle of the trunk, where a webcam points


@dataclass(frozen=True)
class Clothes:
    """Colours (sRGB, 0 to 1), and where garments end."""

    shirt: Color
    trousers: Color
    shoes: Color
    sleeve: float  # 0 at the shoulder, 1 at the elbow, 2 at the wrist
    collar: float  # m from the base of the neck down to the neckline
    stripes: float  # m from stripe to stripe of the shirt; 0 is plain


@dataclass(frozen=True, eq=False)
class Lamp:
    """A lamp far away."""

    toward: np.ndarray  # (3,) unit, in the room's axes
    color: np.ndarray  # (3,) linear, red, green, blue


@dataclass(frozen=True, eq=False)
class Furniture:
    """A box that stands on the floor, turned about +Y."""

    middle: np.ndarray  # (3,) m, in the room's axes, from where the body is
    size: np.ndarray  # (3,) m
    turn: float  # rad
    color: Color


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything of a video but motion and camera. The room's axes: +y up, +z level and toward the camera."""

    figure: FigureName
    skin: Color
    hair: Color
    clothes: Clothes
    lamps: tuple[Lamp, Lamp]  # the first casts shadows
    sky: np.ndarray  # (3,) linear, light from above; from below comes half of it
    wall: Color
    floor: Color
    wall_distance: float  # m behind the body
    furniture: tuple[Furniture, ...] = field(default=(), repr=False)
    noise: float = 0.01  # deviation of the sensor's noise, of white


def sample_scene(rng: np.random.Generator, figure: FigureName | None = None) -> Scene:
    """A scene; `figure` None draws that too."""
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
    """Draw a camera that stands still, for a body (T, …) in the middle of its motion.

    It points `rise` m over the middle of the trunk.
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
    """A colour of some brightness, more often dull than loud."""
    grey, loud = rng.uniform(dark, bright), 0.3 * rng.random() ** 2
    red, green, blue = np.clip(grey + loud * rng.uniform(-1, 1, 3), 0.02, 0.95).tolist()
    return red, green, blue


def _near(rng: np.random.Generator, colors: tuple[Color, ...]) -> Color:
    """One of the colours, a little darker or brighter."""
    red, green, blue = np.clip(np.array(colors[rng.integers(len(colors))]) * rng.uniform(0.92, 1.06), 0, 1).tolist()
    return red, green, blue


def _tint(rng: np.random.Generator) -> np.ndarray:
    """Light from warm to cold."""
    warm = rng.uniform(-0.12, 0.12)
    return np.array([1 + warm, 1.0, 1 - warm])


def _toward(rng: np.random.Generator, aside: float, up: tuple[float, float]) -> np.ndarray:
    """A direction up to `aside` degrees from the camera's."""
    angle, rise = np.radians(rng.uniform(-aside, aside)), np.radians(rng.uniform(*up))
    return np.array([np.sin(angle) * np.cos(rise), np.sin(rise), np.cos(angle) * np.cos(rise)])


def _furniture(rng: np.random.Generator) -> Furniture:
    size = np.array([rng.uniform(0.3, 1.4), rng.uniform(0.4, 1.8), rng.uniform(0.25, 0.6)])
    middle = np.array([rng.choice([-1, 1]) * rng.uniform(0.7, 2.4), size[1] / 2, rng.uniform(-2.4, -0.6)])
    return Furniture(middle, size, float(rng.uniform(-0.5, 0.5)), _color(rng, 0.1, 0.8))
