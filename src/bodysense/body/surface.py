"""The drawn surface of a body: the page's avatar, a skinned mesh that is fitted to any skeleton of the default tree.

The file is a VRM 1.0 avatar, packed by gzip, that the page displays, too (docs/credits.md).
"""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import files
from typing import Any

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_to_matrix

UNSEEN = np.array([0.69, 0.12, 0.11], np.float32)  # linear red, green, blue of parts that are not tracked
_TYPES = {5121: np.dtype("u1"), 5123: np.dtype("<u2"), 5126: np.dtype("<f4")}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_SOLE = 0.005  # m over the floor in the rest pose, below which a vertex is of a sole
# Where a bone ends whose joint has several children.
_ENDS = {"pelvis": "spine1", "spine3": "neck", "left_wrist": "left_middle1", "right_wrist": "right_middle1"}


@dataclass(frozen=True, eq=False)
class Mesh:
    """V vertices and F triangles, counter-clockwise as seen from outside."""

    position: np.ndarray = field(repr=False)  # (V, 3) m
    normal: np.ndarray = field(repr=False)  # (V, 3) unit
    color: np.ndarray = field(repr=False)  # (V, 3) red, green, blue, 0 to 1, linear
    triangle: np.ndarray = field(repr=False)  # (F, 3) vertices


@dataclass(frozen=True, eq=False)
class BodySurface:
    """A mesh in the T-pose of a skeleton, and the joints that carry its vertices."""

    skeleton: Skeleton
    mesh: Mesh
    joint: np.ndarray = field(repr=False)  # (V, 4) indices
    weight: np.ndarray = field(repr=False)  # (V, 4) shares; rows sum to 1

    def placed(self, pose: Pose) -> Iterator[Mesh]:
        """Yield the mesh, world, of each frame of a pose (T, …) of the skeleton, by linear blend skinning."""
        position, rotation = forward_kinematics(pose)
        count = len(self.skeleton.joints)
        turn = quaternion_to_matrix(np.asarray(rotation))
        rest = _rest(self.skeleton)[:count]
        shift = np.asarray(position)[:, :count] - np.einsum("tjab,jb->tja", turn, rest)
        frames = np.concatenate([turn, shift[..., None]], axis=-1).astype(np.float32).reshape(-1, count, 12)
        shares = self._shares
        vertices, normals = self.mesh.position.astype(np.float32), self.mesh.normal.astype(np.float32)
        for frame in frames:
            blended = (shares @ frame).reshape(-1, 3, 4)
            yield replace(
                self.mesh,
                position=np.einsum("vab,vb->va", blended[..., :3], vertices) + blended[..., 3],
                normal=np.einsum("vab,vb->va", blended[..., :3], normals),
            )

    @property
    def _shares(self) -> np.ndarray:
        """Shares (V, J) of all joints in each vertex."""
        shares = np.zeros((len(self.joint), len(self.skeleton.joints)), np.float32)
        np.add.at(shares, (np.arange(len(shares))[:, None], self.joint), self.weight)
        return shares

    @property
    def soles(self) -> BodySurface:
        """The vertices of the soles alone, without triangles."""
        low = self.mesh.position[:, 1] < self.mesh.position[:, 1].min() + _SOLE
        part = Mesh(self.mesh.position[low], self.mesh.normal[low], self.mesh.color[low], np.zeros((0, 3), int))
        return BodySurface(self.skeleton, part, self.joint[low], self.weight[low])


@lru_cache(maxsize=16)
def fit_surface(skeleton: Skeleton) -> BodySurface:
    """Fit the avatar to a skeleton: as thick as its height says, and along each bone as long as the bone.

    Raises BodysenseError for a skeleton with other points or parents.
    """
    avatar = _avatar()
    own = avatar.skeleton
    if skeleton.points != own.points or skeleton.parents != own.parents:
        raise BodysenseError("body: only a skeleton with the default's points and parents can be drawn")
    scale = skeleton.extent / own.extent
    moved = _rest(skeleton) - scale * _rest(own)  # (P, 3) m, of each point, apart from the scale
    ends = np.array(  # of each joint's bone
        [own.index(_ENDS[name]) if name in _ENDS else own.parents.index(joint) for joint, name in enumerate(own.joints)]
    )
    rest = _rest(own)
    bone = rest[ends] - rest[: len(ends)]
    fitted = scale * avatar.mesh.position
    for k in range(avatar.joint.shape[1]):
        joint = avatar.joint[:, k]
        along = np.einsum("va,va->v", avatar.mesh.position - rest[joint], bone[joint])
        share = np.clip(along / np.maximum((bone * bone).sum(axis=1), 1e-9)[joint], 0.0, 1.0)[:, None]
        fitted = fitted + avatar.weight[:, k, None] * (moved[joint] * (1 - share) + moved[ends[joint]] * share)
    return BodySurface(skeleton, replace(avatar.mesh, position=fitted), avatar.joint, avatar.weight)


@lru_cache(maxsize=16)
def nearest_points(skeleton: Skeleton) -> np.ndarray:
    """Return for each vertex (V,) the nearest point in the rest pose: the joint that carries most of it, or a child."""
    surface, rest = fit_surface(skeleton), _rest(skeleton)
    main = np.take_along_axis(surface.joint, surface.weight.argmax(axis=1)[:, None], axis=1)
    points, parents = np.arange(len(rest)), np.array(skeleton.parents)
    squared = ((surface.mesh.position[:, None] - rest) ** 2).sum(axis=-1)
    return np.where((points == main) | (parents == main), squared, np.inf).argmin(axis=1)


def _rest(skeleton: Skeleton) -> np.ndarray:
    """Return the points (P, 3) m of the T-pose."""
    return skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0]


@lru_cache(maxsize=1)
def _avatar() -> BodySurface:
    """Return the packaged avatar in its own proportions."""
    with files("bodysense.body").joinpath("avatar.vrm.gz").open("rb") as file:
        data = gzip.decompress(file.read())
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    binary = memoryview(data)[28 + length :]
    (primitive,) = document["meshes"][0]["primitives"]
    position, normal, color, joint, weight = (
        _array(document, binary, primitive["attributes"][name])
        for name in ("POSITION", "NORMAL", "COLOR_0", "JOINTS_0", "WEIGHTS_0")
    )
    skeleton = default_skeleton()
    offset = skeleton.rest_offset.copy()
    places = {node["name"]: node.get("translation") for node in document["nodes"]}
    offset[: len(skeleton.joints)] = [places[name] for name in skeleton.joints]
    nodes = document["skins"][0]["joints"]
    own = np.array([skeleton.index(document["nodes"][node]["name"]) for node in nodes])
    return BodySurface(
        skeleton.with_offsets(offset),
        Mesh(
            position.astype(float),
            normal.astype(float),
            (color[:, :3] / np.float32(65535)).astype(np.float32),
            _array(document, binary, primitive["indices"]).reshape(-1, 3).astype(np.intp),
        ),
        own[joint],
        weight / weight.sum(axis=1, keepdims=True, dtype=float),
    )


def _array(document: dict[str, Any], binary: memoryview, accessor: int) -> np.ndarray:
    """Return an array (N, width) of the file."""
    about = document["accessors"][accessor]
    view, width = document["bufferViews"][about["bufferView"]], _WIDTHS[about["type"]]
    values = np.frombuffer(binary, _TYPES[about["componentType"]], about["count"] * width, view.get("byteOffset", 0))
    return values.reshape(about["count"], width)
