"""Inertial sensors: rotations with an unknown heading, of trackers with an unknown mounting.

`left_knee_imu` is a sensor on what the joint `left_knee` turns, the shin. A calibration second gives both unknowns of
each sensor. Its heading: a strap sits on a usual side of its segment (`FACING`), which then points where the wearer
faces. Its mount: the remaining rotation between it and the joint of a standing wearer. From then on a sensor gives its
joint's rotation. A person keeps the mounts. Headings drift, and change whenever a sensor is switched on. They are
measured again, with unchanged mounts, when a sensor first sends and whenever the wearer recentres.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from bodysense.body.person import SENSOR, Person
from bodysense.body.pose import Pose, forward_kinematics, rest_pose, standing_pose
from bodysense.body.rigid import RigidTransform
from bodysense.body.rotation import heading, normalize, quaternion_conjugate, quaternion_multiply
from bodysense.body.skeleton import Skeleton
from bodysense.completion.calibration import Stance
from bodysense.observation import Observation, chosen_points

_MIDDLE = ("head", "neck", "spine3", "spine2", "spine1", "pelvis")
_SIDED = ("hip", "knee", "ankle", "collar", "shoulder", "elbow", "wrist")
JOINTS = (*_MIDDLE, *(f"{side}_{part}" for side in ("left", "right") for part in _SIDED))
IMUS = {f"{joint}{SENSOR}": joint for joint in JOINTS}
# rad about +Y, from the front of a segment to the side on which its sensor is usually worn; to the wearer's left.
FACING = {
    **dict.fromkeys(JOINTS, 0.0),
    **{f"left_{part}": np.pi / 2 for part in ("elbow", "wrist")},
    **{f"right_{part}": -np.pi / 2 for part in ("elbow", "wrist")},
    **{f"left_{part}": np.pi / 4 for part in ("shoulder", "knee")},
    **{f"right_{part}": -np.pi / 4 for part in ("shoulder", "knee")},
}


@dataclass(frozen=True, eq=False)
class WornSensor:
    """A sensor whose mount is known: joint = heading · sensor · mount, of rotations in the world."""

    heading: np.ndarray | None  # (4,) wxyz, about +Y; None until it first comes
    mount: np.ndarray  # (4,) wxyz, sensor ← joint


@dataclass(frozen=True, eq=False)
class Inertial:
    """The sensors of a wearer, by name."""

    worn: Mapping[str, WornSensor] = field(default_factory=dict)

    @classmethod
    def of(cls, person: Person) -> Inertial:
        """The sensors that a person wears."""
        mounts = {name: mount for name, mount in person.mounts.items() if name in IMUS}
        return cls({name: WornSensor(None, _back(mount.rotation)) for name, mount in mounts.items()})

    @property
    def mounts(self) -> dict[str, RigidTransform]:
        """T_joint_tracker as a person keeps them; the position of a sensor on its joint is unknown."""
        return {name: RigidTransform(rotation=_back(one.mount)) for name, one in self.worn.items()}

    def joints(self, observation: Observation) -> Observation:
        """Return the observation with joints in place of sensors; sensors whose mounting is unknown are dropped.

        Another device that tracks a joint comes first.
        """
        names = [name for name in observation.points if name in IMUS]
        if not names:
            return observation
        rotation, has = observation.rotation.copy(), observation.has_rotation.copy()
        seen = np.atleast_1d((observation.has_position | observation.has_rotation).any(axis=0))
        tracked = {name for k, name in enumerate(observation.points) if seen[k] and name not in IMUS}
        keep: list[int] = []
        points = list(observation.points)
        for k, name in enumerate(observation.points):
            if name not in IMUS:
                keep.append(k)
                continue
            worn = self.worn.get(name)
            if worn is None or worn.heading is None or IMUS[name] in tracked:
                continue
            joint = quaternion_multiply(quaternion_multiply(worn.heading, observation.rotation[:, k]), worn.mount)
            if IMUS[name] in observation.points:  # of a tracker that is not seen now
                there = observation.points.index(IMUS[name])
                rotation[:, there] = np.where(has[:, k, None], joint, rotation[:, there])
                has[:, there] |= has[:, k]
            else:
                points[k], rotation[:, k] = IMUS[name], joint
                keep.append(k)
        turned = replace(observation, points=tuple(points), rotation=rotation, has_rotation=has)
        return chosen_points(turned, keep)

    def headed(self, observation: Observation, skeleton: Skeleton) -> Inertial:
        """Return the sensors with headings of the new ones; the wearer must stand upright."""
        fresh = [name for name, one in self.worn.items() if one.heading is None and name in observation.points]
        head = observation.points.index("head") if "head" in observation.points else None
        if not fresh or (head is not None and not observation.has_rotation[:, head].any()):
            return self
        whole = self.reheaded(observation, skeleton).worn
        return Inertial({**self.worn, **{name: whole[name] for name in fresh}})

    def reheaded(self, observation: Observation, skeleton: Skeleton) -> Inertial:
        """Return the sensors with new headings; the wearer must stand upright and face the head's direction."""
        stood = _stood(observation, skeleton, "standing")
        worn = dict(self.worn)
        for name, turned in _turned(observation).items():
            if name in worn:
                seen = quaternion_multiply(quaternion_multiply(turned, worn[name].mount), _back(stood[IMUS[name]]))
                worn[name] = replace(worn[name], heading=_back(heading(seen)))
        return Inertial(worn)


def stood_still(observation: Observation, skeleton: Skeleton, stance: Stance, before: Inertial) -> Inertial:
    """Return the sensors after a calibration second; those that were not tracked are unchanged."""
    stood, face = _stood(observation, skeleton, stance), _face(observation)
    worn = dict(before.worn)
    for name, turned in _turned(observation).items():
        joint = IMUS[name]
        outward = np.array([np.cos(FACING[joint] / 2), 0.0, np.sin(FACING[joint] / 2), 0.0])
        ahead = quaternion_multiply(turned, _back(outward))
        turn = quaternion_multiply(face, _back(heading(ahead)))
        mount = quaternion_multiply(_back(quaternion_multiply(turn, turned)), stood[joint])
        worn[name] = WornSensor(turn, mount)
    return Inertial(worn)


def has_sensors(observation: Observation) -> bool:
    """Whether any inertial sensor is in it."""
    return bool(_turned(observation))


def _face(observation: Observation) -> np.ndarray:
    """(4,) where the head faces, about +Y; ahead, if no headset tells."""
    if "head" in observation.points:
        k = observation.points.index("head")
        known = observation.has_rotation[:, k]
        if known.any():
            return np.asarray(heading(_mean(observation.rotation[known, k])))
    return np.array([1.0, 0.0, 0.0, 0.0])


def _stood(observation: Observation, skeleton: Skeleton, stance: Stance) -> dict[str, np.ndarray]:
    """Return world rotations (4,) of joints of a standing wearer who faces where the head does."""
    pose = standing_pose(skeleton) if stance == "standing" else rest_pose(skeleton)
    turned = pose.rotation.copy()
    turned[0] = quaternion_multiply(_face(observation), turned[0])
    rotation = forward_kinematics(Pose(skeleton, np.zeros(3), turned))[1]
    return dict(zip(skeleton.joints, np.asarray(rotation), strict=True))


def _turned(observation: Observation) -> dict[str, np.ndarray]:
    """Mean rotations (4,) of the sensors that came."""
    return {
        name: _mean(observation.rotation[observation.has_rotation[:, k], k])
        for k, name in enumerate(observation.points)
        if name in IMUS and observation.has_rotation[:, k].any()
    }


def _mean(rotation: np.ndarray) -> np.ndarray:
    """The mean (4,) of rotations (N, 4) that differ little."""
    same = rotation * np.copysign(1.0, (rotation * rotation[:1]).sum(axis=1, keepdims=True))
    return np.asarray(normalize(same.mean(axis=0)))


def _back(rotation: np.ndarray) -> np.ndarray:
    return np.asarray(quaternion_conjugate(rotation))
