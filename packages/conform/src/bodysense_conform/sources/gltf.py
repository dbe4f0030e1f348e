"""Animated glTF files (.glb, .gltf, .vrma) as subjects: places as their nodes move, stretched bones included."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, local_rotation
from bodysense.body.rotation import matrix_to_quaternion, normalize, quaternion_to_matrix, slerp
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.gltf.file import GltfFile, open_gltf
from bodysense.io.gltf.humanoid import VRM_BONES
from bodysense.io.rigs.canonical import canonical
from bodysense.io.rigs.named import NEEDED
from bodysense.io.rigs.names import joints_of
from bodysense_conform.subject import Subject, ordered

_AT_REST: dict[str, list[float]] = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}


def read_gltf(path: Path) -> Subject:
    """Read the first animation of a file. Raises BodysenseError, naming the file, where there is no body."""
    file = open_gltf(path)
    try:
        time, tracks = _animation(file)
        rest, moving = _world(file, {}, 1), _world(file, tracks, len(time))
        names = _names(file)
    except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
        raise BodysenseError(
            f"{path}: no animated glTF 2.0 ({error!r:.80}); export a skeleton with an animation"
        ) from None
    if not np.isfinite(time).all() or len(time) < 2:
        raise BodysenseError(f"{path}: its animation has {len(time)} usable times; export one of at least two frames")
    return _subject(file, names, time, rest, moving)


def _subject(file: GltfFile, names: dict[int, str], time: np.ndarray, rest: np.ndarray, moving: np.ndarray) -> Subject:
    """Joints by their names: places as they move, rotations from the T-pose by the rest pose."""
    path, parents = file.path, file.parents
    kept = [node for node in file.order if node in names]
    index = {node: k for k, node in enumerate(kept)}
    above = []
    for node in kept:
        parent = parents[node]
        while parent >= 0 and parent not in index:
            parent = parents[parent]
        above.append(index.get(parent, -1))
    if above.count(-1) != 1:
        raise BodysenseError(f"{path}: its joints hang on {above.count(-1)} roots; export one skeleton with one root")
    place = rest[0][kept][:, :3, 3]
    offset = place - np.where(np.array(above)[:, None] < 0, 0, place[above])
    skeleton = Skeleton(tuple(names[node] for node in kept), (), tuple(above), offset)
    turn = quaternion_to_matrix(normalize(_rotations(moving[:, kept]))) @ np.swapaxes(
        quaternion_to_matrix(_rotations(rest[:, kept])), -1, -2
    )
    good = np.isfinite(turn).all(axis=(-1, -2))
    world = np.where(good[..., None], matrix_to_quaternion(np.where(good[..., None, None], turn, np.eye(3))), np.nan)
    pose = Pose(skeleton, moving[..., :3, 3][:, kept[0]], local_rotation(skeleton, world))
    found = joints_of(skeleton.joints)
    whole = canonical(Clip(str(path), pose, 1 / float(np.median(np.diff(time)))), joints=found)
    rotation = np.asarray(forward_kinematics(whole.pose)[1])
    ours, points = default_skeleton(), ordered(list(found.values()))
    places = {mine: skeleton.index(given) for given, mine in found.items()}
    turned = [ours.index(name) if name in ours.joints else -1 for name in points]
    rotations = np.stack([rotation[:, k] if k >= 0 else np.full((len(time), 4), np.nan) for k in turned], axis=1)
    return Subject(
        name=path.stem,
        format="VRMA" if path.suffix.lower() == ".vrma" else "glTF",
        points=points,
        time=time,
        position=moving[..., :3, 3][:, [kept[places[name]] for name in points]],
        rotation=rotations,
        rotated=np.array(turned) >= 0,
        valid=np.ones((len(time), len(points)), dtype=bool),
    )


def _names(file: GltfFile) -> dict[int, str]:
    """Names of the nodes that may be joints: of VRM's humanoid if there is one, else those of the skin, or all."""
    path, document, nodes = file.path, file.document, file.nodes
    for extension, entry in document.get("extensions", {}).items():
        bones = entry.get("humanoid", {}).get("humanBones") if isinstance(entry, dict) else None
        if extension in ("VRMC_vrm", "VRMC_vrm_animation") and isinstance(bones, dict):
            ours = {theirs: name for name, theirs in VRM_BONES.items()}
            return {row["node"]: ours[bone] for bone, row in bones.items() if bone in ours}
    skins = document.get("skins", [])
    chosen = set(skins[0]["joints"]) if skins else set(range(len(nodes)))
    named = {k: nodes[k].get("name", f"node{k}") for k in chosen}
    if len(set(named.values())) < len(named):
        raise BodysenseError(f"{path}: two joints of its skeleton have one name; rename one")
    ours = joints_of(list(named.values()))
    if missing := [joint for joint in NEEDED if joint not in ours.values()]:
        lacks = ", ".join(missing[:4])
        raise BodysenseError(
            f"{path}: no node is named as {lacks}; name its joints as VRM or Mixamo do, or export a .vrma"
        )
    return {k: name for k, name in named.items() if name in ours}


_Tracks = dict[tuple[int, str], np.ndarray]


def _animation(file: GltfFile) -> tuple[np.ndarray, _Tracks]:
    """The times of its densest track and all tracks at these."""
    animation = file.document["animations"][0]
    raw: dict[tuple[int, str], tuple[np.ndarray, np.ndarray]] = {}
    for channel in animation["channels"]:
        target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
        if "node" not in target or target["path"] not in _AT_REST:
            continue
        times, values = file.array(sampler["input"])[:, 0], file.array(sampler["output"])
        if sampler.get("interpolation") == "CUBICSPLINE":
            values = values.reshape(len(times), 3, -1)[:, 1]
        raw[target["node"], target["path"]] = times, values
    if not raw:
        raise ValueError("an animation that moves no node")
    time = max((times for times, _ in raw.values()), key=len)
    return time, {key: _at(time, *track, key[1]) for key, track in raw.items()}


def _at(time: np.ndarray, times: np.ndarray, values: np.ndarray, path: str) -> np.ndarray:
    """Values of a track at other times."""
    if np.array_equal(time, times):
        return values
    place = np.interp(time, times, np.arange(len(times)))
    before = np.floor(place).astype(int)
    after, share = np.minimum(before + 1, len(times) - 1), place - before
    if path == "rotation":
        return np.roll(slerp(np.roll(values[before], 1, -1), np.roll(values[after], 1, -1), share), -1, -1)
    return values[before] + share[:, None] * (values[after] - values[before])


def _world(file: GltfFile, tracks: _Tracks, frames: int) -> np.ndarray:
    """(T, N, 4, 4) world matrices of all nodes."""
    nodes, parents = file.nodes, file.parents
    world = np.zeros((frames, len(nodes), 4, 4))
    for k in file.order:
        local = np.broadcast_to(np.eye(4), (frames, 4, 4)).copy()
        if "matrix" in nodes[k] and not any(key[0] == k for key in tracks):
            local[:] = np.array(nodes[k]["matrix"], dtype=float).reshape(4, 4).T
        else:
            move, turn, scale = (
                tracks.get((k, part), np.array([nodes[k].get(part, rest)], dtype=float))
                for part, rest in _AT_REST.items()
            )
            local[:, :3, :3] = quaternion_to_matrix(normalize(np.roll(turn, 1, axis=-1))) * scale[:, None, :]
            local[:, :3, 3] = move
        world[:, k] = world[:, parents[k]] @ local if parents[k] >= 0 else local
    return world


def _rotations(world: np.ndarray) -> np.ndarray:
    """The turns (..., 4) of matrices that may scale."""
    turn = world[..., :3, :3] / np.maximum(np.linalg.norm(world[..., :3, :3], axis=-2, keepdims=True), 1e-9)
    good = np.isfinite(turn).all(axis=(-1, -2))
    found = matrix_to_quaternion(np.where(good[..., None, None], turn, np.eye(3)))
    return np.where(good[..., None], found, np.nan)
