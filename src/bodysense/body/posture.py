"""Anatomical tables: relaxed pose and range of joints.

A turn is a rotation vector (degrees in the tables, radians outside) in the joint's own rest frame, parent ← joint. In
the T-pose of a left side, palm down, +x runs along the arm and the fingers, +y up, +z forward: elbows bend about −y,
fingers about −z, knees about +x. The right side is the mirror image, (x, −y, −z).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import Skeleton


@dataclass(frozen=True)
class Posture:
    """Anatomy of every joint of a skeleton; joints that the tables do not name are free and rest at zero."""

    relaxed: np.ndarray  # (J, 3) rad, rotation vector of the relaxed joint
    stiffness: np.ndarray  # (J, 3) strength of its pull to the relaxed pose, relative to 1
    low: np.ndarray  # (J, 3) rad, smallest rotation vector component
    high: np.ndarray  # (J, 3) rad, largest


@dataclass(frozen=True)
class _Joint:
    x: tuple[float, float]  # degrees, smallest and largest
    y: tuple[float, float]
    z: tuple[float, float]
    relaxed: tuple[float, float, float] = (0.0, 0.0, 0.0)  # degrees
    stiffness: tuple[float, float, float] = (1.0, 1.0, 1.0)


_HINGE = (3.0, 3.0, 3.0)
_SPINE = _Joint((-20, 35), (-20, 20), (-20, 20))
_THUMB = _Joint((-60, 60), (-60, 60), (-60, 60))
_JOINTS = {
    "spine1": _SPINE,
    "spine2": _SPINE,
    "spine3": _SPINE,
    "neck": _Joint((-40, 40), (-50, 50), (-35, 35), stiffness=(2.0, 2.0, 2.0)),
    "head": _Joint((-45, 45), (-50, 50), (-35, 35)),
    "collar": _Joint((-10, 10), (-30, 30), (-35, 45), stiffness=(10.0, 1.0, 1.0)),
    "shoulder": _Joint((-100, 100), (-140, 60), (-110, 100), relaxed=(0, 0, -60)),
    "elbow": _Joint((-90, 90), (-150, 2), (-30, 75), relaxed=(0, -40, 0), stiffness=_HINGE),
    "wrist": _Joint((-90, 90), (-35, 40), (-80, 75)),
    "hip": _Joint((-125, 30), (-60, 60), (-35, 60), relaxed=(-15, 0, 0)),
    "knee": _Joint((-2, 150), (-15, 15), (-30, 15), relaxed=(30, 0, 0), stiffness=_HINGE),
    "ankle": _Joint((-40, 55), (-35, 50), (-30, 30)),
    "foot": _Joint((-70, 45), (-10, 10), (-10, 10)),
    "thumb1": _THUMB,
    "thumb2": _THUMB,
    "thumb3": _THUMB,
}
for _finger in ("index", "middle", "ring", "pinky"):
    _JOINTS[f"{_finger}1"] = _Joint((-30, 45), (-30, 35), (-105, 45), relaxed=(0, 0, -25))
    _JOINTS[f"{_finger}2"] = _Joint((-15, 15), (-45, 25), (-115, 15), relaxed=(0, 0, -25))
    _JOINTS[f"{_finger}3"] = _Joint((-15, 15), (-60, 30), (-120, 15), relaxed=(0, 0, -25))


def posture(skeleton: Skeleton) -> Posture:
    """Return relaxed posture, stiffness and ranges of a skeleton's joints, by their names.

    The ranges are those of adults in American Academy of Orthopaedic Surgeons, Joint Motion: Method of Measuring and
    Recording, 1965 (elbow 0-150°, pronation and supination 80°, wrist flexion 80° and extension 70°, radial 20° and
    ulnar deviation 30°, hip flexion 120° and extension 30°, knee 0-135°, ankle 20° and 50°, neck 45° and 60°, finger
    joints 90°, 100° and 90°), the turn of spine and neck shared among their joints, and widened to what recorded
    motion contains, because the axes of a fitted skeleton differ from those of the body. They bound single components,
    so a joint may turn further about a slanting axis. Inverse kinematics measures a turn by θ along its axis as
    2 sin(θ/2).
    """
    joints = len(skeleton.joints)
    relaxed, stiffness = np.zeros((joints, 3)), np.ones((joints, 3))
    low, high = np.full((joints, 3), -np.pi), np.full((joints, 3), np.pi)
    for index, name in enumerate(skeleton.joints):
        side, _, rest = name.partition("_")
        row = _JOINTS.get(rest if side in ("left", "right") else name)
        if row is None:
            continue
        bounds = np.radians([row.x, row.y, row.z]).T
        mirror = np.array([1, -1, -1]) if side == "right" else np.ones(3)
        relaxed[index] = np.radians(row.relaxed) * mirror
        stiffness[index] = row.stiffness
        low[index], high[index] = np.sort(bounds * mirror, axis=0)
    return Posture(relaxed, stiffness, low, high)
