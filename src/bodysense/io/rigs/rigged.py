"""BVH files of any rig as clips in canonical form: parsed, recognised, brought to metres, +Y up and a floor at 0."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.rotation import quaternion_canonical, quaternion_rotate
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.augment import at_height
from bodysense.io.bvh_text import BvhFile, parse_bvh
from bodysense.io.clip import Clip
from bodysense.io.rigs.bodies import bodies_of
from bodysense.io.rigs.canonical import canonical
from bodysense.io.rigs.figure import Figure
from bodysense.io.rigs.options import AS_FOUND, ReadingOptions
from bodysense.io.rigs.rig import Rig, recognise
from bodysense.io.rigs.stance import UPRIGHT, standing_rest

MOST_POINTS = 400  # of a figure, that are all kept; of a larger one only those that lie between a body's
PELVIS = "pelvis, made of the hips"
OVER_HIPS = 0.1  # of a leg's length: how far a made pelvis is over the hips
STRETCH = 1e-4  # m: bones that vary by less are rigid


@dataclass(frozen=True, eq=False)
class Rigged:
    """A body of a BVH file: what the file says, what was recognised of it, and its motion in canonical form."""

    file: BvhFile
    figure: Figure  # of the body chosen, in file units
    rig: Rig
    clip: Clip


def read_rigged(data: bytes, path: Path, options: ReadingOptions = AS_FOUND, *, must_stand: bool = False) -> Rigged:
    """Read a BVH file's bytes; `path` names it. `must_stand` refuses one whose rest pose and motion stand in no frame.

    Raises BodysenseError, naming the file and the fix, where it holds no body, or several and none was chosen.
    """
    file = parse_bvh(data, path)
    if must_stand and options.floor is None:  # a published set has its floor
        options = replace(options, floor=0.0)
    figure = _chosen(file, options)
    rig = recognise(figure, options)
    clip = _clip(figure, rig, must_stand)
    if options.height is not None:
        scale = options.height / clip.pose.skeleton.height
        rig = replace(rig, unit=rig.unit * scale, lift=rig.lift * scale, height=options.height)
        clip = at_height(clip, options.height)
    return Rigged(file, figure, rig, clip)


def figure_of_file(data: bytes, path: Path, options: ReadingOptions = AS_FOUND) -> Figure:
    """The figure of a BVH file's bytes that is read, whether or not it is recognised. Raises as `read_rigged`."""
    return _chosen(parse_bvh(data, path), options)


def _chosen(file: BvhFile, options: ReadingOptions) -> Figure:
    """The body that the options choose."""
    path, figures = file.path, bodies_of([file.figure(root) for root in file.roots], options)
    names = ", ".join(f"{rank} ({figure.joints[0]})" for rank, figure in enumerate(figures, start=1))
    if options.figure is None and len(figures) > 1:
        raise BodysenseError(f"{path}: {len(figures)} bodies in it: {names}; choose one with --figure 1")
    if options.figure is not None and options.figure > len(figures):
        raise BodysenseError(f"{path}: --figure {options.figure}: there is no such body; there are {names}")
    return figures[(options.figure or 1) - 1]


def _clip(figure: Figure, rig: Rig, must_stand: bool) -> Clip:
    """The motion of a recognised figure in canonical form."""
    sites = [
        given for ours, given in rig.joints.items() if given in figure.end_sites and ours in default_skeleton().joints
    ]
    figure = _of_body(figure.with_joints(sites) if sites else figure, rig)
    source, place = _placed(figure, rig)
    joints = {given: ours for ours, given in rig.joints.items()}
    if "pelvis" not in rig.joints:
        source, place = _with_pelvis(source, place, rig)
        joints[PELVIS] = "pelvis"
    stance = standing_rest(source, joints)
    if must_stand and stance.torso > UPRIGHT:
        raise BodysenseError(
            f"{figure.name}: its rest pose is none that a body stands in, and in no frame is its torso upright (at "
            f"best {np.rad2deg(stance.torso):.0f}° from it); leave it out"
        )
    hinges = stance.rest is not None and not must_stand
    turns = place is None or figure.turns
    clip = canonical(source, joints, rest=stance.rest, place=place, hinges=hinges, turns=turns)
    return replace(clip, name=Path(figure.name).stem)


def _of_body(figure: Figure, rig: Rig) -> Figure:
    """The figure below the joint that carries all that was recognised, without what does not matter."""
    index = {name: point for point, name in enumerate(figure.points)}
    needed = Counter(above for given in rig.joints.values() for above in figure.above(index[given]))
    shared = [point for point, count in needed.items() if count == len(rig.joints)]
    root = max(shared, key=lambda point: len(figure.above(point)))
    if len(figure.points) <= MOST_POINTS:
        return figure if root == 0 else figure.below(root)
    inside = [point for point in sorted(needed) if root in figure.above(point)]
    return figure.only(inside)


def _placed(figure: Figure, rig: Rig) -> tuple[Clip, np.ndarray | None]:
    """A figure as a clip in our world, and where its points are (T, P, 3) m if its bones are not rigid."""
    try:
        skeleton = Skeleton(figure.joints, figure.end_sites, figure.parents, figure.bone * rig.unit)
    except BodysenseError as error:
        raise BodysenseError(f"{figure.name}: {error}") from None
    root = figure.position.get(0, np.tile(figure.offset[0], (len(figure), 1)))
    rotation = figure.rotation.copy()
    rotation[:, 0] = quaternion_canonical(rig.turned_to_world(rotation[:, 0]))
    clip = Clip(figure.name, Pose(skeleton, rig.to_world(root), rotation), figure.frame_rate)
    moving = [k for k, place in figure.position.items() if k and np.ptp(place, axis=0).max() * rig.unit > STRETCH]
    return clip, rig.to_world(figure.world()[0]) if moving else None


def _with_pelvis(clip: Clip, place: np.ndarray | None, rig: Rig) -> tuple[Clip, np.ndarray | None]:
    """A clip whose legs hang on the middle of its trunk, with a pelvis over the hips, which carries that as a joint."""
    skeleton, pose = clip.pose.skeleton, clip.pose
    if skeleton.joints[0] != rig.hub:
        raise BodysenseError(f"{clip.name}: no joint is its pelvis; say which in a file, --joints")
    rest = skeleton.path @ skeleton.rest_offset
    left, right = (rest[skeleton.index(rig.joints[f"{side}_hip"])] for side in ("left", "right"))
    leg = np.linalg.norm(rest[skeleton.index(rig.joints["left_ankle"])] - left)
    down = (left + right) / 2
    down = down * max(0.0, 1 - OVER_HIPS * leg / max(float(np.linalg.norm(down)), 1e-9))
    offset = np.concatenate([skeleton.rest_offset[:1] * 0, -down[None], skeleton.rest_offset[1:]])
    parents = (-1, 0, *(parent + 1 for parent in skeleton.parents[1:]))
    body = Skeleton((PELVIS, *skeleton.joints), skeleton.end_sites, parents, offset)
    moved = pose.root_position + quaternion_rotate(pose.rotation[:, 0], down)
    still = np.zeros_like(pose.rotation[:, :1])
    still[..., 0] = 1
    rotation = np.concatenate([pose.rotation[:, :1], still, pose.rotation[:, 1:]], axis=1)
    whole = replace(clip, pose=Pose(body, moved, rotation))
    return whole, None if place is None else np.concatenate([moved[:, None], place], axis=1)
