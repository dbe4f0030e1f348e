"""Simulated devices, by name: tracking of a motion by headsets, trackers and gloves."""

from __future__ import annotations

from typing import Literal

import numpy as np

from bodysense.body.glove_set import GloveSet
from bodysense.body.hand import hand_pose
from bodysense.devices.simulated import glove, glove_imu
from bodysense.devices.simulated.camera_ring import CameraRing
from bodysense.devices.simulated.noise import NoiseSettings, disturb
from bodysense.devices.simulated.sensors import SENSOR_SETS, observe
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.observation import Observation

GLOVES = "gloves"  # markers of both gloves in a ring of cameras
GLOVES_IMU = "gloves_imu"  # the same, with an inertial sensor on every segment of the fingers
SensorSetName = Literal[
    "head",
    "three_point",
    "three_point_imu_feet",
    "four_point",
    "six_point",
    "ten_point",
    "headset_camera",
    "three_point_imu_shoes",
    "three_point_imu_legs",
]
DeviceName = SensorSetName | Literal["gloves", "gloves_imu"]
DEVICES: tuple[str, ...] = (*SENSOR_SETS, GLOVES, GLOVES_IMU)
_GLOVE_NOISE = 0.0005  # m along each axis: markers of optical capture


def simulate(clip: Clip, device: str, noise: int | None = None, worn: GloveSet | None = None) -> Observation:
    """Simulate the tracking of a clip by a device.

    Args:
        clip: the motion, on the skeleton of 65 points.
        device: one of `DEVICES`.
        noise: random seed of realistic errors; None tracks exactly.
        worn: marker set of the gloves; the standard one if omitted.

    Raises BodysenseError for an unknown device.
    """
    if device not in DEVICES:
        raise BodysenseError(f"unknown device {device!r}; valid are {', '.join(DEVICES)}")
    rng = None if noise is None else np.random.default_rng(noise)
    if device in (GLOVES, GLOVES_IMU):
        capture = glove.GloveCapture(CameraRing(), noise=0.0 if rng is None else _GLOVE_NOISE)
        markers = glove.observe(clip.pose, clip.time, capture, rng, worn)
        if device == GLOVES:
            return markers
        hands = {side: hand_pose(clip.pose, side) for side in ("left", "right")}
        return glove_imu.joined(markers, glove_imu.observe_fingers(hands, clip.time, rng))
    sensors = SENSOR_SETS[device]
    observation = observe(clip.pose, clip.time, sensors)
    return observation if rng is None else disturb(observation, rng, NoiseSettings(cameras=sensors.camera))
