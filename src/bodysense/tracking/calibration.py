"""Calibration: height, arm span and tracker mounts of a wearer from one second in a known pose."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import Literal

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, rest_pose, standing_pose
from bodysense.body.shape import Measured, stature_of_head
from bodysense.errors import BodysenseError
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import quaternion_multiply
from bodysense.observing.observation import Observation

Stance = Literal["standing", "arms out"]
DEVICES_AT_JOINTS = ("head", "left_wrist", "right_wrist")  # points of headset and controllers, which need no mount
_SIDES = ("left", "right")
TRACKER_JOINTS = ("pelvis", "spine3", *(f"{side}_{part}" for part in ("ankle", "knee", "elbow") for side in _SIDES))
_FARTHEST_TRACKER = 0.35  # m; largest distance of a tracker from its joint
_STILL = 0.05  # m; largest movement of the head during calibration
_SHORT = 0.3  # s; shortest calibration
_HEAD_DEVIATION, _SPAN_DEVIATION = 0.02, 0.02  # m; standard deviations of head height and arm span


def calibrate(observation: Observation, person: Person, stance: Stance = "standing", floor: float = 0.0) -> Person:
    """Return the person as measured while standing upright and still for about a second, looking ahead.

    Args:
        observation: tracked points (T, P) during this time; the head is required.
        person: the wearer as known before; a known height or skeleton is unchanged.
        stance: 'standing' with hanging arms, or 'arms out' to the sides, which also measures the arm span.
        floor: height of the floor, m.

    Trackers that are not on head or wrists are assumed to be strapped next to their joints.

    Raises BodysenseError for observations that are too short or move too much, and if the head is not tracked.
    """
    if "head" not in observation.points:
        raise BodysenseError("calibration: the head is not tracked; wear the headset, and stand upright and still")
    duration = float(observation.time[-1] - observation.time[0]) if len(observation) else 0.0
    head = observation.points.index("head")
    known = observation.has_position[:, head] & observation.has_rotation[:, head]
    if duration < _SHORT or not known.any():
        raise BodysenseError(
            f"calibration: the head is tracked for {duration if known.any() else 0:.2g} s; stand for a second"
        )
    path = observation.position[known, head]
    moved = float(np.linalg.norm(path - np.median(path, axis=0), axis=1).max())
    if moved > _STILL:
        raise BodysenseError(f"calibration: the head moved by {100 * moved:.0f} cm; stand still for a second")
    place = np.median(path, axis=0)
    height, lengths = person.height, dict(person.lengths)
    if person.bone_deviation.any():
        if height is None:
            height = stature_of_head(place[1] - floor, _HEAD_DEVIATION)
        wrists = [observation.points.index(name) for name in DEVICES_AT_JOINTS[1:] if name in observation.points]
        if stance == "arms out" and len(wrists) == 2:
            both = observation.has_position[:, wrists].all(axis=1)
            apart = observation.position[both][:, wrists[0]] - observation.position[both][:, wrists[1]]
            if both.any():
                span = float(np.median(np.linalg.norm(apart, axis=-1)))
                lengths["left_wrist", "right_wrist"] = Measured(span, _SPAN_DEVIATION)
        person = Person(height=height, lengths=lengths, mounts=person.mounts, hands=person.hands)
    stood = _standing_pose(person, place, _mean(observation.rotation[known, head]), stance)
    return person.with_mounts(_mounts(observation, stood))


def assign_trackers(
    observation: Observation,
    trackers: Sequence[str],
    person: Person,
    stance: Stance = "standing",
) -> dict[str, str]:
    """Return the joint of `TRACKER_JOINTS` to which each of `trackers` is strapped, from positions in a known stance.

    The total distance of trackers to their joints is minimal. Joints tracked by other points are excluded. Trackers
    farther than 35 cm from every free joint are left out, and all trackers are if the head is not tracked.
    """
    seen = [name for name in trackers if observation.has_position[:, observation.points.index(name)].any()]
    if "head" not in observation.points:
        return {}
    head = observation.points.index("head")
    known = observation.has_position[:, head] & observation.has_rotation[:, head]
    if not seen or not known.any():
        return {}
    tracked = {name for k, name in enumerate(observation.points) if observation.has_position[:, k].any()}
    free = [joint for joint in TRACKER_JOINTS if joint not in tracked]
    if not free:
        return {}
    place = np.median(observation.position[known, head], axis=0)
    stood = forward_kinematics(_standing_pose(person, place, _mean(observation.rotation[known, head]), stance))[0]
    joints = stood[person.skeleton.indices(free)]
    where = []
    for name in seen:
        k = observation.points.index(name)
        where.append(np.median(observation.position[observation.has_position[:, k], k], axis=0))
    apart = np.linalg.norm(np.array(where)[:, None] - joints, axis=-1)
    cost = np.minimum(apart, _FARTHEST_TRACKER) ** 2
    few, many = sorted(cost.shape)
    choices = np.array(list(permutations(range(many), few)))
    if len(seen) <= len(free):
        rows, columns = range(few), choices[cost[np.arange(few), choices].sum(axis=1).argmin()]
    else:
        rows, columns = choices[cost[choices, np.arange(few)].sum(axis=1).argmin()], range(few)
    return {
        seen[row]: free[column]
        for row, column in zip(rows, columns, strict=True)
        if apart[row, column] < _FARTHEST_TRACKER
    }


def _standing_pose(person: Person, head: np.ndarray, rotation: np.ndarray, stance: Stance) -> Pose:
    """Return a standing pose with the head at a position (3,) and with its heading."""
    pose = standing_pose(person.skeleton) if stance == "standing" else rest_pose(person.skeleton)
    turn = rotation * np.array([1.0, 0.0, 1.0, 0.0])  # the twist about the vertical
    turn = turn / np.linalg.norm(turn)
    world = pose.rotation.copy()
    world[0] = quaternion_multiply(turn, world[0])
    own = forward_kinematics(Pose(person.skeleton, np.zeros(3), world))[0][person.skeleton.index("head")]
    return Pose(person.skeleton, head - own, world)


def _mounts(observation: Observation, stood: Pose) -> dict[str, RigidTransform]:
    """Return T_joint_tracker of every tracker with a pose, from the pose of its joint while the wearer stands."""
    position, rotation = forward_kinematics(stood)
    skeleton, mounts = stood.skeleton, {}
    for k, name in enumerate(observation.points):
        both = observation.has_position[:, k] & observation.has_rotation[:, k]
        if name in DEVICES_AT_JOINTS or name not in skeleton.joints or not both.any():
            continue
        joint = skeleton.index(name)
        world_joint = RigidTransform(position[joint], rotation[joint])
        tracker = RigidTransform(np.median(observation.position[both, k], axis=0), _mean(observation.rotation[both, k]))
        mounts[name] = world_joint.inverse() @ tracker
    return mounts


def _mean(rotation: np.ndarray) -> np.ndarray:
    """Return the mean (4,) of similar rotations (N, 4)."""
    same = rotation * np.sign((rotation * rotation[:1]).sum(axis=1, keepdims=True))
    mean = same.mean(axis=0)
    return mean / np.linalg.norm(mean)
