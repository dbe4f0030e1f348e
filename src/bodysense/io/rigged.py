"""BVH files of any rig as clips in canonical form: parsed, recognised, in metres, +Y up, floor at 0.

A file's bodies are its human figures, with one root each or a shared one. Flat trees, in which all joints are children
of one root or are roots, are rebuilt as a body's tree, by name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.body.person import TALLEST
from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import read_bytes
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.io.checked import checked
from bodysense.io.clip import Clip, at_height
from bodysense.io.formats.bvh import figures_of
from bodysense.io.formats.bvh_text import open_bvh, parse_bvh
from bodysense.io.formats.fbx.motion import parse_fbx
from bodysense.io.mvnx import ENDING as MVNX
from bodysense.io.mvnx import parse_mvnx
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.io.rigs.canonical import CanonicalForm
from bodysense.io.rigs.figure import LONG, Figure, blocks_of, measured
from bodysense.io.rigs.halves import find_body
from bodysense.io.rigs.joint_file import JointFile
from bodysense.io.rigs.names import ARMS, LEGS, is_end, joints_of, parts, side_of
from bodysense.io.rigs.rig import USUAL_HEIGHT, Rig, joint_map, recognise

BONES = (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))


def rebuilt_flat_trees(figures: list[Figure], options: ReadingOptions) -> list[Figure]:
    """Return the figures of a file; a flat tree becomes a body with unchanged joint positions and rotations."""
    names = [name for figure in figures for name in figure.joints]
    given = joint_map(options.joints) if options.joints is not None else joints_of(names)
    ours = {of: name for name, of in given.items() if name in names}
    if not {"pelvis", *ARMS, *LEGS} <= ours.keys() or any(_contains_limb_bone(figure, ours) for figure in figures):
        return figures
    trunk = [
        name
        for name in names
        if parts(name) & {"spine", "neck"} and not side_of(name) and not is_end(name) and name not in given
    ]
    joints = _in_world(figures, [*ours.values(), *trunk])
    parents = _parents(ours, _upward(trunk, ours, joints))
    order = list(parents)
    rotation, position = [], {}
    for k, name in enumerate(order):
        place, turn, _ = joints[name]
        if (parent := parents[name]) is not None:
            above, turned, _ = joints[parent]
            back = quaternion_conjugate(turned)
            place, turn = quaternion_rotate(back, place - above), quaternion_multiply(back, turn)
        position[k] = place
        rotation.append(turn)
    body = Figure(
        name=figures[0].name,
        joints=tuple(order),
        end_sites=(),
        parents=tuple(-1 if parent is None else order.index(parent) for parent in parents.values()),
        offset=np.stack([np.median(position[k], axis=0) for k in range(len(order))]),
        rotation=np.stack(rotation, axis=1),
        position=position,
        frame_rate=figures[0].frame_rate,
        nodes=tuple(joints[name][2] for name in order),
    )
    return [body]


def _in_world(figures: list[Figure], names: list[str]) -> dict[str, tuple[np.ndarray, np.ndarray, int]]:
    """Return positions (T, 3) and rotations (T, 4) in the file's world, and the file's nodes, of joints by name."""
    found = {}
    for figure in figures:
        if own := [k for k, name in enumerate(figure.joints) if name in names]:
            place, turn = figure.world(own)
            found |= {figure.joints[k]: (place[:, n], turn[:, n], figure.nodes[k]) for n, k in enumerate(own)}
    return found


def _upward(trunk: list[str], ours: Mapping[str, str], joints: Mapping[str, tuple]) -> list[str]:
    """Return all joints between pelvis and head, including known ones, from bottom to top."""
    low, high = joints[ours["pelvis"]][0], (joints[ours["left_shoulder"]][0] + joints[ours["right_shoulder"]][0]) / 2
    up = high - low
    own = [ours[name] for name in ("spine1", "spine2", "spine3", "neck") if name in ours]
    return sorted([*own, *trunk], key=lambda name: float(np.median(((joints[name][0] - low) * up).sum(-1))))


def _parents(ours: Mapping[str, str], trunk: list[str]) -> dict[str, str | None]:
    """Return the parent of each joint, by name, parents first."""
    body = default_skeleton()
    parents: dict[str, str | None] = {ours["pelvis"]: None}
    below = ours["pelvis"]
    for name in trunk:
        parents[name], below = below, name
    chest = next((name for name in reversed(trunk) if "neck" not in parts(name)), ours["pelvis"])
    for name in (name for name in body.points if name in ours and ours[name] not in parents):
        above = body.parents[body.index(name)]
        while body.points[above] not in ours:
            above = body.parents[above]
        hangs_on = ours[body.points[above]]
        carried = name == "head" or "collar" in name or "shoulder" in name
        if carried and hangs_on in (*trunk, ours["pelvis"]):
            hangs_on = below if name == "head" else chest
        parents[ours[name]] = hangs_on
    return parents


def _contains_limb_bone(figure: Figure, ours: Mapping[str, str]) -> bool:
    """Whether a bone of a limb joins two joints of the figure."""
    index = {given: k for k, given in enumerate(figure.joints)}
    ends = [(ours[f"{side}_{a}"], ours[f"{side}_{b}"]) for side in ("left", "right") for a, b in BONES]
    return any(a in index and b in index and index[a] in figure.above(index[b]) for a, b in ends)


_FEWEST = 14  # joints of a body
_DEEPEST = 3  # joints above several bodies


def bodies_of(figures: list[Figure], options: ReadingOptions) -> list[Figure]:
    """Return the human figures. One alone is returned unchecked, so that recognising it reports the error."""
    figures = rebuilt_flat_trees(figures, options)
    if options.joints is not None and len(figures) == 1:
        return figures
    found = [body for figure in figures for body in _bodies_in(figure, _DEEPEST)]
    if len(found) == len(figures) == 1:
        return found
    bodies = [figure for figure in found if _is_body(figure)]
    return bodies or figures[:1]


def _bodies_in(figure: Figure, deepest: int) -> list[Figure]:
    """Return the bodies that share one root; the figure itself if it does not hold two."""
    branches = [k for k in figure.children[0] if sum(j < len(figure.joints) for j in figure.under(k)) >= _FEWEST]
    if len(branches) > 1:
        parts = [figure.below(child) for child in branches]
        bodies = [part for part in parts if _is_body(part)]
        if len(bodies) > 1:
            return [replace(body, name=figure.name) for body in bodies]
    if len(branches) == 1 and deepest and len(figure.children[0]) == 1:
        inner = _bodies_in(figure.below(branches[0]), deepest - 1)
        return inner if len(inner) > 1 else [figure]
    return [figure]


def _is_body(figure: Figure) -> bool:
    try:
        find_body(measured(figure))
    except BodysenseError:
        return False
    return True


MOST_POINTS = 400  # points of a figure that are all kept; a larger one keeps only those between a body's
PELVIS = "pelvis, made of the hips"
OVER_HIPS = 0.1  # of a leg's length: height of an added pelvis over the hips
STRETCH = 1e-4  # m: bones that vary by less are rigid
SMALLEST = 0.4  # m: smallest body that a stated unit may give; the largest is that of a person


@dataclass(frozen=True, eq=False)
class Rigged:
    """A body of a BVH or FBX file: the file's content, the recognised rig, and the motion in canonical form."""

    file: JointFile
    figure: Figure  # of the body chosen, in file units
    rig: Rig
    clip: Clip
    is_mirrored: bool = False  # it was read as left-handed


FBX = ".fbx"


def open_joint_file(path: Path, options: ReadingOptions = AS_FOUND) -> JointFile:
    """Read a BVH or FBX file, whose values may be missing. Raises BodysenseError for anything else."""
    return _parsed(read_bytes(path), path, options) if path.suffix.lower() == FBX else open_bvh(path)


def _parsed(data: bytes, path: Path, options: ReadingOptions) -> JointFile:
    """Return the content of a BVH, FBX or MVNX file, whose values are all finite."""
    if path.suffix.lower() == MVNX:
        return parse_mvnx(data, path)
    if path.suffix.lower() != FBX:
        return parse_bvh(data, path)
    return parse_fbx(data, path, options.animation, options.skin)


def read_rigged(data: bytes, path: Path, options: ReadingOptions = AS_FOUND, *, must_stand: bool = False) -> Rigged:
    """Read the bytes of a BVH or FBX file; `path` names it. `must_stand` refuses a body that stands in no frame.

    Raises BodysenseError, naming the file and the fix, if it holds no body, or several without a choice.
    """
    file = _parsed(data, path, options)
    del data  # as large as its numbers
    return rigged_of(file, options, must_stand=must_stand)


def rigged_of(file: JointFile, options: ReadingOptions = AS_FOUND, *, must_stand: bool = False) -> Rigged:
    """Recognise the body of a file. `must_stand` refuses a body that stands in no frame.

    Raises BodysenseError, naming the file and the fix, if it holds no body, or several without a choice.
    """
    if must_stand and options.floor is None:  # a published set has its floor
        options = replace(options, floor=0.0)
    figure = _chosen(file, options)
    rig = _recognised(file, figure, options)
    clip = _canonical_clip(figure, rig, options.joints is not None, must_stand)
    clip = checked(clip, (*file.warnings, *rig.warnings), rig.joints.keys(), options)
    height = options.height if options.height is not None or rig.unit_name else USUAL_HEIGHT
    if height is None:
        rig = replace(rig, height=clip.pose.skeleton.height)
    else:
        scale = height / clip.pose.skeleton.height
        rig = replace(rig, unit=rig.unit * scale, lift=rig.lift * scale, height=height)
        clip = at_height(clip, height)
    return Rigged(file, figure, rig, clip, options.left_handed)


def figure_of_file(data: bytes, path: Path, options: ReadingOptions = AS_FOUND) -> Figure:
    """Return the figure that is read from a file's bytes, recognised or not. Raises as `read_rigged`."""
    return _chosen(_parsed(data, path, options), options)


def _recognised(file: JointFile, figure: Figure, options: ReadingOptions) -> Rig:
    """Recognise a figure; the file's unit and upward axis hold unless options give others, or no person fits them."""
    format_up = file.up if options.up is None else None
    if options.unit is not None or file.unit is None:
        return recognise(figure, options, format_up)
    rig = recognise(figure, replace(options, unit=file.unit), format_up)
    if options.height is not None or SMALLEST <= rig.height <= TALLEST:
        return rig
    found = recognise(figure, options, format_up)
    stated = f"not units of {rig.unit:g} m, as the file says, in which it is {rig.height:.3g} m tall"
    return replace(found, notes=(*found.notes, stated))


def _chosen(file: JointFile, options: ReadingOptions) -> Figure:
    """Return the body that the options choose."""
    figures = figures_of(file)
    if options.left_handed:
        figures = [figure.mirrored() for figure in figures]
    path, figures = file.path, bodies_of(figures, options)
    names = ", ".join(f"{rank} ({figure.joints[0]})" for rank, figure in enumerate(figures, start=1))
    if options.figure is None and len(figures) > 1:
        raise BodysenseError(f"{path}: {len(figures)} bodies in it: {names}; choose one with --figure 1")
    if options.figure is not None and options.figure > len(figures):
        raise BodysenseError(f"{path}: --figure {options.figure}: there is no such body; there are {names}")
    return figures[(options.figure or 1) - 1]


def _canonical_clip(figure: Figure, rig: Rig, by_table: bool, must_stand: bool) -> Clip:
    """Return the motion of a figure in canonical form; its joints are recognised, or those of a table."""
    sites = [
        given for ours, given in rig.joints.items() if given in figure.end_sites and ours in default_skeleton().joints
    ]
    figure = _of_body(figure.with_joints(sites) if sites else figure, rig)
    try:
        skeleton = Skeleton(figure.joints, figure.end_sites, figure.parents, figure.bone * rig.unit)
    except BodysenseError as error:
        raise BodysenseError(f"{figure.name}: {error}") from None
    stretches = any(np.ptp(place, axis=0).max() * rig.unit > STRETCH for k, place in figure.position.items() if k)
    joints = {given: ours for ours, given in rig.joints.items()}
    if "pelvis" not in rig.joints:
        joints[PELVIS] = "pelvis"
    lacking = () if by_table else {"head_top"} - rig.joints.keys()  # its end site may be in front of the head

    def clip_in(frames: slice | np.ndarray) -> tuple[Clip, np.ndarray | None]:
        source, place = _figure_clip(figure.frames(frames), skeleton, rig, stretches)
        return (source, place) if "pelvis" in rig.joints else _with_pelvis(source, place, rig)

    turns, count = not stretches or figure.turns, len(figure)
    is_long = count > LONG and turns
    source, place = clip_in(np.unique(np.linspace(0, count - 1, LONG).astype(int)) if is_long else slice(None))
    form, clip = CanonicalForm.of(source, joints, place, turns, must_stand, lacking)
    clip = replace(clip, name=Path(figure.name).stem)
    if not is_long:
        return clip
    root, rotation = np.empty((count, 3)), np.empty((count, len(form.skeleton.joints), 4))
    for block in blocks_of(count):
        pose = form.apply(*clip_in(block)).pose
        root[block], rotation[block] = pose.root_position, pose.rotation
    return replace(clip, pose=Pose(form.skeleton, root, rotation))


def _of_body(figure: Figure, rig: Rig) -> Figure:
    """Return the figure below the joint that carries all recognised joints; large figures keep only these."""
    index = {name: point for point, name in enumerate(figure.points)}
    needed = Counter(above for given in rig.joints.values() for above in figure.above(index[given]))
    shared = [point for point, count in needed.items() if count == len(rig.joints)]
    root = max(shared, key=lambda point: len(figure.above(point)))
    if len(figure.points) <= MOST_POINTS:
        return figure if root == 0 else figure.below(root)
    inside = [point for point in sorted(needed) if root in figure.above(point)]
    return figure.only(inside)


def _figure_clip(figure: Figure, skeleton: Skeleton, rig: Rig, stretches: bool) -> tuple[Clip, np.ndarray | None]:
    """Return a figure as a clip in our world, and its points (T, P, 3) m if it stretches."""
    root = figure.position.get(0, np.tile(figure.offset[0], (len(figure), 1)))
    rotation = np.array(figure.rotation)
    rotation[:, 0] = quaternion_canonical(rig.turned_to_world(rotation[:, 0]))
    clip = Clip(figure.name, Pose(skeleton, rig.to_world(root), rotation), figure.frame_rate)
    return clip, rig.to_world(figure.world()[0]) if stretches else None


def _with_pelvis(clip: Clip, place: np.ndarray | None, rig: Rig) -> tuple[Clip, np.ndarray | None]:
    """Add a pelvis over the hips of a clip whose legs hang on the middle of its trunk, which becomes its child."""
    skeleton, pose = clip.pose.skeleton, clip.pose
    if skeleton.joints[0] != rig.hub:
        raise BodysenseError(f"{clip.name}: no joint is its pelvis; name it in a file, --joints")
    rest = skeleton.path @ skeleton.rest_offset
    left, right = (rest[skeleton.index(rig.joints[f"{side}_hip"])] for side in ("left", "right"))
    leg = np.linalg.norm(rest[skeleton.index(rig.joints["left_ankle"])] - left)
    down = (left + right) / 2
    down = down * max(0.0, 1 - OVER_HIPS * leg / max(float(np.linalg.norm(down)), 1e-9))
    offset = np.concatenate([skeleton.rest_offset[:1] * 0, -down[None], skeleton.rest_offset[1:]])
    parents = (-1, 0, *(parent + 1 for parent in skeleton.parents[1:]))
    body = Skeleton((PELVIS, *skeleton.joints), skeleton.end_sites, parents, offset)
    root = pose.root_position + quaternion_rotate(pose.rotation[:, 0], down)
    still = np.zeros_like(pose.rotation[:, :1])
    still[..., 0] = 1
    rotation = np.concatenate([pose.rotation[:, :1], still, pose.rotation[:, 1:]], axis=1)
    whole = replace(clip, pose=Pose(body, root, rotation))
    return whole, None if place is None else np.concatenate([root[:, None], place], axis=1)
