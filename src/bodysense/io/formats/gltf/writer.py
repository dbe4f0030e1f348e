"""glTF 2.0 in one binary file (.glb): an animated skeleton with a mesh that viewers display.

glTF's world is ours: right-handed, +Y up, metres, bodies face +Z; only quaternions are x, y, z, w. Every point of the
skeleton is a node under its own name; in the rest pose nothing is rotated.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.body.skin import COLORS, fit_skin
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.geometry.rotation import normalize
from bodysense.geometry.series import continuous
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.file import BINARY, JSON

_AROUND, _RINGS = 10, 4  # vertices around a link, and rings on each of its two balls


@dataclass(frozen=True, eq=False)
class SkinMesh:
    """V vertices and F triangles, counter-clockwise as seen from outside."""

    position: np.ndarray = field(repr=False)  # (V, 3) m, world
    normal: np.ndarray = field(repr=False)  # (V, 3) unit
    color: np.ndarray = field(repr=False)  # (V, 3) red, green, blue, 0 to 1, sRGB
    joint: np.ndarray = field(repr=False)  # (V,) index of the joint that carries each
    triangle: np.ndarray = field(repr=False)  # (F, 3) vertices


def skin_mesh(skeleton: Skeleton) -> SkinMesh:
    """Build the hulls of the skin's links. Raises BodysenseError unless points and parents are the default's."""
    skin = fit_skin(skeleton)
    rest = skeleton.path @ skeleton.rest_offset
    center = (rest[skin.joint] + skin.center)[skin.link]  # (L, 2, 3)
    center = center + skeleton.rest_offset[0]
    radius = skin.radius[skin.link]  # (L, 2)
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
    joint = np.broadcast_to(skin.joint[skin.link][:, :, None, None], shape)
    color = np.broadcast_to(COLORS[skin.color][:, None, None, None], normal.shape)

    ring, around = np.arange(2 * _RINGS - 1)[:, None] * _AROUND, np.arange(_AROUND)
    beside = (around + 1) % _AROUND
    corners = [ring + around, ring + beside, ring + _AROUND + beside, ring + _AROUND + around]
    first = np.stack([corners[0], corners[1], corners[2]], axis=-1).reshape(-1, 3)
    second = np.stack([corners[0], corners[2], corners[3]], axis=-1).reshape(-1, 3)
    begin = np.arange(len(axis))[:, None, None] * (2 * _RINGS * _AROUND)
    triangle = (begin + np.concatenate([first[_AROUND:], second[:-_AROUND]])).reshape(
        -1, 3
    )  # no triangles of zero area at the poles
    return SkinMesh(position.reshape(-1, 3), normal.reshape(-1, 3), color.reshape(-1, 3), joint.ravel(), triangle)


_FLOAT, _BYTE, _INT = 5126, 5121, 5125
_KINDS = {np.dtype("<f4"): _FLOAT, np.dtype("u1"): _BYTE, np.dtype("<u4"): _INT}
_SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
_VERTICES, _INDICES = 34962, 34963  # what a view is for


class Arrays:
    """The binary part of a file, which grows by arrays; `views` and `accessors` describe them."""

    def __init__(self) -> None:
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.binary = bytearray()

    def add(self, values: np.ndarray, target: int | None = None, **more: Any) -> int:
        """Add an array (N, …) and return its accessor; `more` is added to it unchanged."""
        data = np.ascontiguousarray(values)
        self.views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": data.nbytes})
        if target is not None:
            self.views[-1]["target"] = target
        self.binary += data.tobytes()
        self.binary += bytes(-len(self.binary) % 4)
        accessor = {"bufferView": len(self.views) - 1, "componentType": _KINDS[data.dtype], "count": len(data)}
        self.accessors.append(accessor | {"type": _SHAPES[data.shape[1:]]} | more)
        return len(self.accessors) - 1

    def add_bounded(self, values: np.ndarray, target: int | None = None) -> int:
        """Add an array with the minimum and maximum of each column, which the format requires of some arrays."""
        columns = values.reshape(len(values), -1)
        return self.add(values, target, min=columns.min(axis=0).tolist(), max=columns.max(axis=0).tolist())


def write_glb(path: str | Path, clip: Clip, names: tuple[str, ...] | None = None) -> None:
    """Write a clip as an animated, skinned skeleton of its own joints and end sites, under `names` if they are given.

    The file appears whole or not at all. Raises BodysenseError for a clip that is not one finite motion, for a skeleton
    that is not of the default's tree, and for a folder that cannot be written.
    """
    check_motion(path, clip)
    skeleton, arrays = clip.pose.skeleton, Arrays()
    count = len(skeleton.points)
    nodes = skeleton_nodes(skeleton, names or skeleton.points)
    mesh = skin_mesh(skeleton)
    bind = np.tile(np.eye(4, dtype="<f4"), (count, 1, 1))
    bind[:, 3, :3] = -(skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0])  # columns lie one after another
    joint, weight = np.zeros((2, len(mesh.joint), 4), dtype="u1")
    joint[:, 0], weight[:, 0] = mesh.joint, 255
    color = np.full((len(mesh.joint), 4), 255, dtype="u1")
    # glTF requires linear colours of vertices, not sRGB
    color[:, :3] = np.round(
        255 * np.where(mesh.color <= 0.04045, mesh.color / 12.92, ((mesh.color + 0.055) / 1.055) ** 2.4)
    )
    attributes = {
        "POSITION": arrays.add_bounded(mesh.position.astype("<f4"), _VERTICES),
        "NORMAL": arrays.add(normalize(mesh.normal).astype("<f4"), _VERTICES),
        "COLOR_0": arrays.add(color, _VERTICES, normalized=True),
        "JOINTS_0": arrays.add(joint, _VERTICES),
        "WEIGHTS_0": arrays.add(weight, _VERTICES, normalized=True),
    }
    triangles = arrays.add(mesh.triangle.astype("<u4").ravel(), _INDICES)
    document = {
        "scenes": [{"nodes": [0, count]}],
        "nodes": [*nodes, {"name": "body", "mesh": 0, "skin": 0}],
        "meshes": [{"name": "body", "primitives": [{"attributes": attributes, "indices": triangles, "material": 0}]}],
        "materials": [{"name": "body", "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9}}],
        "skins": [{"joints": list(range(count)), "skeleton": 0, "inverseBindMatrices": arrays.add(bind)}],
        "animations": [animation(clip, range(len(skeleton.joints)), arrays)],
    }
    write_binary(path, document, arrays)


def check_motion(path: str | Path, clip: Clip) -> None:
    """Raise BodysenseError for a clip that is not one finite motion."""
    rotation, root = np.asarray(clip.pose.rotation), np.asarray(clip.pose.root_position)
    finite = np.isfinite(rotation).all() and np.isfinite(root).all()
    if rotation.ndim != 3 or not len(rotation) or not finite or not 0 < clip.frame_rate < np.inf:
        raise BodysenseError(
            f"{path}: a file holds one motion of finite numbers at a positive rate, rotation (T, J, 4); got "
            f"{rotation.shape}{'' if finite else ', not all finite'} at {clip.frame_rate:g} Hz"
        )


def skeleton_nodes(skeleton: Skeleton, names: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return a node in the rest pose for each of the first points of a skeleton, one for each name."""
    nodes: list[dict[str, Any]] = [
        {"name": name, "translation": place} for name, place in zip(names, skeleton.rest_offset.tolist(), strict=False)
    ]
    for point, parent in enumerate(skeleton.parents[1 : len(names)], start=1):
        nodes[parent].setdefault("children", []).append(point)
    return nodes


def animation(clip: Clip, joints: Any, arrays: Arrays) -> dict[str, Any]:
    """Return the motion of nodes 0 … J − 1, which are the joints: the root's position, and rotations of `joints`."""
    times = arrays.add_bounded(clip.time.astype("<f4"))
    samplers = [{"input": times, "output": arrays.add(np.asarray(clip.pose.root_position).astype("<f4"))}]
    channels: list[dict[str, Any]] = [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]
    for joint in joints:
        turns = continuous(np.asarray(clip.pose.rotation[:, joint], dtype=float))[:, [1, 2, 3, 0]]
        channels.append({"sampler": len(samplers), "target": {"node": joint, "path": "rotation"}})
        samplers.append({"input": times, "output": arrays.add(normalize(turns).astype("<f4"))})
    return {"name": clip.name, "samplers": samplers, "channels": channels}


def write_binary(path: str | Path, document: dict[str, Any], arrays: Arrays) -> None:
    """Write a document and its arrays as GLB, container version 2."""
    whole = {"asset": {"version": "2.0", "generator": "bodysense"}, "scene": 0, **document}
    whole |= {"buffers": [{"byteLength": len(arrays.binary)}]}
    whole |= {"bufferViews": arrays.views, "accessors": arrays.accessors}
    text = json.dumps(whole, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(arrays.binary)
    if size >= 2**32:
        raise BodysenseError(f"{path}: {size} bytes are more than a .glb file can hold (4 GiB); cut the motion")
    with written_beside(path) as part, part.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, size))
        file.write(struct.pack("<II", len(text), JSON) + text)
        file.write(struct.pack("<II", len(arrays.binary), BINARY))
        file.write(arrays.binary)
