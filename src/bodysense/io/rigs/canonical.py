"""The canonical form: any humanoid motion on our 52 joints and 13 end sites, with its own proportions.

The form is that of `default_skeleton()`: same names, same tree, and a rest pose (all rotations the identity) that is
a T-pose facing +Z. What changes is only the meaning of the rotations; in the world the body stays where it was.

How a source's rest pose is found and aligned with ours: `io.rigs.rest_pose`.

Skipped joints. Joints that we lack (LowerBack, twist bones, a fourth spine joint) are left out. If they do not move,
all matched joints keep their world positions to rounding. If they do, a joint with one child is turned each frame so
that it points at it, which leaves the bone's change of length. The pelvis has several children: what a LowerBack bends
there, spine1 takes over, so that the upper body returns to its place except for the change of length (Rocketbox: 2 mm
on average instead of 12, 2 cm where LowerBack bends by 24°). World rotations of all other joints are kept exactly.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, local_rotation, rest_pose
from bodysense.body.skeleton import FINGERS, Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
    shortest_arc,
)
from bodysense.io.clip import Clip, parts_lacking
from bodysense.io.fingers import is_finger, relaxed_fingers, relaxed_rotation
from bodysense.io.rigs.rest_pose import (
    UPRIGHT,
    Vectors,
    across_of,
    alignment,
    by_name,
    standing_rest,
    twisted_by_hinges,
)

_SPINE = ("spine1", "spine2")
_HANGING = {"left": np.deg2rad(-75.0), "right": np.deg2rad(75.0)}  # about +Z: arms from a T-pose
SITTING = 0.75  # of a standing pelvis's height; below it, missing legs are posed as sitting
_SEATED = quaternion_exp(np.array([np.deg2rad(-85.0), 0.0, 0.0]))  # thighs, from standing
_RIGID = 1e-6  # m: a bone that keeps its place in its parent's frame to this is rigid


def canonical(
    clip: Clip,
    joints: Mapping[str, str],
    place: np.ndarray | None = None,
    turns: bool = True,
    must_stand: bool = False,
) -> Clip:
    """Return the clip on the joints and end sites of `default_skeleton()`, with the clip's own proportions.

    Missing joints are the default skeleton's, scaled, and do not turn (fingers: relaxed). See the module's text for
    what is kept exactly.

    Args:
        clip: the source, in metres, +Y up.
        joints: {name in the clip: ours}.
        place: (T, P, 3) m, positions of its points if its bones stretch, so that kinematics do not give them.
        turns: whether joints turn; otherwise rotations follow from positions.
        must_stand: refuse a clip whose rest pose is not a standing body and that stands in no frame.

    Raises BodysenseError if joints are unknown or have no pelvis.
    """
    return CanonicalForm.of(clip, joints, place, turns, must_stand, ())[1]


@dataclass(frozen=True, eq=False)
class CanonicalForm:
    """How the joints of a source become ours, found in some of its frames; `apply` is for any frames."""

    match: Mapping[str, int]  # our point → the source's
    parents: Mapping[str, str]  # of matched points
    bone: Vectors  # to matched points, in the frame of their parents
    align: Vectors | None  # (4,) from the source's joints to ours at rest; None: joints do not turn
    rest: Vectors  # (4,) world rotations of the source's joints in its rest pose
    skeleton: Skeleton
    sits: bool  # legs that are missing sit
    fingers: tuple[str, ...]  # finger joints that are relaxed
    has_fingers: bool

    @staticmethod
    def of(
        clip: Clip,
        joints: Mapping[str, str],
        place: np.ndarray | None,
        turns: bool,
        must_stand: bool,
        lacking: Collection[str],
    ) -> tuple[CanonicalForm, Clip]:
        """Return the form of a clip, and the clip in it; arguments as of `canonical`.

        `lacking` are our end sites that the clip lacks; others are those that hang on the joint.
        """
        ours, source = default_skeleton(), clip.pose.skeleton
        for name in joints.values():
            ours.index(name)  # raises for a name that is not ours
        match = _match_points(source, joints, lacking)
        if "pelvis" not in match:
            raise BodysenseError(f"{clip.name}: no joint is its pelvis, which carries the legs and the trunk")
        parents = _matched_parents(ours, match)
        position, rotation = forward_kinematics(clip.pose)
        places = by_name(position if place is None else place, match)
        align, rest, bone = None, Vectors(), Vectors()
        if turns:
            align, rest, bone = _aligned(clip, match, parents, must_stand, position, rotation)
        form = CanonicalForm(match, parents, bone, align, rest, ours, False, (), False)
        if place is not None:
            world = form.world(rotation, places)
            for name, parent in parents.items():  # a bone that stretches has its usual place in its parent
                bones = quaternion_rotate(quaternion_conjugate(world[parent]), places[name] - places[parent])
                bone[name] = np.median(bones, axis=0)
        skeleton = complete_skeleton(_shared_offsets(ours, bone, parents))
        sits = bool(np.median(places["pelvis"][:, 1]) < SITTING * skeleton.rest_offset[0, 1])
        form = replace(form, skeleton=skeleton, sits=sits)
        pose = form.pose(position if place is None else place, rotation)
        made_up = [name for name in ours.joints if is_finger(name) and name not in match]
        relaxed, has_fingers = relaxed_fingers(pose, made_up)
        form = replace(form, fingers=relaxed, has_fingers=has_fingers)
        return form, form._with_pose(clip, pose)

    def apply(self, clip: Clip, place: np.ndarray | None = None) -> Clip:
        """Return frames of the source on our skeleton; `place` (T, P, 3) m as of `canonical`."""
        position, rotation = forward_kinematics(clip.pose)
        return self._with_pose(clip, self.pose(position if place is None else place, rotation))

    def _with_pose(self, clip: Clip, pose: Pose) -> Clip:
        for joint in self.fingers:
            pose.rotation[:, pose.skeleton.index(joint)] = relaxed_rotation(joint)
        lacks = parts_lacking([name for name in self.match if name in self.skeleton.joints])
        return replace(clip, pose=pose, has_fingers=self.has_fingers, lacks=lacks)

    def world(self, rotation: np.ndarray, places: Vectors) -> Vectors:
        """Return world rotations (T, 4) of matched joints, from those of the source's (T, J, 4) or from places."""
        if self.align is None:
            aligned = alignment(places, self.parents, exactly=True)
            return {name: quaternion_conjugate(turn) for name, turn in aligned.items()}
        return _turned(self.align, self.rest, rotation, self.match)

    def pose(self, place: np.ndarray, rotation: np.ndarray) -> Pose:
        """Return the pose on our skeleton of points (T, P, 3) m and world rotations (T, J, 4) of the source."""
        places = by_name(place, self.match)
        world = _aim_at_children(self.world(rotation, places), places, self.bone, self.parents)
        world |= _missing_limbs(world, self.skeleton, self.sits)
        for joint, name in enumerate(self.skeleton.joints):
            if name not in world:  # missing joints go with their parent
                world[name] = world[self.skeleton.joints[self.skeleton.parents[joint]]]
        local = local_rotation(self.skeleton, np.stack([world[name] for name in self.skeleton.joints], axis=-2))
        return Pose(self.skeleton, places["pelvis"], quaternion_canonical(local))


def _turned(align: Vectors, rest: Vectors, rotation: np.ndarray, match: Mapping[str, int]) -> Vectors:
    """Return world rotations (T, 4) of joints with some alignments, from those of the source (T, J, 4)."""
    at_rest = quaternion_multiply(np.stack(list(align.values())), np.stack([rest[name] for name in align]))
    turned = quaternion_multiply(rotation[:, [match[name] for name in align]], quaternion_conjugate(at_rest))
    return {name: turned[:, place] for place, name in enumerate(align)}


def _aligned(
    clip: Clip,
    match: Mapping[str, int],
    parents: Mapping[str, str],
    must_stand: bool,
    position: np.ndarray,
    rotation: np.ndarray,
) -> tuple[Vectors, Vectors, Vectors]:
    """Return the alignments (4,) of joints, their world rotations (4,) at rest, and the bones (3,) to matched points.

    `position` (T, P, 3) and `rotation` (T, J, 4) are the clip's in the world.
    """
    stance = standing_rest(clip, match)
    if must_stand and stance.torso > UPRIGHT:
        raise BodysenseError(
            f"{clip.name}: its rest pose does not stand, and in no frame is its torso upright (at "
            f"best {np.rad2deg(stance.torso):.0f}° from it); leave it out"
        )
    standing = rest_pose(clip.pose.skeleton) if stance.rest is None else _facing_forward(stance.rest, match)
    rest_position, rest_rotation = forward_kinematics(standing)
    rest = by_name(rest_position, match)
    align = alignment(rest, parents)
    turns = {name: rest_rotation[match[name]] for name in align}
    if stance.rest is not None and not must_stand:
        align = twisted_by_hinges(align, by_name(position, match), _turned(align, turns, rotation, match))
    bone = {name: quaternion_rotate(align[parent], rest[name] - rest[parent]) for name, parent in parents.items()}
    return align, turns, bone


def _missing_limbs(world: Vectors, skeleton: Skeleton, sits: bool) -> Vectors:
    """Return world rotations of missing limbs: legs stand, or sit, and arms hang."""
    if "left_hip" not in world:
        across = quaternion_rotate(world["pelvis"], np.array([1.0, 0.0, 0.0]))
        heading = np.zeros_like(across)
        heading[:, 1] = np.arctan2(-across[:, 2], across[:, 0])
        shin = thigh = quaternion_exp(heading)
        if sits:
            thigh = quaternion_multiply(shin, np.tile(_SEATED, (len(shin), 1)))
        return {f"{side}_{part}": turn for side in _HANGING for part, turn in (("hip", thigh), ("knee", shin))}
    if "left_shoulder" not in world:
        chest = next(world[name] for name in ("spine3", "spine2", "spine1", "pelvis") if name in world)
        turns = {side: quaternion_exp(np.array([0.0, 0.0, angle])) for side, angle in _HANGING.items()}
        return {
            f"{side}_shoulder": quaternion_multiply(chest, np.tile(turn, (len(chest), 1)))
            for side, turn in turns.items()
        }
    return {}


def _aim_at_children(world: Vectors, place: Vectors, bone: Vectors, parents: Mapping[str, str]) -> Vectors:
    """Return world rotations with joints turned toward their only child, if skipped joints moved it (see above)."""
    world, reached = dict(world), {"pelvis": place["pelvis"]}
    for name, parent in parents.items():
        start = reached[parent] if parent in _SPINE else place[parent]
        rigid = quaternion_rotate(world[parent], bone[name])
        target = place[name] - start
        if list(parents.values()).count(parent) == 1 and np.abs(target - rigid).max() > _RIGID:
            world[parent] = quaternion_multiply(shortest_arc(rigid, target), world[parent])
            rigid = quaternion_rotate(world[parent], bone[name])
        reached[name] = reached[parent] + rigid
    return world


def complete_skeleton(offset: Mapping[str, np.ndarray], root_offset: np.ndarray | None = None) -> Skeleton:
    """Return the default skeleton with some offsets (3,) replaced, by name of the point, and the others scaled to fit.

    A hand is scaled by the given length from wrist to knuckle (`left_middle1`), if there is one; all else by the sum of
    the given lengths. `root_offset` is the pelvis at rest; None: feet on the ground.
    """
    ours = default_skeleton()
    points = dict(zip(ours.points, ours.rest_offset, strict=True))
    lengths = [(np.linalg.norm(vector), np.linalg.norm(points[name])) for name, vector in offset.items()]
    ratio = float(sum(a for a, _ in lengths) / sum(b for _, b in lengths)) if lengths else 1.0

    def scale(name: str) -> float:
        side, _, part = name.partition("_")
        if part.rstrip("123").removesuffix("_tip") in FINGERS:
            knuckle = f"{side}_middle1"
            if knuckle in offset:
                return float(np.linalg.norm(offset[knuckle]) / np.linalg.norm(points[knuckle]))
        return ratio

    table = [offset[name] if name in offset else points[name] * scale(name) for name in ours.points]
    skeleton = ours.with_offsets(np.array([np.zeros(3), *table[1:]]))
    if root_offset is None:
        lowest, default_lowest = ((ours.path @ body.rest_offset)[:, 1].min() for body in (skeleton, ours))
        above_ground = ours.rest_offset[0, 1] + default_lowest  # the lowest point lies in the foot, not under it
        root_offset = np.array([0.0, ratio * above_ground - lowest, 0.0])
    return skeleton.with_offsets(np.array([root_offset, *table[1:]]))


def _match_points(source: Skeleton, joints: Mapping[str, str], lacking: Collection[str]) -> dict[str, int]:
    """Return the index in `source` of each of our points: matched joints and their end sites."""
    ours = default_skeleton()
    match = {name: source.index(given) for given, name in joints.items()}
    for site in ours.end_sites:
        parent = ours.joints[ours.parents[ours.index(site)]]
        if site not in match and site not in lacking and parent in match:
            hanging = [k for k in range(len(source.joints), len(source.points)) if source.parents[k] == match[parent]]
            if hanging:
                match[site] = hanging[0]
    return {name: match[name] for name in ours.points if name in match}


def _matched_parents(ours: Skeleton, match: Mapping[str, int]) -> dict[str, str]:
    """Return the nearest matched ancestor in our tree of each matched point but the root."""
    parents = {}
    for name in match:
        above = ours.parents[ours.index(name)]
        while above >= 0 and ours.joints[above] not in match:
            above = ours.parents[above]
        if above >= 0:
            parents[name] = ours.joints[above]
    return parents


def _facing_forward(pose: Pose, match: Mapping[str, int]) -> Pose:
    """Turn one pose about +Y so that its left hip (or shoulder) is toward +X of its right."""
    across = across_of(by_name(forward_kinematics(pose)[0], match))
    angle = np.arctan2(across[2], across[0])
    rotation = pose.rotation.copy()
    rotation[0] = quaternion_multiply(quaternion_exp(np.array([0.0, angle, 0.0])), rotation[0])
    return Pose(pose.skeleton, pose.root_position, rotation)


def _shared_offsets(ours: Skeleton, bone: Vectors, parents: Mapping[str, str]) -> Vectors:
    """Return offsets from our parents: a bone over joints that the source lacks is divided among them.

    The default's chain over those joints is turned and scaled so that it spans the source's bone.
    """
    offset: Vectors = {}
    for name, vector in bone.items():
        chain = [name]
        while (above := ours.joints[ours.parents[ours.index(chain[-1])]]) != parents[name]:
            chain.append(above)
        if len(chain) == 1:
            offset[name] = vector
            continue
        default = {link: ours.rest_offset[ours.index(link)] for link in chain}
        whole = np.sum(list(default.values()), axis=0)
        turn, scale = shortest_arc(whole, vector), np.linalg.norm(vector) / np.linalg.norm(whole)
        for link in chain:
            offset.setdefault(link, scale * quaternion_rotate(turn, default[link]))
        offset[name] = vector - np.sum([offset[link] for link in chain[1:]], axis=0)
    return offset
