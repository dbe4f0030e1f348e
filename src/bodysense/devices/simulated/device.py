"""Simulated devices: tracking of a motion by headsets, trackers, gloves or a custom device."""

from __future__ import annotations

from dataclasses import dataclass
from reprlib import repr as brief
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from bodysense.body.hands.hand import hand_pose
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.errors import BodysenseError, unknown_name
from bodysense.io.clip import Clip
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import Observation
from bodysense.observing.points import joined_points

if TYPE_CHECKING:
    from bodysense.body.hands.glove_set import GloveSet

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
    "mocopi_six",
    "dip_six",
    "imu_seventeen",
    "slimevr_five",
    "slimevr_six",
    "slimevr_eight",
    "headset_slimevr_five",
    "headset_slimevr_six",
    "headset_slimevr_eight",
]
DeviceName = SensorSetName | Literal["gloves", "gloves_imu"]
_GLOVE_NOISE = 0.0005  # m along each axis, noise of markers in optical capture


class Device(Protocol):
    """A device that observes a motion."""

    def observe(self, clip: Clip, rng: np.random.Generator | None) -> Observation:
        """Return the points that the device tracks in each frame of a clip, without errors if `rng` is None.

        Points are joints and end sites of the body by name, in the world (+Y up, metres, seconds).
        """
        ...


@dataclass(frozen=True)
class BodySensors:
    """A set of sensors on the body."""

    sensors: SensorSet

    def observe(self, clip: Clip, rng: np.random.Generator | None) -> Observation:
        """Return the points of the set, with the errors of real devices if `rng` is given."""
        observation = observe(clip.pose, clip.time, self.sensors)
        if rng is None:
            return observation
        from bodysense.devices.simulated.noise import NoiseSettings, disturb

        return disturb(observation, rng, NoiseSettings(cameras=self.sensors.camera))


@dataclass(frozen=True, eq=False)
class MarkerGloves:
    """Marker gloves on both hands in a ring of cameras."""

    marker_set: GloveSet | None = None  # marker set; None: the standard one

    def observe(self, clip: Clip, rng: np.random.Generator | None) -> Observation:
        """Return the markers that cameras see, with the noise of optical capture if `rng` is given."""
        from bodysense.devices.simulated import glove
        from bodysense.devices.simulated.camera_ring import CameraRing

        capture = glove.GloveCapture(CameraRing(), noise=0.0 if rng is None else _GLOVE_NOISE)
        return glove.observe(clip.pose, clip.time, capture, rng, self.marker_set)


@dataclass(frozen=True, eq=False)
class InertialGloves:
    """Marker gloves with an inertial sensor on every segment of the fingers."""

    marker_set: GloveSet | None = None  # marker set; None: the standard one

    def observe(self, clip: Clip, rng: np.random.Generator | None) -> Observation:
        """Return markers that cameras see and rotations of sensors, with noise and drift if `rng` is given."""
        from bodysense.devices.simulated import glove_imu

        markers = MarkerGloves(self.marker_set).observe(clip, rng)
        hands = {side: hand_pose(clip.pose, side) for side in ("left", "right")}
        return joined_points(markers, glove_imu.observe_fingers(hands, clip.time, rng))


_BY_NAME: dict[str, Device] = {
    **{name: BodySensors(sensors) for name, sensors in SENSOR_SETS.items()},
    "gloves": MarkerGloves(),
    "gloves_imu": InertialGloves(),
}
DEVICES = tuple(_BY_NAME)


def simulate(clip: Clip, device: str | Device, noise: int | None = None) -> Observation:
    """Simulate the tracking of a clip by a device.

    Args:
        clip: the motion, on the default skeleton of 65 points.
        device: one of `DEVICES`, or an object with the method `observe` of `Device`.
        noise: random seed of realistic errors; None for exact tracking.

    Raises BodysenseError for an unknown device, and if the device returns a malformed observation.
    """
    if not isinstance(clip, Clip):
        raise BodysenseError(f"simulate: {brief(clip)} is no motion; give a Clip, as read('walk.bvh') returns")
    if isinstance(device, str):
        if device not in _BY_NAME:
            raise BodysenseError(f"unknown device {device!r}; {unknown_name(device, DEVICES)}")
        device = _BY_NAME[device]
    if not callable(getattr(device, "observe", None)):
        raise BodysenseError(
            f"device {device!r} has no method observe(clip, rng); add one, or give one of {', '.join(DEVICES)}"
        )
    name = type(device).__name__
    observation = device.observe(clip, None if noise is None else np.random.default_rng(noise))
    if len(observation) != len(clip):
        raise BodysenseError(
            f"device {name}: its observation has {len(observation)} frames, the clip {len(clip)}; return one for each"
        )
    return check_observation(observation, f"device {name}")
