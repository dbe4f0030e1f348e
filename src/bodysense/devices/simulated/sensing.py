"""Observation of a motion by a set of sensors, without errors."""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import INERTIAL_POINTS, Skeleton
from bodysense.devices.simulated.inertial import sensor_accelerations
from bodysense.devices.simulated.sensors import SensorSet
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_canonical
from bodysense.observing.observation import EXACT_ACCURACY, Observation, accuracy_like


def observe(pose: Pose, time: np.ndarray, sensors: SensorSet) -> Observation:
    """Observe a motion with sensors, without errors.

    Args:
        pose: poses (..., T).
        time: (T,) s.
        sensors: the set. With a camera the observation has all points of the skeleton, otherwise those of the set.

    Raises BodysenseError for points that the skeleton lacks, and for rotations of end sites.
    """
    position, rotation = (np.asarray(part) for part in forward_kinematics(pose))
    visible = None
    if sensors.camera:
        from bodysense.devices.simulated.headset_camera import see_points

        visible = see_points(pose.skeleton, position, rotation).visible
    return observe_points(pose.skeleton, position, rotation, time, sensors, visible)


def observe_points(
    skeleton: Skeleton,
    position: np.ndarray,
    rotation: np.ndarray,
    time: np.ndarray,
    sensors: SensorSet,
    visible: np.ndarray | None = None,
) -> Observation:
    """Run `observe` on `position` (..., T, P, 3) m and world `rotation` (..., T, J, 4).

    `visible` (..., T, P) is the mask of points that the camera sees; sets with a camera need it.
    """
    joints = len(skeleton.joints)
    for name in sensors.rotation:
        if skeleton.index(name) >= joints:
            raise BodysenseError(f"{name!r} is an end site and has no rotation; put the sensor on a joint")
    points = skeleton.points if sensors.camera else sensors.points
    places = skeleton.indices(points)
    has_position = np.zeros((*position.shape[:-2], len(points)), dtype=bool)
    has_rotation = np.zeros_like(has_position)
    has_position[..., [points.index(name) for name in sensors.position]] = True
    has_rotation[..., [points.index(name) for name in sensors.rotation]] = True
    if sensors.camera:
        if visible is None:
            raise BodysenseError("a set with a camera needs the mask of points that it sees; give `visible`")
        has_position |= visible
    turned = rotation[..., np.minimum(places, joints - 1), :]
    inertial = [
        name for name in points if name in INERTIAL_POINTS and name in sensors.rotation and name not in sensors.position
    ]
    acceleration = None
    if inertial and sensors.acceleration:
        acceleration = np.full((*has_position.shape, 3), np.nan)
        felt = sensor_accelerations(position, skeleton.points, inertial, np.asarray(time, dtype=float))
        acceleration[..., [points.index(name) for name in inertial], :] = felt
    return Observation(
        points=points,
        position=np.where(has_position[..., None], position[..., places, :], np.nan),
        rotation=np.where(has_rotation[..., None], quaternion_canonical(turned), np.nan),
        has_position=has_position,
        has_rotation=has_rotation,
        accuracy=accuracy_like(has_position, EXACT_ACCURACY),
        time=np.asarray(time, dtype=float),
        acceleration=acceleration,
    )
