"""Exact refinement: inverse kinematics takes a completed body to interior points that were measured.

The graph puts head, wrists and ankles where they were measured and follows what lies between up to some centimetres.
Where that is not enough, these few Gauss-Newton steps start from its body: points between the ends go to where they
were measured, as far as bones reach, ends and feet stay, and rotations stay as near to the network's as that allows. A
body depends on its frame alone.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from bodysense.body.ik import IkSettings, InverseKinematics
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.completion.inputs import JOINTS, Frames
from bodysense.completion.model import Completed

_SIDES = ("left", "right")
_LIMBS = tuple(f"{side}_{part}" for part in ("collar", "shoulder", "elbow", "hip", "knee") for side in _SIDES)
INTERIOR = ("pelvis", "spine1", "spine2", "spine3", "neck", *_LIMBS)
_FEET = tuple(f"{side}_{part}" for part in ("ankle", "foot", "toe") for side in _SIDES)
_ENDS = ("head", *(f"{side}_wrist" for side in _SIDES), *_FEET)
_OFF = 0.002  # m: a body that is nearer everywhere stays as it is
_FARTHEST = 0.06  # m that a point is moved: what is farther off does not fit the bones
_VAGUE = 0.01  # m: points that are less accurate count less
_END_WEIGHT, _INTERIOR_WEIGHT, _PELVIS = 2e3, 10.0, 10.0  # the pelvis: times as much as others between the ends
# m²/rad², of rotations: the network's, those that are tracked, and those of them at ends and pelvis.
_PRIOR, _TRACKED, _END_TURN = 1e-4, 0.01, 1.0
_SETTINGS = IkSettings(max_iterations=8, posture_weight=1e-9)


def refined(completed: Completed, frame: Frames, rest_offset: np.ndarray) -> Completed:
    """The bodies of one frame of B people, of proportions (B, 65, 3), with measured interior points met."""
    apart = np.linalg.norm(completed.points[:, _INTERIOR] - frame.position[:, _INTERIOR], axis=-1)
    off = (apart > _OFF) & frame.has_position[:, _INTERIOR]
    those = np.flatnonzero(off.any(axis=1)).tolist()
    if not those:
        return completed
    root, rotation, points = completed.root_position.copy(), completed.rotation.copy(), completed.points.copy()
    for k in those:
        pose = _met(completed, frame, k, rest_offset[k])
        root[k], rotation[k], points[k] = pose.root_position, pose.rotation, forward_kinematics(pose)[0]
    return replace(completed, root_position=root, rotation=rotation, points=points)


_INTERIOR = default_skeleton().indices(INTERIOR)
_END_PLACES = default_skeleton().indices(_ENDS)
_FIRM = np.array([0, *_END_PLACES[_END_PLACES < JOINTS]])


@lru_cache(maxsize=128)
def _solver(rest_offset: bytes) -> InverseKinematics:
    offset = np.frombuffer(rest_offset).reshape(-1, 3)
    return InverseKinematics(default_skeleton().with_offsets(offset), _SETTINGS)


def _met(completed: Completed, frame: Frames, k: int, rest_offset: np.ndarray) -> Pose:
    """The body of one person."""
    solver = _solver(np.ascontiguousarray(rest_offset, dtype=np.float64).tobytes())
    rotation = completed.rotation[k].astype(np.float64)
    rotation /= np.linalg.norm(rotation, axis=-1, keepdims=True)
    root = completed.root_position[k].astype(np.float64)
    place, turn = forward_kinematics(Pose(solver.skeleton, root, rotation))
    target, weight = np.array(place), np.zeros(len(place))
    weight[_END_PLACES] = _END_WEIGHT
    known = _INTERIOR[frame.has_position[k, _INTERIOR]]
    away = frame.position[k, known] - place[known]
    far = np.linalg.norm(away, axis=-1, keepdims=True)
    target[known] += away * np.minimum(1.0, _FARTHEST / np.maximum(far, 1e-9))
    weight[known] = _INTERIOR_WEIGHT * np.minimum(1.0, (_VAGUE / frame.accuracy[k, known]) ** 2)
    weight[0] *= _PELVIS  # a body stands on it
    tracked, prior, aim = frame.has_rotation[k], np.full(JOINTS, _PRIOR), np.array(turn)
    aim[tracked], prior[tracked] = frame.rotation[k, tracked], _TRACKED
    prior[_FIRM[tracked[_FIRM]]] = _END_TURN
    pose, _ = solver.solve(target, weight, aim, prior, solver.at(root, np.asarray(turn)))
    return pose
