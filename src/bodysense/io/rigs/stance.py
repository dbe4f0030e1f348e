"""A rest pose from the motion itself, for files whose own rest pose is none that a body could stand in.

Talking With Hands 16.2M is such a set: its hierarchy holds every bone in a frame of the rig's own, so that with all
rotations zero the body is contorted. Where the joints are does not depend on the rest pose, but how much a limb or the
head is twisted does. The frame that is nearest to a T-pose, or to standing with hanging arms (which differs from it by
a turn in one plane), tells it as well as a person stands straight in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.rotation import matrix_to_quaternion, quaternion_conjugate, quaternion_multiply
from bodysense.io.clip import Clip

CANDIDATES = 2000  # frames that are looked at, evenly spaced
UPRIGHT = np.deg2rad(30.0)  # of the best frame: in a torso more oblique than this nobody stands
HANGING = np.deg2rad(10.0)  # by how much nearer than a T-pose hanging arms must be, to be preferred
_EYES = ("b_l_eye", "b_r_eye")  # of the rigs of Meta's data sets: they say where a head looks
_UP = np.array([0.0, 1.0, 0.0])
_LEG = (("hip", "knee"), ("knee", "ankle"))

Places = dict[str, np.ndarray]  # of points of ours, and of the eyes, by name: (..., 3) m, world


@dataclass(frozen=True, eq=False)
class Stance:
    """A frame of a motion as a rest pose."""

    rest: Pose | None  # no batch axes; None where the file's own rest pose is one that a body stands in
    torso: float  # radians from upright


def standing_rest(clip: Clip, joints: Mapping[str, str]) -> Stance:
    """A pose to hand to `canonical` as `rest`; `joints` are {name in the clip: ours}.

    It is the frame in which the clip's body stands nearest to a T-pose or with hanging arms, its head turned straight
    if the rig has eyes.
    """
    skeleton = clip.pose.skeleton
    index = {ours: skeleton.index(given) for given, ours in joints.items()}
    index |= {name: skeleton.index(name) for name in _EYES if name in skeleton.joints}
    if _stands(_places(rest_pose(skeleton), index)):
        return Stance(None, 0.0)
    frames = np.arange(0, len(clip), max(1, len(clip) // CANDIDATES))
    place = _places(clip.pose[frames], index)
    best = int(np.argmin(_crookedness(place)))
    torso = float(_angle(place["neck"][best] - place["pelvis"][best], _UP))
    return Stance(_looking_ahead(clip.pose[int(frames[best])], index), torso)


def _places(pose: Pose, index: dict[str, int]) -> Places:
    position, _ = forward_kinematics(pose)
    place = {name: position[..., k, :] for name, k in index.items()}
    if "neck" not in place:
        place["neck"] = _over(place)
    return place


def _over(place: Places) -> np.ndarray:
    """Somewhere up the trunk, of a body without a neck: between the shoulders, on the spine, or over the legs."""
    if "left_shoulder" in place:
        return _middle(place, "shoulder")
    spine = [place[name] for name in ("spine3", "spine1") if name in place]
    return spine[0] if spine else 2 * _middle(place, "hip") - _middle(place, "knee")


def _stands(place: Places) -> bool:
    """Whether a rest pose, whichever way is up in it, is one of standing: legs down, arms not over the head, to 60°."""
    upper = "shoulder" if "left_shoulder" in place else "hip"
    across = _unit(place[f"left_{upper}"] - place[f"right_{upper}"])
    up = _unit(place["neck"] - (_middle(place, "hip") if "left_hip" in place else place["pelvis"]))
    directions = [(up, np.cross(np.cross(across, up), across))]
    for side, out in (("left", across), ("right", -across)):
        ways = {**dict.fromkeys(_LEG, -up), ("shoulder", "elbow"): out - up}
        directions += [(bone, wanted) for ends, wanted in ways.items() for bone in _bone(place, side, *ends)]
    return all(float(_angle(found, wanted)) < np.deg2rad(60.0) for found, wanted in directions)


def _bone(place: Places, side: str, start: str, end: str) -> list[np.ndarray]:
    """From one joint to another, where the body has both."""
    names = (f"{side}_{start}", f"{side}_{end}")
    return [place[names[1]] - place[names[0]]] if all(name in place for name in names) else []


def _middle(place: Places, part: str) -> np.ndarray:
    return (place[f"left_{part}"] + place[f"right_{part}"]) / 2


def _crookedness(place: Places) -> np.ndarray:
    """How far (T,) a body is from standing straight: squared angles, summed."""
    across = _across(place)
    angles = [
        _angle(place["neck"] - place["pelvis"], _UP),
    ]
    if "left_shoulder" in place:
        angles.append(_angle(place["left_shoulder"] - place["right_shoulder"], across))
    if "head" in place:
        angles.append(_angle(place["head"] - place["neck"], _UP))
    if all(eye in place for eye in _EYES):
        angles.append(_angle(place[_EYES[0]] - place[_EYES[1]], across))
    for side, out in (("left", across), ("right", -across)):
        angles += [_angle(bone, -_UP) for ends in _LEG for bone in _bone(place, side, *ends)]
        for upper in _bone(place, side, "shoulder", "elbow"):
            angles.append(np.minimum(_angle(upper, out), _angle(upper, -_UP) + HANGING))
            angles += [_angle(bone, upper) for bone in _bone(place, side, "elbow", "wrist")]
    return np.sum(np.square(angles), axis=0)


def _looking_ahead(pose: Pose, index: dict[str, int]) -> Pose:
    """The pose with its head upright and its eyes level, in the direction of its hips; unchanged if it has no eyes."""
    if not {"head", "head_top", *_EYES} <= index.keys():
        return pose
    position, world = forward_kinematics(pose)
    place = {name: position[k] for name, k in index.items()}
    across = _across(place)
    wanted = _axes(across, _UP)
    found = _axes(place[_EYES[0]] - place[_EYES[1]], place["head_top"] - place["head"])
    head = index["head"]
    turned = quaternion_multiply(matrix_to_quaternion(wanted @ found.T), world[head])
    rotation = pose.rotation.copy()
    rotation[head] = quaternion_multiply(quaternion_conjugate(world[pose.skeleton.parents[head]]), turned)
    return Pose(pose.skeleton, pose.root_position, rotation)


def _across(place: Places) -> np.ndarray:
    """From the right hip to the left one, or from shoulder to shoulder, level, of length one."""
    part = "hip" if "left_hip" in place else "shoulder"
    return _unit((place[f"left_{part}"] - place[f"right_{part}"]) * np.array([1.0, 0.0, 1.0]))


def _axes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A right-handed frame (3, 3), axes as columns: along `x`, then as near to `y` as can be."""
    x, z = _unit(x), _unit(np.cross(x, y))
    return np.stack([x, np.cross(z, x), z], axis=1)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)


def _angle(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Angles (...) between vectors (..., 3), radians."""
    return np.arctan2(np.linalg.norm(np.cross(u, v), axis=-1), np.sum(u * v, axis=-1))
