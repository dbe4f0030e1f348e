"""Characters: skinned meshes on our joints. Three are packaged."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib.resources import files
from typing import Literal, get_args

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_to_matrix,
)
from bodysense.geometry.rotation import swing_twist as split

FigureName = Literal["woman", "man", "heavy"]
FIGURES: tuple[FigureName, ...] = get_args(FigureName)
_STEPS = (0.0, 0.5, 1.0)  # shares of a limb's twist in the skin, from its near to its far end


@dataclass(frozen=True, eq=False)
class Character:
    """A triangle mesh in the T-pose of its skeleton; world axes, metres."""

    name: str
    skeleton: Skeleton
    vertices: np.ndarray = field(repr=False)  # (V, 3)
    triangles: np.ndarray = field(repr=False)  # (F, 3) indices, counter-clockwise from outside
    joint: np.ndarray = field(repr=False)  # (V, 4) joints that each vertex follows
    weight: np.ndarray = field(repr=False)  # (V, 4) skinning weights; rows sum to 1
    part: np.ndarray = field(repr=False)  # (V,) 0 skin, 1 eye, 2 lip
    eye: np.ndarray = field(repr=False)  # (3,) centre of the left eye
    nose: np.ndarray = field(repr=False)  # (3,) tip of the nose

    @cached_property
    def rest(self) -> np.ndarray:
        """Points (P, 3) of the skeleton in the T-pose."""
        return np.asarray(self.skeleton.rest_offset[0] + self.skeleton.path @ self.skeleton.rest_offset)

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals (V, 3) in the T-pose."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        normal = np.zeros_like(self.vertices)
        for k in range(3):
            np.add.at(normal, self.triangles[:, k], np.cross(b - a, c - a))
        return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)

    @cached_property
    def _limbs(self) -> tuple[tuple[int, int, int], ...]:
        """Forearms and upper arms: the limb's joint, its child, and the joint whose twist it shares."""
        names = [(f"{side}_elbow", f"{side}_wrist", f"{side}_wrist") for side in ("left", "right")]
        names += [(f"{side}_shoulder", f"{side}_elbow", f"{side}_shoulder") for side in ("left", "right")]
        return tuple((self.skeleton.index(a), self.skeleton.index(b), self.skeleton.index(c)) for a, b, c in names)

    @cached_property
    def _weights(self) -> np.ndarray:
        """Weights (V, J + 12) for the joints, and for three frames along each arm limb instead of its joint."""
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
        """Return vertices and normals (V, 3) in world axes for one pose of this character's skeleton.

        Linear blend skinning; the twist of wrist and shoulder is spread along forearm and upper arm.
        """
        position, rotation = forward_kinematics(pose)
        turns, places = [rotation], [position[: len(rotation)]]
        origins = [self.rest[: len(rotation)]]
        for limb, child, twisted in self._limbs:
            bone = self.rest[child] - self.rest[limb]
            twist = quaternion_log(split(pose.rotation[twisted], bone / np.linalg.norm(bone))[1])
            # The rotation of an upper arm already contains its twist, that of a forearm not the wrist's twist.
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

    def retarget(self, pose: Pose) -> Pose:
        """Return a motion (T, …) of another body on this one: equal rotations, and a path scaled with the legs.

        Raises BodysenseError if the pose has other joints.
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
    """Return a packaged character. Raises BodysenseError for an unknown name."""
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
