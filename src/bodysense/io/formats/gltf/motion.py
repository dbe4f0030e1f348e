"""Motion of a humanoid in glTF 2.0: animated skeletons in .glb and .gltf, VRM animations, animated VRM avatars.

Rest poses of nodes may be turned and scaled freely: only the joints' resting positions in the world and their
rotations from there matter.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, local_rotation
from bodysense.body.skeleton import Skeleton, chain_to_root, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    matrix_to_quaternion,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_to_matrix,
)
from bodysense.io.checked import checked
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.file import GltfFile, open_gltf
from bodysense.io.formats.gltf.humanoid import VRM_BONES, from_t_posed
from bodysense.io.formats.gltf.tracks import Track, sampled, tracks_of
from bodysense.io.reading_options import ReadingOptions
from bodysense.io.rigs.canonical import canonical
from bodysense.io.rigs.figure import Figure
from bodysense.io.rigs.names import joints_of
from bodysense.io.rigs.rig import Rig, recognise

HEIGHTS = (1.0, 2.6)  # m, of a resting body in metres
USUAL = 1.7  # m, of a body in no known unit
_STEADY = 0.02  # share by which the steps between frames may differ
STRETCH = 1e-4  # m: bones that vary by less are rigid
_CARRIED = 0.1  # of a bone's length: a foot whose distance from the knee varies by less is carried by the shin
_LOOKED_AT = 60  # frames used to recognise a body
_LONGEST = 10**7  # frames × nodes


def read_gltf(path: Path, joints: Path | None = None, animation: str | None = None) -> tuple[Clip, tuple[str, ...]]:
    """Return the motion of a file in canonical form, and remarks. Raises BodysenseError without a moving humanoid.

    `joints` is a file that names the joints (`io.rigs.rig`); they are recognised if it is omitted. `animation` is the
    name of the animation; the one with the most tracks if omitted.
    """
    file = open_gltf(path)
    names, is_vrm = _names(file)
    tracks = _tracks(file, animation)
    if is_vrm and joints is not None:
        raise BodysenseError(f"{path}: a VRM file names its joints; leave --joints out")
    file = _with_loose_ends(file, names, tracks)
    rig = _recognised(file, _figure(file, names, tracks), joints)
    root = names.index(rig.joints.get("pelvis", rig.hub))
    below, points = _below(file, root), default_skeleton().points
    if sorted(names[k] for k in below) == sorted(points):  # exactly ours: so ordered, end sites can be separated
        below.sort(key=lambda k: points.index(names[k]))
    time = _times(path, tracks, below)
    if len(time) * len(below) > _LONGEST:
        raise BodysenseError(f"{path}: {len(time)} frames of {len(below)} nodes; cut it in parts")
    rest = _world(file, below, {}, np.zeros(1))
    moving = _world(file, below, tracks, time)
    parents = tuple(-1 if k == root else below.index(file.carriers[k]) for k in below)
    place = rest[:, 0, :3, 3]
    offset = np.stack([place[n] - (place[parent] if parent >= 0 else 0) for n, parent in enumerate(parents)])
    resting, turned = (_turns(path, matrices) for matrices in (rest, moving))
    world = quaternion_multiply(turned, quaternion_conjugate(resting))  # (J, T, 4)
    scale, remarks = _scale(path, place)
    skeleton = _skeleton(path, [names[k] for k in below], parents, offset * scale)
    world = np.moveaxis(world, 0, 1)[:, : len(skeleton.joints)]
    pose = Pose(skeleton, moving[0, :, :3, 3] * scale, quaternion_canonical(local_rotation(skeleton, world)))
    rate = 1 / float(np.median(np.diff(time))) if len(time) > 1 else 30.0
    rate = round(rate) if abs(rate - round(rate)) < 1e-3 * rate else rate
    clip = Clip(str(path), from_t_posed(pose) if is_vrm else pose, float(rate))
    found = np.moveaxis(moving[:, :, :3, 3], 0, 1) * scale
    stretch = np.abs(np.asarray(forward_kinematics(pose)[0]) - found).max() > STRETCH
    turns = not stretch or bool(np.ptp(world, axis=0).max() > STRETCH)
    ours = {given: name for name, given in rig.joints.items()}
    whole = canonical(clip, ours, found if stretch else None, turns)
    return checked(replace(whole, name=path.stem), known=ours.values()), (*rig.made_up, *remarks)


def _names(file: GltfFile) -> tuple[list[str], bool]:
    """Return unique names of the nodes, in a VRM humanoid our names of its bones, and whether the file is VRM."""
    names = [str(node.get("name", f"node {k}")) for k, node in enumerate(file.nodes)]
    bones = _bones(file)
    if bones:
        names = [f"node {k}" for k in range(len(names))]
        for joint, node in bones.items():
            if 0 <= node < len(names):
                names[node] = joint
        return names, True
    taken: set[str] = set()
    for k, name in enumerate(names):
        names[k] = name if name not in taken else f"{name} {k}"
        taken.add(names[k])
    return names, False


def _bones(file: GltfFile) -> dict[str, int]:
    """Return the node of each of our joints, if the file names a humanoid's bones."""
    extensions = file.document.get("extensions")
    extensions = extensions if isinstance(extensions, dict) else {}
    ours = {bone: joint for joint, bone in VRM_BONES.items()}
    for name in ("VRMC_vrm_animation", "VRMC_vrm", "VRM"):
        try:
            bones: Any = extensions[name]["humanoid"]["humanBones"]
            if isinstance(bones, list):  # VRM 0: thumbs are named one joint further out
                found = {row["bone"]: int(row["node"]) for row in bones}
                if any(bone.endswith("ThumbIntermediate") for bone in found):
                    found = {
                        bone.replace("ThumbProximal", "ThumbMetacarpal").replace(
                            "ThumbIntermediate", "ThumbProximal"
                        ): k
                        for bone, k in found.items()
                    }
            else:
                found = {bone: int(row["node"]) for bone, row in bones.items()}
        except (KeyError, TypeError, ValueError, AttributeError):
            continue
        return {ours[bone]: node for bone, node in found.items() if bone in ours}
    return {}


def _recognised(file: GltfFile, figure: Figure, joints: Path | None) -> Rig:
    """Return the rig of the animated tree. Nodes scaled to zero have an error message of their own."""
    try:
        return recognise(figure, ReadingOptions(floor=0.0, joints=joints), format_up="y")
    except BodysenseError:
        _turns(file.path, _world(file, list(figure.nodes), {}, np.zeros(1)))
        raise


def figure_of_gltf(path: Path, animation: str | None = None) -> Figure:
    """Return the animated tree, its joints not yet recognised. Raises BodysenseError if nothing is animated."""
    file = open_gltf(path)
    names, tracks = _names(file)[0], _tracks(file, animation)
    return _figure(_with_loose_ends(file, names, tracks), names, tracks)


def _with_loose_ends(file: GltfFile, names: list[str], tracks: Mapping[tuple[int, str], Track]) -> GltfFile:
    """Return the file with feet and hands on their shins and forearms, where a rig for IK has them elsewhere.

    A foot belongs to the shin of its side if it keeps its distance from the knee.
    """
    found = {ours: names.index(given) for given, ours in joints_of(names).items()}
    time = next(iter(tracks.values())).times
    moved: dict[int, int] = {}
    for side in ("left", "right"):
        for bone, end in (("knee", "ankle"), ("elbow", "wrist")):
            other = found.get(f"{side}_foot") if end == "ankle" else None
            joint, loose = found.get(f"{side}_{bone}"), found.get(f"{side}_{end}", other)
            if joint is None or loose is None:
                continue
            if joint in chain_to_root(file.carriers, loose) or loose in chain_to_root(file.carriers, joint):
                continue
            at = _world(file, [joint, loose], tracks, time[:: max(1, len(time) // _LOOKED_AT)])[:, :, :3, 3]
            length = np.linalg.norm(at[0] - at[1], axis=-1)
            if np.ptp(length) < _CARRIED * np.median(length):
                moved[loose] = joint
    return replace(file, moved=moved) if moved else file


def _tracks(file: GltfFile, animation: str | None) -> Mapping[tuple[int, str], Track]:
    tracks = tracks_of(file, animation)
    if not tracks:
        raise BodysenseError(f"{file.path}: nothing in it is animated; export it with its animation")
    return tracks


def _figure(file: GltfFile, names: list[str], tracks: Mapping[tuple[int, str], Track]) -> Figure:
    """Return the animated tree in a few of its frames: joint positions only, without rotations."""
    tops = Counter(chain_to_root(file.carriers, node)[-1] for node, _ in tracks if 0 <= node < len(names))
    below = _below(file, tops.most_common(1)[0][0]) if tops else []
    time = _times(file.path, tracks, below)
    place = np.moveaxis(_world(file, below, tracks, time[:: max(1, len(time) // _LOOKED_AT)])[:, :, :3, 3], 0, 1)
    rest = _world(file, below, {}, np.zeros(1))[:, 0, :3, 3]
    parents = tuple(below.index(file.carriers[k]) if n else -1 for n, k in enumerate(below))
    # Positions are enough: each joint hangs on its parent without turning.
    turns = np.zeros((*place.shape[:2], 4))
    turns[..., 0] = 1
    offset, moving = (np.array(values) for values in (rest, place))
    offset[1:] -= rest[list(parents[1:])]
    moving[:, 1:] -= place[:, list(parents[1:])]
    return Figure(
        name=str(file.path),
        joints=tuple(names[k] for k in below),
        end_sites=(),
        parents=parents,
        offset=offset,
        rotation=turns,
        position={n: moving[:, n] for n in range(len(below))},
        frame_rate=30.0,
        nodes=tuple(below),
    )


def _below(file: GltfFile, root: int) -> list[int]:
    """Return a node and its descendants, parents before children."""
    inside = {root}
    for k in file.carried_order:
        if file.carriers[k] in inside:
            inside.add(k)
    return [k for k in file.carried_order if k in inside]


def _times(path: Path, tracks: Mapping[tuple[int, str], Track], below: list[int]) -> np.ndarray:
    """Return the times (T,) s of the body's densest track, at a constant rate."""
    own = [track for (node, _), track in tracks.items() if node in below]
    if not own:
        raise BodysenseError(f"{path}: its animation does not move the body; export the body's animation")
    times = max(own, key=lambda track: len(track.times)).times
    steps = np.diff(times)
    if not len(steps) or np.ptp(steps) < _STEADY * np.median(steps):
        return times
    rate = 1 / np.median(steps)
    return times[0] + np.arange(int((times[-1] - times[0]) * rate + 1e-6) + 1) / rate


def _world(file: GltfFile, below: list[int], tracks: Mapping[tuple[int, str], Track], time: np.ndarray) -> np.ndarray:
    """Return world matrices (N, T, 4, 4) of nodes given with parents first."""
    needed = set(below)
    for k in below:
        while (k := file.parents[k]) >= 0 and k not in needed:
            needed.add(k)
    matrices: dict[int, np.ndarray] = {-1: np.eye(4)[None]}
    for k in (k for k in file.order if k in needed):
        matrices[k] = matrices[file.parents[k]] @ _local(file, k, tracks, time)
    return np.stack([np.broadcast_to(matrices[k], (len(time), 4, 4)) for k in below])


def _local(file: GltfFile, k: int, tracks: Mapping[tuple[int, str], Track], time: np.ndarray) -> np.ndarray:
    """Return matrices (T or 1, 4, 4) of a node in its parent."""
    node = file.nodes[k]
    try:
        if "matrix" in node:
            return np.array(node["matrix"], dtype=float).reshape(1, 4, 4).transpose(0, 2, 1)
        own = {
            name: np.array(node.get(name, usual), dtype=float).reshape(1, len(usual))
            for name, usual in (("translation", [0, 0, 0]), ("rotation", [0, 0, 0, 1]), ("scale", [1, 1, 1]))
        }
    except (TypeError, ValueError):
        raise BodysenseError(f"{file.path}: node {k} has a damaged place; export it again") from None
    for name in own:
        if (k, name) in tracks:
            own[name] = sampled(tracks[k, name], time, turns=name == "rotation")
    turn = own["rotation"][:, [3, 0, 1, 2]]
    turn = turn / np.maximum(np.linalg.norm(turn, axis=-1, keepdims=True), 1e-12)
    frames = max(len(values) for values in own.values())
    matrix = np.zeros((frames, 4, 4))
    matrix[:, :3, :3] = quaternion_to_matrix(turn) * own["scale"][:, None, :]
    matrix[:, :3, 3], matrix[:, 3, 3] = own["translation"], 1.0
    return matrix


def _turns(path: Path, matrices: np.ndarray) -> np.ndarray:
    """Return rotations (N, T, 4) of matrices whose axes may be scaled."""
    axes = matrices[..., :3, :3]
    length = np.linalg.norm(axes, axis=-2, keepdims=True)
    if not (length > 1e-9).all() or not (np.linalg.det(axes) > 0).all():
        raise BodysenseError(f"{path}: a joint is scaled to nothing or mirrored; apply the scale before the export")
    return matrix_to_quaternion(axes / length)


def _scale(path: Path, place: np.ndarray) -> tuple[float, tuple[str, ...]]:
    """Return metres per unit, from the resting body (N, 3), and remarks on an unusual unit."""
    height = float(np.ptp(place[:, 1]))
    for unit, name in ((1.0, ""), (0.01, "centimetres"), (0.001, "millimetres")):
        if HEIGHTS[0] <= height * unit <= HEIGHTS[1]:
            return unit, (f"its unit is {name}, though glTF's are metres",) if name else ()
    if not height > 0:
        raise BodysenseError(f"{path}: its rest pose has no height; export it with its skeleton in a T-pose")
    return USUAL / height, (f"its body is {height:.3g} units tall: scaled to {USUAL} m (--height)",)


def _skeleton(path: Path, names: list[str], parents: tuple[int, ...], offset: np.ndarray) -> Skeleton:
    """Return a skeleton of all nodes as joints; if names and order are those of our points, end sites are separated."""
    ours = default_skeleton()
    joints = ours.joints if tuple(names) == ours.points else tuple(names)
    try:
        return Skeleton(joints, tuple(names[len(joints) :]), parents, offset)
    except BodysenseError as error:
        raise BodysenseError(f"{path}: {error}") from None
