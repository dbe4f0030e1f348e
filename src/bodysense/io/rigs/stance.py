"""A rest pose from the motion itself, for files whose own rest pose is not a standing body.

Talking With Hands 16.2M is such a set: its hierarchy holds every bone in a frame of the rig's own, so that with all
rotations zero the body is contorted. Joint positions do not depend on the rest pose, but the twist of limbs and
head does. It is taken from the frame closest to a T-pose, or to standing with hanging arms (a turn in one plane
away); the result is as accurate as the person stands straight there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.rotation import matrix_to_quaternion, quaternion_conjugate, quaternion_multiply
from bodysense.io.clip import Clip

CANDIDATES = 2000  # frames that are examined, evenly spaced
UPRIGHT = np.deg2rad(30.0)  # rad; if the best frame's torso leans more than this, the body never stands
HANGING = np.deg2rad(10.0)  # rad by which hanging arms must be closer than a T-pose to be preferred
_EYES = ("b_l_eye", "b_r_eye")  # of the rigs of Meta's data sets; eyes define the direction of a head
_UP = np.array([0.0, 1.0, 0.0])
_LEG = (("hip", "knee"), ("knee", "ankle"))

Places = dict[str, np.ndarray]  # points of ours, and the eyes, by name: (..., 3) m, world


@dataclass(frozen=True, eq=False)
class Stance:
    """A frame of a motion as a rest pose."""

    rest: Pose | None  # no batch axes; None if the file's own rest pose is a standing body
    torso: float  # radians from upright


def standing_rest(clip: Clip, joints: Mapping[str, str]) -> Stance:
    """Return a pose to pass to `canonical` as `rest`; `joints` are {name in the clip: ours}.

    It is the frame in which the clip's body is closest to a T-pose or to standing with hanging arms, with its head
    turned straight if the rig has eyes.
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
    """Return a point up the trunk of a body without a neck: between the shoulders, on the spine, or over the legs."""
    if "left_shoulder" in place:
        return _middle(place, "shoulder")
    spine = [place[name] for name in ("spine3", "spine1") if name in place]
    return spine[0] if spine else 2 * _middle(place, "hip") - _middle(place, "knee")


def _stands(place: Places) -> bool:
    """Whether a rest pose, whatever its up axis, is standing: legs down, arms not over the head, within 60°."""
    upper = "shoulder" if "left_shoulder" in place else "hip"
    across = _unit(place[f"left_{upper}"] - place[f"right_{upper}"])
    up = _unit(place["neck"] - (_middle(place, "hip") if "left_hip" in place else place["pelvis"]))
    directions = [(up, np.cross(np.cross(across, up), across))]
    for side, out in (("left", across), ("right", -across)):
        ways = {**dict.fromkeys(_LEG, -up), ("shoulder", "elbow"): out - up}
        directions += [(bone, wanted) for ends, wanted in ways.items() for bone in _bone(place, side, *ends)]
    return all(float(_angle(found, wanted)) < np.deg2rad(60.0) for found, wanted in directions)


def _bone(place: Places, side: str, start: str, end: str) -> list[np.ndarray]:
    """Return the vector from one joint to another, if the body has both."""
    names = (f"{side}_{start}", f"{side}_{end}")
    return [place[names[1]] - place[names[0]]] if all(name in place for name in names) else []


def _middle(place: Places, part: str) -> np.ndarray:
    return (place[f"left_{part}"] + place[f"right_{part}"]) / 2


def _crookedness(place: Places) -> np.ndarray:
    """Return the distance (T,) of a body from standing straight: squared angles, summed."""
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
    """Turn the head upright with level eyes, in the direction of the hips; the pose is unchanged if it has no eyes."""
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
    """Return the horizontal unit vector from the right hip to the left one, or from shoulder to shoulder."""
    part = "hip" if "left_hip" in place else "shoulder"
    return _unit((place[f"left_{part}"] - place[f"right_{part}"]) * np.array([1.0, 0.0, 1.0]))


def _axes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a right-handed frame (3, 3), axes as columns: along `x`, then as close to `y` as possible."""
    x, z = _unit(x), _unit(np.cross(x, y))
    return np.stack([x, np.cross(z, x), z], axis=1)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)


def _angle(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return angles (...) between vectors (..., 3), radians."""
    return np.arctan2(np.linalg.norm(np.cross(u, v), axis=-1), np.sum(u * v, axis=-1))
