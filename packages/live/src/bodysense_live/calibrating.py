"""A calibration second of a session: the wearer's proportions, and how trackers are worn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from bodysense.body.person import Person
from bodysense.body.shape import stature
from bodysense.completion.calibration import Stance, assign_trackers, calibrate
from bodysense.observation import Observation, concatenated_frames
from bodysense_live.inertial import Inertial, has_sensors, stood_still
from bodysense_live.webxr import UNDECIDED

STANDING = 1.0  # s


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The result of a calibration."""

    person: Person | None  # unset without a headset
    worn: Mapping[str, str]  # undecided trackers → the joints that they are on
    inertial: Inertial
    said: tuple[str, ...]  # to the wearer


def is_over(stood: Sequence[Observation]) -> bool:
    """Whether the wearer has stood long enough."""
    return float(stood[-1].time[0] - stood[0].time[0]) >= STANDING


def calibration(
    stood: Sequence[Observation], person: Person, stance: Stance, floor: float, inertial: Inertial
) -> Calibrated:
    """Return the result of a standing second; `person` is the wearer as known before.

    Raises BodysenseError for a wearer who moved, and where neither the head nor an inertial sensor is tracked.
    """
    whole = concatenated_frames(stood)
    inertial = stood_still(whole, person.skeleton, stance, inertial)
    sensors = (f"{len(inertial.worn)} inertial sensors are worn as you stand",) if inertial.worn else ()
    head = whole.points.index("head") if "head" in whole.points else None
    if has_sensors(whole) and (head is None or not whole.has_position[:, head].any()):
        return Calibrated(None, {}, inertial, sensors)
    undecided = [name for name in whole.points if name in UNDECIDED]
    found = assign_trackers(whole, undecided, person, stance) if undecided else {}
    renamed = replace(whole, points=tuple(found.get(name, name) for name in whole.points))
    wearer = calibrate(renamed, person.with_mounts(inertial.mounts), stance, floor)
    height = f"you are {float(stature(wearer.skeleton.rest_offset)):.2f} m tall"
    where = (worn_text(found),) if found else ()
    return Calibrated(wearer, found, inertial, (*where, *sensors, height))


def worn_text(trackers: Mapping[str, str]) -> str:
    """Return a line for the wearer about nameless trackers and the joints that they were found on."""
    return "worn: " + ", ".join(f"{name} on {joint}" for name, joint in trackers.items())
