"""Calibration while the wearer stands for a second: proportions, tracker joints and sensor mounts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from bodysense.body.person import Person
from bodysense.body.shape import stature
from bodysense.observing.observation import Observation
from bodysense.observing.points import concatenated_frames
from bodysense.tracking.calibration import Stance, assign_trackers, calibrate
from bodysense_live.protocols.webxr import UNASSIGNED
from bodysense_live.sessions.inertial import InertialSensors, calibrate_sensors, has_sensors

STANDING = 1.0  # s of frames that a calibration uses


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """The result of a calibration."""

    person: Person | None  # missing without a headset
    tracker_joints: Mapping[str, str]  # unassigned trackers → the joints that they are worn on
    inertial: InertialSensors
    notices: tuple[str, ...]  # lines for the wearer


def is_long_enough(standing: Sequence[Observation]) -> bool:
    """Return whether the frames span a whole calibration."""
    return float(standing[-1].time[0] - standing[0].time[0]) >= STANDING


def calibrate_standing(
    standing: Sequence[Observation], person: Person, stance: Stance, floor: float, inertial: InertialSensors
) -> CalibrationResult:
    """Calibrate with frames in which the wearer stands; `person` is the wearer as known before.

    Raises BodysenseError if the wearer moved, or if neither the head nor an inertial sensor is tracked.
    """
    whole = concatenated_frames(standing)
    inertial = calibrate_sensors(whole, person.skeleton, stance, inertial)
    sensors = (f"{len(inertial.sensors)} inertial sensors are worn as you stand",) if inertial.sensors else ()
    head = whole.points.index("head") if "head" in whole.points else None
    if has_sensors(whole) and (head is None or not whole.has_position[:, head].any()):
        return CalibrationResult(None, {}, inertial, sensors)
    unassigned = [name for name in whole.points if name in UNASSIGNED]
    joints = assign_trackers(whole, unassigned, person, stance) if unassigned else {}
    renamed = replace(whole, points=tuple(joints.get(name, name) for name in whole.points))
    wearer = calibrate(renamed, person.with_mounts(inertial.mounts), stance, floor)
    height = f"you are {float(stature(wearer.skeleton.rest_offset)):.2f} m tall"
    where = (assignment_text(joints),) if joints else ()
    return CalibrationResult(wearer, joints, inertial, (*where, *sensors, height))


def assignment_text(tracker_joints: Mapping[str, str]) -> str:
    """Return a line for the wearer that lists trackers and their joints."""
    return "worn: " + ", ".join(f"{name} on {joint}" for name, joint in tracker_joints.items())
