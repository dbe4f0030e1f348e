"""Inertial sensors: rotations with an unknown heading, of trackers with an unknown mounting.

`left_knee_imu` is a sensor on the segment that the joint `left_knee` turns, the shin. Calibration finds both unknowns
of each sensor while the wearer stands. Heading: a sensor is assumed on a usual side of its segment (`FACING`), and the
segment faces where the wearer does. Mount: the remaining rotation between the sensor and its joint. Then the sensor
gives its joint's rotation. The person's file keeps the mounts. Headings drift, and change whenever a sensor is switched
on, so they are measured again, with unchanged mounts, when a sensor first sends and whenever the wearer recentres.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from bodysense.body.person import SENSOR, Person
from bodysense.body.pose import Pose, forward_kinematics, rest_pose, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import heading, normalize, quaternion_conjugate, quaternion_multiply
from bodysense.observing.observation import Observation
from bodysense.observing.points import chosen_points
from bodysense.tracking.calibration import Stance

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
class MountedSensor:
    """A sensor whose mount is known: joint = heading · sensor · mount, rotations in the world."""

    heading: np.ndarray | None  # (4,) wxyz, about +Y; None until the sensor first sends
    mount: np.ndarray  # (4,) wxyz, sensor ← joint


@dataclass(frozen=True, eq=False)
class InertialSensors:
    """The sensors of a wearer, by name."""

    sensors: Mapping[str, MountedSensor] = field(default_factory=dict)

    @classmethod
    def of(cls, person: Person) -> InertialSensors:
        """Return the sensors whose mounts a person has."""
        mounts = {name: mount for name, mount in person.mounts.items() if name in IMUS}
        return cls({name: MountedSensor(None, _inverse(mount.rotation)) for name, mount in mounts.items()})

    @property
    def mounts(self) -> dict[str, RigidTransform]:
        """T_joint_tracker by sensor, as `Person.mounts` has them; the position of a sensor is unknown, and zero."""
        return {name: RigidTransform(rotation=_inverse(one.mount)) for name, one in self.sensors.items()}

    def joints(self, observation: Observation) -> Observation:
        """Replace sensors by the joints that they turn. Sensors without a mount or heading are dropped.

        Another device that tracks the joint takes precedence.
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
            sensor = self.sensors.get(name)
            if sensor is None or sensor.heading is None or IMUS[name] in tracked:
                continue
            joint = quaternion_multiply(quaternion_multiply(sensor.heading, observation.rotation[:, k]), sensor.mount)
            if IMUS[name] in observation.points:  # the joint of a tracker that is lost now
                there = observation.points.index(IMUS[name])
                rotation[:, there] = np.where(has[:, k, None], joint, rotation[:, there])
                has[:, there] |= has[:, k]
            else:
                points[k], rotation[:, k] = IMUS[name], joint
                keep.append(k)
        turned = replace(observation, points=tuple(points), rotation=rotation, has_rotation=has)
        return chosen_points(turned, keep)

    def with_missing_headings(self, observation: Observation, skeleton: Skeleton) -> InertialSensors:
        """Measure missing headings; the wearer must stand upright."""
        new = [name for name, one in self.sensors.items() if one.heading is None and name in observation.points]
        head = observation.points.index("head") if "head" in observation.points else None
        if not new or (head is not None and not observation.has_rotation[:, head].any()):
            return self
        whole = self.with_new_headings(observation, skeleton).sensors
        return InertialSensors({**self.sensors, **{name: whole[name] for name in new}})

    def with_new_headings(self, observation: Observation, skeleton: Skeleton) -> InertialSensors:
        """Measure all headings anew; the wearer must stand upright and face the head's direction."""
        standing = _standing_rotations(observation, skeleton, "standing")
        sensors = dict(self.sensors)
        for name, turned in _mean_rotations(observation).items():
            if name in sensors:
                joint = quaternion_multiply(turned, sensors[name].mount)
                error = heading(quaternion_multiply(joint, _inverse(standing[IMUS[name]])))
                sensors[name] = replace(sensors[name], heading=_inverse(error))
        return InertialSensors(sensors)


def calibrate_sensors(
    observation: Observation, skeleton: Skeleton, stance: Stance, before: InertialSensors
) -> InertialSensors:
    """Measure headings and mounts while the wearer stands; sensors that are not tracked are unchanged."""
    standing, facing = _standing_rotations(observation, skeleton, stance), _facing(observation)
    sensors = dict(before.sensors)
    for name, turned in _mean_rotations(observation).items():
        joint = IMUS[name]
        outward = np.array([np.cos(FACING[joint] / 2), 0.0, np.sin(FACING[joint] / 2), 0.0])
        ahead = quaternion_multiply(turned, _inverse(outward))
        turn = quaternion_multiply(facing, _inverse(heading(ahead)))
        mount = quaternion_multiply(_inverse(quaternion_multiply(turn, turned)), standing[joint])
        sensors[name] = MountedSensor(turn, mount)
    return InertialSensors(sensors)


def has_sensors(observation: Observation) -> bool:
    """Return whether any inertial sensor is tracked."""
    return bool(_mean_rotations(observation))


def _facing(observation: Observation) -> np.ndarray:
    """Return the head's mean heading, (4,) wxyz about +Y; the identity without a headset."""
    if "head" in observation.points:
        k = observation.points.index("head")
        known = observation.has_rotation[:, k]
        if known.any():
            return np.asarray(heading(_mean(observation.rotation[known, k])))
    return np.array([1.0, 0.0, 0.0, 0.0])


def _standing_rotations(observation: Observation, skeleton: Skeleton, stance: Stance) -> dict[str, np.ndarray]:
    """Return world rotations (4,) of the joints of a standing wearer with the head's heading."""
    pose = standing_pose(skeleton) if stance == "standing" else rest_pose(skeleton)
    turned = pose.rotation.copy()
    turned[0] = quaternion_multiply(_facing(observation), turned[0])
    rotation = forward_kinematics(Pose(skeleton, np.zeros(3), turned))[1]
    return dict(zip(skeleton.joints, np.asarray(rotation), strict=True))


def _mean_rotations(observation: Observation) -> dict[str, np.ndarray]:
    """Return mean rotations (4,) of the tracked sensors."""
    return {
        name: _mean(observation.rotation[observation.has_rotation[:, k], k])
        for k, name in enumerate(observation.points)
        if name in IMUS and observation.has_rotation[:, k].any()
    }


def _mean(rotation: np.ndarray) -> np.ndarray:
    """Return the mean (4,) of rotations (N, 4) that differ little."""
    same = rotation * np.copysign(1.0, (rotation * rotation[:1]).sum(axis=1, keepdims=True))
    return np.asarray(normalize(same.mean(axis=0)))


def _inverse(rotation: np.ndarray) -> np.ndarray:
    return np.asarray(quaternion_conjugate(rotation))
