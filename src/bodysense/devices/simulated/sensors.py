"""Sensor sets: tracked points of a body, and commercial sets.

A sensor is on a joint and gives its position, its rotation or both. A sensor strapped to a bone counts as one on the
joint at the start of the bone: the shin turns with the knee, the chest is `spine3`. A sensor with rotation only is
inertial and also gives its acceleration (`inertial`).
"""

from __future__ import annotations

from dataclasses import dataclass

WRISTS = ("left_wrist", "right_wrist")


@dataclass(frozen=True)
class SensorSet:
    """Points that are tracked in every frame; with `camera` also the positions that a headset's cameras see."""

    position: tuple[str, ...]  # points with a position
    rotation: tuple[str, ...]  # points with a rotation
    camera: bool = False  # headset_camera
    acceleration: bool = True  # sensors with rotation only give accelerations, too

    @property
    def points(self) -> tuple[str, ...]:
        """The points that are tracked in every frame."""
        return tuple(dict.fromkeys((*self.position, *self.rotation)))


def _posed(*names: str) -> SensorSet:
    """Return a set with position and rotation of some points."""
    return SensorSet(names, names)


def _pair(name: str) -> tuple[str, str]:
    return (f"left_{name}", f"right_{name}")


def _turned(*names: str) -> SensorSet:
    """Return a set of inertial sensors, which have no position."""
    return SensorSet((), names)


def _with_headset(sensors: SensorSet) -> SensorSet:
    """Return a set with the pose of a headset in addition."""
    return SensorSet(("head", *sensors.position), ("head", *sensors.rotation))


THREE_POINTS = ("head", *WRISTS)  # of a headset and two controllers
_SIX = (*THREE_POINTS, "pelvis", *_pair("ankle"))
THREE_POINT = _posed(*THREE_POINTS)
HEADSET_CAMERA = SensorSet(("head",), ("head",), camera=True)
# Inertial trackers of SlimeVR: chest, thighs and shins; then the hip; then the feet.
_SLIMEVR_FIVE = _turned("spine3", *_pair("hip"), *_pair("knee"))
_SLIMEVR_SIX = _turned(*_SLIMEVR_FIVE.rotation, "pelvis")
_SLIMEVR_EIGHT = _turned(*_SLIMEVR_SIX.rotation, *_pair("ankle"))
# Inertial suits. Sensors on forearms and shins turn with the elbow and the knee.
INERTIAL_SETS = {
    "mocopi_six": _turned("head", "pelvis", *WRISTS, *_pair("ankle")),
    "dip_six": _turned("head", "pelvis", *_pair("elbow"), *_pair("knee")),
    "imu_seventeen": _turned(
        *("pelvis", "spine3", "head"),
        *(side for part in ("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle") for side in _pair(part)),
    ),
    "slimevr_five": _SLIMEVR_FIVE,
    "slimevr_six": _SLIMEVR_SIX,
    "slimevr_eight": _SLIMEVR_EIGHT,
    "headset_slimevr_five": _with_headset(_SLIMEVR_FIVE),
    "headset_slimevr_six": _with_headset(_SLIMEVR_SIX),
    "headset_slimevr_eight": _with_headset(_SLIMEVR_EIGHT),
}
SENSOR_SETS = {
    "head": _posed("head"),
    "three_point": THREE_POINT,
    # Commercial sets of two IMUs strapped above the ankles turn with the shins; a third one is on the hip.
    "three_point_imu_feet": SensorSet(THREE_POINTS, (*THREE_POINTS, *_pair("knee"))),
    "three_point_imu_feet_pelvis": SensorSet(THREE_POINTS, (*THREE_POINTS, *_pair("knee"), "pelvis")),
    "four_point": _posed(*THREE_POINTS, "pelvis"),
    "six_point": _posed(*_SIX),
    "ten_point": _posed(*_SIX, "spine3", *_pair("elbow"), *_pair("knee")),
    "headset_camera": HEADSET_CAMERA,
    # In addition to the sets of the tables: IMUs in the shoes, and on shins and shoes.
    "three_point_imu_shoes": SensorSet(THREE_POINTS, (*THREE_POINTS, *_pair("ankle"))),
    "three_point_imu_legs": SensorSet(THREE_POINTS, (*THREE_POINTS, *_pair("knee"), *_pair("ankle"))),
    **INERTIAL_SETS,
}
