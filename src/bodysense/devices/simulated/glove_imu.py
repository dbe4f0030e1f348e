"""Inertial sensors of gloves: one on the back of each hand, one on every segment of a finger (two-hands, section 2.1).

A sensor has a rotation and no position. The sizes of all errors are assumptions. Headings drift about the vertical as
those of the IMUs in `noise`, and also at a constant rate since the calibration, as with the bias of a gyroscope without
a magnetometer. Gravity corrects the tilt. Straps shift once per session. The rest is white noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.hands.glove import side_of
from bodysense.body.hands.hand import HAND_JOINTS, mirrored_rotations
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.devices.simulated.noise import NoiseSettings, disturb
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_canonical, quaternion_exp, quaternion_multiply
from bodysense.observing.observation import EXACT_ACCURACY, Observation, accuracy_like

_UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class GloveImuNoise:
    """Errors of a glove's inertial sensors, as standard deviations; sensors have independent errors."""

    heading: float = 3.0  # °, with the correlation time `NoiseSettings.imu_time`
    tilt: float = 0.7  # °, with the same correlation time
    drift: float = 0.1  # °/s of heading since the calibration, drawn for a session
    session_age: float = 60.0  # s from the calibration to the first frame
    strap: float = 2.0  # ° about each axis of the segment, drawn for a session
    white: float = 0.2  # ° about each axis

    def __post_init__(self) -> None:
        for name in ("heading", "tilt", "drift", "session_age", "strap", "white"):
            if not 0 <= getattr(self, name) < np.inf:
                raise BodysenseError(f"glove IMUs: {name} is {getattr(self, name):g}; give 0 or more")


def observe_fingers(
    hands: Mapping[str, Pose],
    time: np.ndarray,
    rng: np.random.Generator | None = None,
    noise: GloveImuNoise = GloveImuNoise(),
) -> Observation:
    """Return the sensors of hands (T, …) by name at `time` (T,) s.

    Each hand is a left one in its own mirrored world (`body.hand`). Points are joints without positions:
    'left_wrist', 'left_thumb1' … Rotations are exact without `rng`.
    """
    rotation = np.concatenate(
        [mirrored_rotations(np.asarray(forward_kinematics(pose)[1]), side_of(name)) for name, pose in hands.items()],
        axis=-2,
    )
    known = np.ones(rotation.shape[:-1], dtype=bool)
    sensors = Observation(
        points=tuple(f"{name}_{joint}" for name in hands for joint in HAND_JOINTS),
        position=np.full((*known.shape, 3), np.nan),
        rotation=rotation,
        has_position=~known,
        has_rotation=known,
        accuracy=accuracy_like(known, EXACT_ACCURACY),
        time=np.asarray(time, dtype=float),
    )
    return sensors if rng is None else add_errors(sensors, noise, rng)


def add_errors(sensors: Observation, noise: GloveImuNoise, rng: np.random.Generator) -> Observation:
    """Add errors to the rotations of sensors (T, P); times do not change."""
    usual = NoiseSettings(imu_heading=noise.heading, imu_tilt=noise.tilt, scale=0.0, stamp_jitter=0.0)
    world = np.asarray(disturb(sensors, rng, usual).rotation)
    count, age = len(sensors.points), noise.session_age + sensors.time - sensors.time[0]
    heading = np.radians(noise.drift) * rng.standard_normal(count) * age[:, None]
    strap = np.radians(noise.strap) * rng.standard_normal((count, 3))
    white = np.radians(noise.white) * rng.standard_normal((len(age), count, 3))
    rotation = quaternion_multiply(quaternion_exp(heading[..., None] * _UP), world)
    rotation = quaternion_multiply(rotation, quaternion_exp(strap + white))
    return replace(sensors, rotation=np.asarray(quaternion_canonical(rotation)))
