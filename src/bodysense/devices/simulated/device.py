"""Simulated devices, by name: tracking of a motion by headsets, trackers and gloves."""

from __future__ import annotations

from typing import Literal

import numpy as np

from bodysense.body.glove_set import GloveSet
from bodysense.devices.simulated import glove
from bodysense.devices.simulated.camera_ring import CameraRing
from bodysense.devices.simulated.noise import NoiseSettings, disturb
from bodysense.devices.simulated.sensors import SENSOR_SETS, observe
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.observation import Observation

GLOVES = "gloves"  # markers of both gloves in a ring of cameras
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
DeviceName = SensorSetName | Literal["gloves"]
DEVICES: tuple[str, ...] = (*SENSOR_SETS, GLOVES)
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
    if device == GLOVES:
        capture = glove.GloveCapture(CameraRing(), noise=0.0 if rng is None else _GLOVE_NOISE)
        return glove.observe(clip.pose, clip.time, capture, rng, worn)
    sensors = SENSOR_SETS[device]
    observation = observe(clip.pose, clip.time, sensors)
    return observation if rng is None else disturb(observation, rng, NoiseSettings(cameras=sensors.camera))
