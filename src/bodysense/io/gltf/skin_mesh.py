"""A mesh of a body in its rest pose, each vertex rigid with one joint: what a viewer of glTF shows."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bodysense.body.flesh import COLORS, fit_flesh
from bodysense.body.skeleton import Skeleton

_AROUND, _RINGS = 10, 4  # vertices around a link, and rings on each of its two balls


@dataclass(frozen=True, eq=False)
class SkinMesh:
    """V vertices and F triangles, counter-clockwise as seen from outside."""

    position: np.ndarray = field(repr=False)  # (V, 3) m, world
    normal: np.ndarray = field(repr=False)  # (V, 3) unit
    color: np.ndarray = field(repr=False)  # (V, 3) red, green, blue, 0 to 1, as shown (sRGB)
    joint: np.ndarray = field(repr=False)  # (V,) index of the joint that carries each
    triangle: np.ndarray = field(repr=False)  # (F, 3) vertices


def skin_mesh(skeleton: Skeleton) -> SkinMesh:
    """The hulls of the flesh's links. Raises BodysenseError for a skeleton without the default's points and parents."""
    flesh = fit_flesh(skeleton)
    rest = skeleton.path @ skeleton.rest_offset
    center = (rest[flesh.joint] + flesh.center)[flesh.link]  # (L, 2, 3)
    center = center + skeleton.rest_offset[0]
    radius = flesh.radius[flesh.link]  # (L, 2)
    along = center[:, 1] - center[:, 0]
    length = np.linalg.norm(along, axis=1)
    axis = np.where(length[:, None] > 1e-9, along / np.maximum(length, 1e-9)[:, None], [0.0, 1.0, 0.0])
    # The hull touches both balls where its normal leans toward the thinner one by the same angle.
    lean = np.arcsin(np.clip((radius[:, 0] - radius[:, 1]) / np.maximum(length, 1e-9), -1, 1))
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third = np.cross(axis, across)

    share = np.linspace(0, 1, _RINGS)
    latitude = np.stack(
        [-np.pi / 2 + share * (lean[:, None] + np.pi / 2), lean[:, None] + share * (np.pi / 2 - lean[:, None])]
    )
    latitude = latitude.transpose(1, 0, 2)  # (L, 2, R)
    angle = np.arange(_AROUND) * (2 * np.pi / _AROUND)
    round_ = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * third[:, None]  # (L, A, 3)
    normal = (
        np.sin(latitude)[..., None, None] * axis[:, None, None, None]
        + np.cos(latitude)[..., None, None] * round_[:, None, None]
    )  # (L, 2, R, A, 3)
    position = center[:, :, None, None] + radius[:, :, None, None, None] * normal
    shape = normal.shape[:-1]
    joint = np.broadcast_to(flesh.joint[flesh.link][:, :, None, None], shape)
    color = np.broadcast_to(COLORS[flesh.color][:, None, None, None], normal.shape)

    ring, around = np.arange(2 * _RINGS - 1)[:, None] * _AROUND, np.arange(_AROUND)
    beside = (around + 1) % _AROUND
    corners = [ring + around, ring + beside, ring + _AROUND + beside, ring + _AROUND + around]
    first = np.stack([corners[0], corners[1], corners[2]], axis=-1).reshape(-1, 3)
    second = np.stack([corners[0], corners[2], corners[3]], axis=-1).reshape(-1, 3)
    begin = np.arange(len(axis))[:, None, None] * (2 * _RINGS * _AROUND)
    triangle = (begin + np.concatenate([first[_AROUND:], second[:-_AROUND]])).reshape(
        -1, 3
    )  # none without area at poles
    return SkinMesh(position.reshape(-1, 3), normal.reshape(-1, 3), color.reshape(-1, 3), joint.ravel(), triangle)
