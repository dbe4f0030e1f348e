"""glTF 2.0 in one binary file (.glb): an animated skeleton with a mesh that viewers display.

glTF's world is ours: right-handed, +Y up, metres, bodies face +Z; only quaternions are x, y, z, w. Every point of the
skeleton is a node under its own name; in the rest pose nothing is rotated.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.body.surface import fit_surface
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.geometry.rotation import normalize
from bodysense.geometry.series import continuous
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.file import BINARY, JSON

_KINDS = {np.dtype("<f4"): 5126, np.dtype("u1"): 5121, np.dtype("<u2"): 5123}
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
    surface = fit_surface(skeleton)
    bind = np.tile(np.eye(4, dtype="<f4"), (count, 1, 1))
    bind[:, 3, :3] = -(skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0])  # columns lie one after another
    mesh = surface.mesh
    color = np.full((len(mesh.color), 4), 255, dtype="u1")
    color[:, :3] = np.round(255 * mesh.color)
    attributes = {
        "POSITION": arrays.add_bounded(mesh.position.astype("<f4"), _VERTICES),
        "NORMAL": arrays.add(normalize(mesh.normal).astype("<f4"), _VERTICES),
        "COLOR_0": arrays.add(color, _VERTICES, normalized=True),
        "JOINTS_0": arrays.add(surface.joint.astype("u1"), _VERTICES),
        "WEIGHTS_0": arrays.add(np.round(255 * surface.weight).astype("u1"), _VERTICES, normalized=True),
    }
    triangles = arrays.add(mesh.triangle.astype("<u2").ravel(), _INDICES)
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
