"""Sensor sets: they observe their own points exactly, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.inertial import ALONG, SMOOTHING
from bodysense.devices.simulated.sensing import observe, observe_points
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense.observing.checks import check_observation

SKELETON = default_skeleton()


@pytest.mark.parametrize("name", SENSOR_SETS)
def test_sets_observe_their_points_exactly(waving_clip: Clip, name: str) -> None:
    sensors, batch = SENSOR_SETS[name], (2,)
    pose = Pose(
        SKELETON,
        np.broadcast_to(waving_clip.pose.root_position, (*batch, 90, 3)),
        np.broadcast_to(waving_clip.pose.rotation, (*batch, 90, 52, 4)),
    )
    seen = check_observation(observe(pose, waving_clip.time, sensors))
    position, rotation = forward_kinematics(pose)
    for k, point in enumerate(seen.points):
        place = SKELETON.index(point)
        known = seen.has_position[..., k]
        np.testing.assert_array_equal(seen.position[..., k, :][known], position[..., place, :][known])
        assert sensors.camera or known.all() == (point in sensors.position)
        assert seen.has_rotation[..., k].all() == seen.has_rotation[..., k].any() == (point in sensors.rotation)
        if point in sensors.rotation:
            assert geodesic_angle(seen.rotation[..., k, :], rotation[..., place, :]).max() < 1e-7
    assert np.isnan(seen.position[~seen.has_position]).all() and np.isnan(seen.rotation[~seen.has_rotation]).all()


def test_named_sets_have_their_points() -> None:
    count = {"head": 1, "three_point": 3, "four_point": 4, "six_point": 6, "ten_point": 11}
    assert {name: len(SENSOR_SETS[name].position) for name in count} == count
    assert set(SENSOR_SETS["three_point_imu_feet"].rotation) - set(SENSOR_SETS["three_point"].rotation) == {
        "left_knee",
        "right_knee",
    }
    feet, pelvis = (SENSOR_SETS[name] for name in ("three_point_imu_feet", "three_point_imu_feet_pelvis"))
    assert pelvis.position == feet.position and set(pelvis.rotation) - set(feet.rotation) == {"pelvis"}


def test_bad_sets_are_refused(waving_clip: Clip) -> None:
    position, rotation = forward_kinematics(waving_clip.pose)
    with pytest.raises(BodysenseError, match="'left_toe' is an end site and has no rotation"):
        observe(waving_clip.pose, waving_clip.time, SensorSet((), ("left_toe",)))
    with pytest.raises(BodysenseError, match="unknown joint 'nose'"):
        observe(waving_clip.pose, waving_clip.time, SensorSet(("nose",), ()))
    with pytest.raises(BodysenseError, match="give `visible`"):
        observe_points(SKELETON, position, rotation, waving_clip.time, SENSOR_SETS["headset_camera"])


def test_sensors_with_rotation_only_measure_acceleration(waving_clip: Clip) -> None:
    """Accelerations depend on earlier frames only: removing later ones does not change them."""
    pose, time = waving_clip.pose, waving_clip.time
    sensors = SensorSet(("head", "left_elbow"), ("head", "left_elbow", "right_elbow", "pelvis"))
    felt = observe(pose, time, sensors).acceleration
    assert felt is not None
    names = sensors.points
    assert np.isnan(felt[:, [names.index("head"), names.index("left_elbow")]]).all()
    position = forward_kinematics(pose)[0]
    elbow, wrist = (position[:, SKELETON.index(f"right_{name}")] for name in ("elbow", "wrist"))
    place, lag = elbow + ALONG * (wrist - elbow), round(SMOOTHING * waving_clip.frame_rate)
    wanted = np.diff(np.diff(place[::lag], axis=0), axis=0) * (waving_clip.frame_rate / lag) ** 2
    np.testing.assert_allclose(felt[2 * lag :: lag, names.index("right_elbow")], wanted, atol=1e-6)
    assert np.isnan(felt[: 2 * lag]).all() and np.abs(wanted).max() > 1
    part = observe(pose[:40], time[:40], sensors).acceleration
    assert part is not None
    np.testing.assert_allclose(part, felt[:40], atol=1e-9)
    assert observe(pose, time, SENSOR_SETS["six_point"]).acceleration is None
