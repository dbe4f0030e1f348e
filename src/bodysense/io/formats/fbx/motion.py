"""Motion of the skeletons in an FBX file, baked at the rate of the take.

The zero pose of a joint is its bind pose: that of its skin, else of the file's bind pose, else the node at rest. So the
turns of a joint's axes (pre-rotations, joint orientations, the export axes of Blender) are not seen by anything else,
and `FbxMotion.turn` restores them when the file is written. Scale is dropped: bones have their length in the world.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import HUGE
from bodysense.geometry.rotation import (
    matrix_to_quaternion,
    normalize,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
)
from bodysense.io.formats.fbx.library import HAS_BIND, IS_BONE, IS_EMPTY, IS_SKINNED, FbxFile, opened
from bodysense.io.formats.fbx.writer import Axes, FbxSkeleton, write_skeleton
from bodysense.io.rigs.joint_file import JointFile, Node, euler_near
from bodysense.io.rigs.names import is_end
from bodysense.observing.world_axes import UNITS, UpAxis

_AXES: tuple[UpAxis, ...] = ("x", "-x", "y", "-y", "z", "-z")  # in the order of ufbx
# Right, up and front for each upward axis, so that bodies face +Z once the axis is up (`world_axes.TURNS`).
_FACING: dict[UpAxis, Axes] = {
    **{"x": (3, 0, 4), "-x": (2, 1, 4), "y": (0, 2, 4)},
    **{"-y": (0, 3, 5), "z": (0, 4, 3), "-z": (0, 5, 2)},
}
_UNKNOWN = 6  # direction of an axis that the file does not state
_LONGEST = 10**7  # frames × nodes
_RATES = (1.0, 1000.0)  # Hz
_STILL = 1e-5  # of a skeleton's largest offset: joints that move by less keep their place in their parent
_PLACE, _TURN = ("Xposition", "Yposition", "Zposition"), ("Zrotation", "Xrotation", "Yrotation")


@dataclass(frozen=True, eq=False)
class FbxMotion(JointFile):
    """The skeletons of an FBX file, each joint's zero pose being its bind pose, and one of its animations."""

    turn: np.ndarray  # (J, 4) world rotation of each joint's axes in the bind pose
    metres: float  # of one unit of the file
    axes: Axes  # directions of right, up and front
    animation: str

    @property
    def unit(self) -> str | None:
        """Length unit that the file states."""
        return next((name for name, size in UNITS.items() if abs(size / self.metres - 1) < 1e-6), f"{self.metres:g}")

    @property
    def up(self) -> UpAxis | None:
        """Upward axis that the file states."""
        return None if self.axes[1] == _UNKNOWN else _AXES[self.axes[1]]

    def with_values(self, values: np.ndarray, changed: np.ndarray) -> FbxMotion:
        """Return the file with numbers (T, C) that differ where `changed` (T, C)."""
        self.check_finite(values[changed])
        return replace(self, values=values)

    def with_frames(self, row: np.ndarray, count: int, frame_rate: float) -> FbxMotion:
        """Return the file with `count` frames of one row (C,) of values."""
        return replace(self, values=np.tile(row, (count, 1)), frame_rate=frame_rate)

    def write(self, path: str | Path) -> None:
        """Write skeleton and motion as FBX, in the file's unit, axes and bind pose; the file appears whole or not."""
        above = np.array([self.turn[parent] if parent >= 0 else _IDENTITY for parent in self.parents])
        back = quaternion_conjugate(above)
        places = {
            joint: quaternion_rotate(back[joint], self.place(joint))
            for joint in range(len(self.joints))
            if self.columns_of(joint, "position")
        }
        local = quaternion_multiply(quaternion_multiply(back, self.rotation), self.turn)
        rest = quaternion_multiply(back, self.turn)
        offset = quaternion_rotate(back, self.offset)
        skeleton = FbxSkeleton(self.joints, self.parents, offset, rest, self.metres, self.axes)
        turns = dict(enumerate(np.moveaxis(np.asarray(quaternion_canonical(local)), 1, 0)))
        write_skeleton(path, skeleton, places, turns, self.frame_rate, self.animation)


_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def parse_fbx(data: bytes, path: Path, animation: str | None = None, skin: str | None = None) -> FbxMotion:
    """Read the skeletons of a file's bytes, and an animation, baked at the file's rate; `path` names it.

    Args:
        data: the file.
        path: its name, for messages.
        animation: name of the animation; the one that moves most joints if omitted.
        skin: name of the skinned mesh whose skeleton is read; every skeleton if omitted.

    Raises BodysenseError, naming the file, what is wrong and the fix, for anything that is not a moving skeleton.
    """
    with opened(data, path) as scene:
        nodes = _nodes(scene, path, skin)
        stack, name = _stack(scene, path, nodes, animation)
        moved, begin, end = scene.stack(stack)
        rate = scene.rate
        if not _RATES[0] <= rate <= _RATES[1]:
            raise BodysenseError(
                f"{path}: {rate:g} frames a second, not {_RATES[0]:g} to {_RATES[1]:g}; export it again"
            )
        frames = int((end - begin) * rate + 1e-3) + 1 if np.isfinite(end - begin) else _LONGEST
        if frames * len(nodes) > _LONGEST:
            raise BodysenseError(f"{path}: {frames} frames of {len(nodes)} joints; cut it in parts")
        parents, flags, rest, bind = scene.nodes
        local = np.tile(rest[nodes], (frames, 1, 1))
        moving = np.flatnonzero(moved[nodes])
        local[:, moving] = scene.baked(stack, nodes[moving], begin, 1 / rate, frames)
        place = {int(node): k for k, node in enumerate(nodes)}
        above = tuple(place.get(int(parents[node]), -1) for node in nodes)
        names, axes, metres = scene.names, scene.axes, scene.unit
        skeleton = _Skeleton(
            tuple(_plain(names[node]) or f"node {node}" for node in nodes),
            *(above, rest[nodes], bind[nodes], (flags[nodes] & HAS_BIND) > 0),
        )
    if not np.isfinite(local).all() or np.abs(local).max() > HUGE:
        raise BodysenseError(f"{path}: its animation is not all finite; export it again")
    if _UNKNOWN not in axes and np.linalg.det(_directions(axes)) < 0:  # left-handed, until an axis is reversed
        axis = axes[0] // 2  # 0 x, 1 y, 2 z
        skeleton, local, axes = _unmirrored(skeleton, local, axis), _flip(local, axis), (axes[0] ^ 1, axes[1], axes[2])
    if axes not in _FACING.values() and _UNKNOWN not in axes:
        facing = _FACING[_AXES[axes[1]]]
        turn = matrix_to_quaternion(_directions(facing).T @ _directions(axes))
        rest, local = (_turned_roots(one, skeleton.parents, turn) for one in (skeleton.rest, local))
        skeleton = replace(skeleton, rest=rest, bind=quaternion_to_matrix(turn) @ skeleton.bind)
        axes = facing
    return _motion(path, skeleton, local, rate, metres if np.isfinite(metres) and metres > 0 else 0.01, axes, name)


@dataclass(frozen=True, eq=False)
class _Skeleton:
    """The nodes that are joints, parents before children."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    rest: np.ndarray  # (J, 10) local transforms at rest
    bind: np.ndarray  # (J, 3, 4) world matrices in the bind pose, where `has_bind`
    has_bind: np.ndarray  # (J,) bool


def _plain(name: str) -> str:
    return "".join(letter if letter.isprintable() else "_" for letter in name)


def _nodes(scene: FbxFile, path: Path, skin: str | None) -> np.ndarray:
    """Return the nodes of skeletons, parents first: bones and empties, and what carries them; of one skin if named."""
    parents, flags, _, _ = scene.nodes
    depth = np.zeros(len(parents), dtype=int)
    order = [0]
    children: list[list[int]] = [[] for _ in parents]
    for node, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(node)
    for node in order:
        order += children[node]
        depth[children[node]] = depth[node] + 1
    keep = (flags & (IS_BONE | IS_EMPTY | IS_SKINNED)) > 0
    if skin is not None:
        skins = scene.skins
        if skin not in skins:
            listed = ", ".join(skins) or "none"
            raise BodysenseError(f"{path}: --skin {skin}: no skinned mesh has this name; there are: {listed}")
        carriers = scene.carriers(skins.index(skin))
        for node in order:  # joints below those that carry the skin, such as ends of fingers
            carriers[node] |= parents[node] >= 0 and carriers[parents[node]]
        keep &= carriers
    keep &= ~_leaf_bones(scene.names, parents, children)
    for node in reversed(order):
        if keep[node] and parents[node] >= 0:
            keep[parents[node]] = True
    keep[0] = False  # the scene itself
    return np.array([node for node in order if keep[node]], dtype=int)


def _leaf_bones(names: list[str], parents: np.ndarray, children: list[list[int]]) -> np.ndarray:
    """Return (N,) bool: bones that Blender adds behind bones that are ends themselves, `HeadTop_End_end`."""
    sites = default_skeleton().end_sites
    added = np.zeros(len(names), dtype=bool)
    for node, parent in enumerate(parents):
        if parent >= 0 and not children[node] and names[node] == f"{names[parent]}_end":
            added[node] = is_end(names[parent]) or names[parent] in sites
    return added


def _stack(scene: FbxFile, path: Path, nodes: np.ndarray, animation: str | None) -> tuple[int, str]:
    """Return the index and name of the animation: the named one, else the one that moves most joints."""
    stacks = scene.stacks
    if animation is not None:
        if animation not in stacks:
            listed = ", ".join(stacks) or "none"
            raise BodysenseError(f"{path}: --animation {animation}: no animation has this name; there are: {listed}")
        return stacks.index(animation), animation
    moved = [int(scene.stack(stack)[0][nodes].sum()) for stack in range(len(stacks))]
    if not any(moved):
        what = "no skeleton is in it" if not len(nodes) else "its skeleton is not animated"
        raise BodysenseError(f"{path}: {what}; export it with its skeleton and animation")
    best = int(np.argmax(moved))
    return best, _plain(stacks[best]) or "Take 001"


def _directions(axes: Axes) -> np.ndarray:
    """Return right, up and front (3, 3) in the file's world."""
    return np.array([np.eye(3)[axis // 2] * (1 - 2 * (axis % 2)) for axis in axes])


def _flip(local: np.ndarray, axis: int) -> np.ndarray:
    """Return local transforms (..., 10) mirrored along an axis."""
    flipped = local.copy()
    flipped[..., axis] *= -1
    flipped[..., [4 + k for k in range(3) if k != axis]] *= -1
    return flipped


def _unmirrored(skeleton: _Skeleton, local: np.ndarray, axis: int) -> _Skeleton:
    mirror = np.ones(3)
    mirror[axis] = -1
    bind = skeleton.bind * mirror[:, None] * np.append(mirror, 1.0)
    return replace(skeleton, rest=_flip(skeleton.rest, axis), bind=bind)


def _turned_roots(local: np.ndarray, parents: tuple[int, ...], turn: np.ndarray) -> np.ndarray:
    """Return local transforms (..., J, 10) in a world that is turned by a rotation (4,)."""
    roots, turned = [k for k, parent in enumerate(parents) if parent < 0], local.copy()
    turned[..., roots, :3] = quaternion_rotate(turn, local[..., roots, :3])
    above = np.broadcast_to(turn, (*local.shape[:-2], len(roots), 4))
    turned[..., roots, 3:7] = quaternion_multiply(above, local[..., roots, 3:7])
    return turned


def _motion(
    path: Path, skeleton: _Skeleton, local: np.ndarray, rate: float, metres: float, axes: Axes, animation: str
) -> FbxMotion:
    """Return the motion of local transforms (T, J, 10), with each joint's bind pose as its zero pose."""
    frames, count = local.shape[:2]
    turn = _bind_turns(skeleton)
    scale = np.ones((frames, count, 3))
    place, rotation = np.empty((frames, count, 3)), np.empty((frames, count, 4))
    carries = set(skeleton.parents)
    for joint, parent in enumerate(skeleton.parents):
        above, size = (turn[parent], scale[:, parent]) if parent >= 0 else (_IDENTITY, 1.0)
        place[:, joint] = quaternion_rotate(above, local[:, joint, :3] * size)
        turned = quaternion_multiply(np.broadcast_to(above, (frames, 4)), normalize(local[:, joint, 3:7]))
        rotation[:, joint] = quaternion_multiply(turned, quaternion_conjugate(turn[joint]))
        scale[:, joint] = local[:, joint, 7:] * size
        if joint in carries and not (scale[:, joint] > 1e-9).all():
            raise BodysenseError(
                f"{path}: {skeleton.names[joint]!r} is scaled to nothing or mirrored; apply the scale before the export"
            )
    offset = np.median(place, axis=0)
    moves = np.ptp(place, axis=0).max(axis=-1) > _STILL * max(np.abs(offset[1:]).max(initial=0.0), 1e-9)
    channels, columns = [], []
    for joint, parent in enumerate(skeleton.parents):
        has_place = parent < 0 or bool(moves[joint])
        channels.append((*(_PLACE if has_place else ()), *_TURN))
        if has_place:
            columns.append(place[:, joint])
        else:
            offset[joint] = place[0, joint]
        columns.append(np.rad2deg(euler_near(np.asarray(quaternion_canonical(rotation[:, joint])), "ZXY", np.zeros(3))))
    nodes = [
        Node(name, parent, False, (float(x), float(y), float(z)), own)
        for name, parent, (x, y, z), own in zip(skeleton.names, skeleton.parents, offset, channels, strict=True)
    ]
    return FbxMotion(
        path=path,
        tree=tuple(nodes),
        nodes=tuple(range(count)),
        joints=skeleton.names,
        parents=skeleton.parents,
        offset=offset,
        channels=tuple(channels),
        values=np.concatenate(columns, axis=1),
        frame_rate=float(round(rate)) if abs(rate - round(rate)) < 1e-4 * rate else rate,
        turn=turn,
        metres=metres,
        axes=axes,
        animation=animation,
    )


def _bind_turns(skeleton: _Skeleton) -> np.ndarray:
    """Return the world rotation (J, 4) of each joint in the bind pose; without one it follows its parent at rest."""
    turn = np.zeros((len(skeleton.names), 4))
    axes = skeleton.bind[:, :, :3]
    length = np.linalg.norm(axes, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", over="ignore"):
        is_rotation = np.isfinite(axes).all(axis=(1, 2)) & (length > 1e-9).all(axis=(1, 2))
        is_rotation &= np.linalg.det(np.where(is_rotation[:, None, None], axes, np.eye(3))) > 0
    for joint, parent in enumerate(skeleton.parents):
        if skeleton.has_bind[joint] and is_rotation[joint]:
            turn[joint] = matrix_to_quaternion(axes[joint] / length[joint])
        else:
            above = turn[parent] if parent >= 0 else _IDENTITY
            turn[joint] = quaternion_multiply(above, normalize(skeleton.rest[joint, 3:7]))
    return np.asarray(normalize(turn))
