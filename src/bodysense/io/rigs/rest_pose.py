"""Rest pose: the pose in which a source stands, and the rotations from its rest bones to ours.

Standing. A file's own rest pose is used if it is a standing body. Otherwise (Talking With Hands 16.2M holds every
bone in a frame of the rig's own, LaFAN1 has all bones along one axis), the frame closest to a T-pose, or to standing
with hanging arms, replaces it. The result is as accurate as the person stands straight there.

Alignment. From the root outward, each joint of ours is given one constant rotation, which takes the source's rest
bones to ours. It is its parent's unless the bone to its child then points away from the default skeleton's by more than
`LIMB_TOLERANCE` (arms, legs, fingers) or `OTHER_TOLERANCE` (elsewhere, where bodies differ in shape); then the shortest
arc onto the default's direction is added. Pelvis, chest and wrist have several children and are aligned with two
directions (left to right and up; along the hand and across it). So a skeleton that already stands in a T-pose keeps its
own bone directions, and its rotations pass through unchanged.

Twist. A frame of the motion defines the directions of bones, but not their twist. An elbow or a knee turns about one
axis, which its motion reveals. In our T-pose elbows bend about the vertical axis and knees about the transverse one;
the turn about the bone that brings the axis found there is the missing twist.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import (
    angle_between,
    geodesic_angle,
    matrix_to_quaternion,
    normalize,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
    shortest_arc,
)
from bodysense.io.clip import Clip

LIMB_TOLERANCE = np.deg2rad(15.0)
OTHER_TOLERANCE = np.deg2rad(45.0)
_LIMBS = ("hip", "knee", "shoulder", "elbow", "wrist", "index", "middle", "ring", "pinky")

Vectors = dict[str, np.ndarray]  # points of ours by name: positions, offsets (..., 3) m, or rotations (..., 4)

CANDIDATES = 2000  # frames that are examined, evenly spaced
UPRIGHT = np.deg2rad(30.0)  # rad; if the best frame's torso leans more than this, the body never stands
HANGING = np.deg2rad(10.0)  # rad by which hanging arms must be closer than a T-pose to be preferred
_EYES = ("b_l_eye", "b_r_eye")  # of the rigs of Meta's data sets; eyes define the direction of a head
_UP = np.array([0.0, 1.0, 0.0])
_LEG = (("hip", "knee"), ("knee", "ankle"))

LEAST_BEND = np.deg2rad(15.0)  # a joint that never bends more reveals no axis
_LEAST_AGREEMENT = 0.5  # mean resultant of the axes found: below it they do not agree

# Limb, its joints, and the axis about which the second bends in the T-pose.
_HINGES = [
    ((f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist"), (0.0, -sign, 0.0))
    for side, sign in (("left", 1), ("right", -1))
] + [((f"{side}_hip", f"{side}_knee", f"{side}_ankle"), (1.0, 0.0, 0.0)) for side in ("left", "right")]


@dataclass(frozen=True, eq=False)
class Stance:
    """A frame of a motion as a rest pose."""

    rest: Pose | None  # no batch axes; None if the file's own rest pose is a standing body
    torso: float  # radians from upright


def standing_rest(clip: Clip, match: Mapping[str, int]) -> Stance:
    """Return the rest pose of a clip whose points are ours by `match`, {ours: index}.

    If it is a frame, its head is turned straight if the rig has eyes.
    """
    skeleton = clip.pose.skeleton
    index = {**match, **{name: skeleton.index(name) for name in _EYES if name in skeleton.joints}}
    if _stands(_places(rest_pose(skeleton), index)):
        return Stance(None, 0.0)
    frames = np.arange(0, len(clip), max(1, len(clip) // CANDIDATES))
    place = _places(clip.pose[frames], index)
    best = int(np.argmin(_crookedness(place)))
    torso = float(angle_between(place["neck"][best] - place["pelvis"][best], _UP))
    return Stance(_looking_ahead(clip.pose[int(frames[best])], index), torso)


def _places(pose: Pose, index: Mapping[str, int]) -> Vectors:
    """Return positions, with a point up the trunk as the neck of a body without one."""
    place = by_name(forward_kinematics(pose)[0], index)
    if "neck" in place:
        return place
    if "left_shoulder" in place:
        return place | {"neck": _middle(place, "shoulder")}
    spine = [place[name] for name in ("spine3", "spine1") if name in place]
    return place | {"neck": spine[0] if spine else 2 * _middle(place, "hip") - _middle(place, "knee")}


def by_name(values: np.ndarray, index: Mapping[str, int]) -> Vectors:
    """Return the values (..., n) of points (..., P, n), by our names."""
    return {name: values[..., k, :] for name, k in index.items()}


def _stands(place: Vectors) -> bool:
    """Whether a rest pose, whatever its up axis, is standing: legs down, arms not over the head, within 60°."""
    upper = "shoulder" if "left_shoulder" in place else "hip"
    across = normalize(place[f"left_{upper}"] - place[f"right_{upper}"])
    up = normalize(place["neck"] - (_middle(place, "hip") if "left_hip" in place else place["pelvis"]))
    directions = [(up, np.cross(np.cross(across, up), across))]
    for side, out in (("left", across), ("right", -across)):
        ways = {**dict.fromkeys(_LEG, -up), ("shoulder", "elbow"): out - up}
        directions += [(bone, wanted) for ends, wanted in ways.items() for bone in _bone(place, side, *ends)]
    return all(float(angle_between(found, wanted)) < np.deg2rad(60.0) for found, wanted in directions)


def _bone(place: Vectors, side: str, start: str, end: str) -> list[np.ndarray]:
    """Return the vector from one joint to another, if the body has both."""
    names = (f"{side}_{start}", f"{side}_{end}")
    return [place[names[1]] - place[names[0]]] if all(name in place for name in names) else []


def _middle(place: Vectors, part: str) -> np.ndarray:
    return (place[f"left_{part}"] + place[f"right_{part}"]) / 2


def _crookedness(place: Vectors) -> np.ndarray:
    """Return the distance (T,) of a body from standing straight: squared angles, summed."""
    across = across_of(place)
    angles = [angle_between(place["neck"] - place["pelvis"], _UP)]
    if "left_shoulder" in place:
        angles.append(angle_between(place["left_shoulder"] - place["right_shoulder"], across))
    if "head" in place:
        angles.append(angle_between(place["head"] - place["neck"], _UP))
    if all(eye in place for eye in _EYES):
        angles.append(angle_between(place[_EYES[0]] - place[_EYES[1]], across))
    for side, out in (("left", across), ("right", -across)):
        angles += [angle_between(bone, -_UP) for ends in _LEG for bone in _bone(place, side, *ends)]
        for upper in _bone(place, side, "shoulder", "elbow"):
            angles.append(np.minimum(angle_between(upper, out), angle_between(upper, -_UP) + HANGING))
            angles += [angle_between(bone, upper) for bone in _bone(place, side, "elbow", "wrist")]
    return np.sum(np.square(angles), axis=0)


def _looking_ahead(pose: Pose, index: dict[str, int]) -> Pose:
    """Turn the head upright with level eyes, in the direction of the hips; the pose is unchanged if it has no eyes."""
    if not {"head", "head_top", *_EYES} <= index.keys():
        return pose
    position, world = forward_kinematics(pose)
    place = by_name(position, index)
    wanted = _frame(across_of(place), _UP)
    found = _frame(place[_EYES[0]] - place[_EYES[1]], place["head_top"] - place["head"])
    if wanted is None or found is None:
        return pose
    head = index["head"]
    turned = quaternion_multiply(matrix_to_quaternion(wanted @ found.T), world[head])
    rotation = pose.rotation.copy()
    rotation[head] = quaternion_multiply(quaternion_conjugate(world[pose.skeleton.parents[head]]), turned)
    return Pose(pose.skeleton, pose.root_position, rotation)


def across_of(place: Vectors) -> np.ndarray:
    """Return the horizontal unit vector from the right hip to the left one, or from shoulder to shoulder."""
    part = "hip" if "left_hip" in place else "shoulder"
    return normalize((place[f"left_{part}"] - place[f"right_{part}"]) * np.array([1.0, 0.0, 1.0]))


# --- alignment ---


def alignment(place: Vectors, parents: Mapping[str, str], *, exactly: bool = False) -> Vectors:
    """Return for each matched joint the rotation (..., 4) from bones at `place` to ours (see the module's text).

    `exactly`: without a tolerance, so that bones have the directions of ours.
    """
    ours = default_skeleton()
    default = dict(zip(ours.points, ours.path @ ours.rest_offset, strict=True))
    align: Vectors = {}
    for name in (name for name in ours.joints if name in place):
        still = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*place[name].shape[:-1], 4))
        turn = align[name] = align[parents[name]] if name in parents else still
        children = [child for child, parent in parents.items() if parent == name]
        tolerance = LIMB_TOLERANCE if any(limb in name for limb in _LIMBS) else OTHER_TOLERANCE
        pairs = _two_directions(name, children, place)
        if pairs and (found := _frame(*(place[b] - place[a] for a, b in pairs))) is not None:
            wanted = _frame(*(default[b] - default[a] for a, b in pairs))
            aligned = matrix_to_quaternion(wanted @ np.swapaxes(found, -1, -2))
            off = geodesic_angle(aligned, turn)
        elif len(children) == 1:
            bone = quaternion_rotate(turn, place[children[0]] - place[name])
            wanted = np.broadcast_to(default[children[0]] - default[name], bone.shape)
            off = angle_between(bone, wanted)
            if not exactly and not (off > tolerance).any():
                continue
            aligned = quaternion_multiply(shortest_arc(bone, wanted), turn)
        else:
            continue
        align[name] = aligned if exactly else np.where((off > tolerance)[..., None], aligned, turn)
    return align


def _two_directions(name: str, children: list[str], place: Vectors) -> list[tuple[str, str]]:
    """Return two pairs of points (from, to) that orient a joint with several children, or an empty list."""
    side = name.partition("_")[0]
    if name.endswith("_wrist"):
        along = [f"{side}_{finger}1" for finger in ("middle", "index", "ring", "pinky") if f"{side}_{finger}1" in place]
        inner = [f"{side}_{finger}1" for finger in ("pinky", "ring") if f"{side}_{finger}1" in place]
        return [(name, along[0]), (inner[0], f"{side}_index1")] if inner and f"{side}_index1" in place else []
    across = [(f"right_{child[5:]}", child) for child in children if child.startswith("left_")]
    up = [(name, child) for child in children if "_" not in child]
    return [across[0], up[0]] if across and across[0][0] in place and up else []


def _frame(first: np.ndarray, second: np.ndarray) -> np.ndarray | None:
    """Return a right-handed frame (..., 3, 3), axes as columns: along `first`, then as close to `second` as possible.

    Return None for vectors that are zero or parallel.
    """
    third = np.cross(first, second)
    size, across, area = (np.linalg.norm(vector, axis=-1, keepdims=True) for vector in (first, second, third))
    if (area < 1e-6 * np.maximum(1e-9, size * across)).any():
        return None
    x, z = first / size, third / area
    return np.stack([x, np.cross(z, x), z], axis=-1)


def twisted_by_hinges(align: Vectors, position: Vectors, turned: Vectors) -> Vectors:
    """Twist the alignments (4,) of upper arms, thighs, forearms and shins so that they bend as ours do.

    `position` (T, 3) are points in the motion, `turned` (T, 4) its joints' rotations with these alignments.
    """
    twisted = dict(align)
    for (first, second, third), hinge in (limb for limb in _HINGES if limb[0][0] in align):
        upper, lower = (position[b] - position[a] for a, b in ((first, second), (second, third)))
        normal = np.cross(upper, lower)
        lengths = np.linalg.norm(upper, axis=-1) * np.linalg.norm(lower, axis=-1)
        bend = np.linalg.norm(normal, axis=-1) / np.maximum(lengths, 1e-12)  # sine
        clear = bend > np.sin(LEAST_BEND)
        if clear.sum() < 2:
            continue
        for joint, bone in ((first, upper), (second, lower)):
            back = quaternion_conjugate(turned[joint][clear])
            along = quaternion_rotate(back, bone[clear])
            angle, agreement = _turn_about(along, np.array(hinge), quaternion_rotate(back, normal[clear]))
            if agreement > _LEAST_AGREEMENT:
                axis = along.mean(axis=0)
                axis /= max(float(np.linalg.norm(axis)), 1e-9)
                # The joint's frame turns with its twist, so a direction in it turns the opposite way.
                twist = quaternion_exp(-angle * axis)
                twisted[joint] = quaternion_multiply(twist, align[joint])
                hand = third.endswith("_wrist") and joint == second
                if hand and third.replace("wrist", "index1") not in position:  # the palm would define it
                    twisted[third] = quaternion_multiply(twist, align[third])
    return twisted


def _turn_about(bone: np.ndarray, start: np.ndarray, end: np.ndarray) -> tuple[float, float]:
    """Return the mean angle (radians) about bones (N, 3) from a direction (3,) to others (N, 3), weighted by length."""
    along = bone / np.maximum(np.linalg.norm(bone, axis=-1, keepdims=True), 1e-12)
    flat = start - (along @ start)[:, None] * along
    sine = (np.cross(flat, end) * along).sum(-1)
    cosine = (flat * end).sum(-1)
    length = np.hypot(sine, cosine)
    total = complex(cosine.sum(), sine.sum())
    return float(np.angle(total)), abs(total) / max(float(length.sum()), 1e-12)
