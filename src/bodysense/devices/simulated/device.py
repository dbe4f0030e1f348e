"""Simulated devices: tracking of a motion by headsets, trackers and gloves, or by a device of one's own."""

from __future__ import annotations

from dataclasses import dataclass
from reprlib import repr as brief
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from bodysense.body.hand import hand_pose
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet, observe
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.observation import Observation, check_observation, joined_points

if TYPE_CHECKING:
    from bodysense.body.glove_set import GloveSet

SensorSetName = Literal[
    "head",
    "three_point",
    "three_point_imu_feet",
    "three_point_imu_feet_pelvis",
    "four_point",
    "six_point",
    "ten_point",
    "headset_camera",
    "three_point_imu_shoes",
    "three_point_imu_legs",
]
DeviceName = SensorSetName | Literal["gloves", "gloves_imu"]
_GLOVE_NOISE = 0.0005  # m along each axis: markers of optical capture


class Device(Protocol):
    """A device that watches a motion."""

    def observe(self, clip: Clip, rng: np.random.Generator | None) -> Observation:
        """Return what the device tracks in each frame of a clip, without errors if `rng` is None.

        Points are joints and end sites of the body by name, in the world (+Y up, metres, seconds).
        """
        ...


@dataclass(frozen=True)
class WornSensors:
    """A set of sensors on the body."""

    sensors: SensorSet

    def observe(self, clip: Clip, rng: np.random.Generator | None) -> Observation:
        """Return the points of the set; with `rng` as real devices track them."""
        observation = observe(clip.pose, clip.time, self.sensors)
        if rng is None:
            return observation
        from bodysense.devices.simulated.noise import NoiseSettings, disturb

        return disturb(observation, rng, NoiseSettings(cameras=self.sensors.camera))


@dataclass(frozen=True, eq=False)
class MarkerGloves:
    """Markers of both gloves in a ring of cameras."""

    marker_set: GloveSet | None = None  # marker set; None: the standard one

    def observe(self, clip: Clip, rng: np.random.Generator | None) -> Observation:
        """Return the markers that cameras see; with `rng` with the noise of optical capture."""
        from bodysense.devices.simulated import glove
        from bodysense.devices.simulated.camera_ring import CameraRing

        capture = glove.GloveCapture(CameraRing(), noise=0.0 if rng is None else _GLOVE_NOISE)
        return glove.observe(clip.pose, clip.time, capture, rng, self.marker_set)


@dataclass(frozen=True, eq=False)
class InertialGloves:
    """Marker gloves with an inertial sensor on every segment of the fingers."""

    marker_set: GloveSet | None = None  # marker set; None: the standard one

    def observe(self, clip: Clip, rng: np.random.Generator | None) -> Observation:
        """Return markers that cameras see and rotations of sensors; with `rng` with noise and drift."""
        from bodysense.devices.simulated import glove_imu

        markers = MarkerGloves(self.marker_set).observe(clip, rng)
        hands = {side: hand_pose(clip.pose, side) for side in ("left", "right")}
        return joined_points(markers, glove_imu.observe_fingers(hands, clip.time, rng))


_BY_NAME: dict[str, Device] = {
    **{name: WornSensors(sensors) for name, sensors in SENSOR_SETS.items()},
    "gloves": MarkerGloves(),
    "gloves_imu": InertialGloves(),
}
DEVICES = tuple(_BY_NAME)


def simulate(clip: Clip, device: str | Device, noise: int | None = None) -> Observation:
    """Simulate the tracking of a clip by a device.

    Args:
        clip: the motion, on the skeleton of 65 points.
        device: one of `DEVICES`, or an object with a method `observe`, as `Device` has it.
        noise: random seed of realistic errors; None tracks exactly.

    Raises BodysenseError for an unknown device, and for a device whose observation is not well formed.
    """
    if not isinstance(clip, Clip):
        raise BodysenseError(f"simulate: {brief(clip)} is no motion; give a Clip, as read('walk.bvh') returns")
    if isinstance(device, str):
        if device not in _BY_NAME:
            raise BodysenseError(f"unknown device {device!r}; valid are {', '.join(DEVICES)}")
        device = _BY_NAME[device]
    if not callable(getattr(device, "observe", None)):
        raise BodysenseError(
            f"device {device!r} has no method observe(clip, rng); give one that has, or one of {', '.join(DEVICES)}"
        )
    name = type(device).__name__
    observation = device.observe(clip, None if noise is None else np.random.default_rng(noise))
    if len(observation) != len(clip):
        raise BodysenseError(
            f"device {name}: its observation has {len(observation)} frames, the clip {len(clip)}; give one each"
        )
    return check_observation(observation, f"device {name}")
