"""Tilt and roll of a camera, inferred from an upright person: from feet to shoulders, or from a sitting person's trunk.

The tilt is the angle by which the camera looks down, the roll the angle about its view axis. Landmarks are corrected
for the roll first, because networks of bodies are trained on level cameras.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.arms import SIDES
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks
from bodysense.devices.video.posture_constants import (
    ENOUGH,
    LONGEST_ANGLE,
    LONGEST_MEAN,
    MOST_ROLLED,
    STEEPEST,
    SWAY,
    TRUNK_SHARE,
    UPRIGHT,
    VISIBLE,
)

_PARTS = ("shoulder", "hip", "knee", "ankle")
_MARKS = np.array([[BODY_LANDMARKS.index(f"{side}_{part}") for side in SIDES] for part in _PARTS])


@dataclass(frozen=True)
class CameraLevel:
    """Mean angles of a standing person and the time of standing; the tilt of a sitting person's trunk and that time."""

    tilt: float = 0.0  # rad by which the camera looks down
    roll: float = 0.0  # rad by which upright things lean to the right in the picture
    stood: float = 0.0  # s, time of standing so far, at most 10
    time: float = -np.inf  # s, time of the last frame that counted
    trunk: float = 0.0  # rad by which the camera looks down if the sitting person's trunk is upright
    sat: float = 0.0  # s, time of sitting so far, at most 10

    def step(self, person: PersonLandmarks, is_seated: bool = False) -> CameraLevel:
        """Return the level after a frame of unprocessed landmarks; it is unchanged unless the body is upright."""
        if is_seated:
            return self._sit(person)
        up = _upright(person)
        if up is None:
            return self
        time = float(person.time[0])
        elapsed = min(time - self.time, LONGEST_ANGLE)
        share = 1.0 if not self.stood else elapsed / (self.stood + elapsed)
        tilt, roll = np.arctan2(up[2], np.hypot(up[0], up[1])), np.arctan2(up[0], up[1])
        return replace(
            self,
            tilt=self.tilt + share * (float(tilt) - self.tilt),
            roll=self.roll + share * (float(roll) - self.roll),
            stood=min(self.stood + elapsed, LONGEST_MEAN),
            time=time,
        )

    def _sit(self, person: PersonLandmarks) -> CameraLevel:
        """Return the level after one more frame of a sitting person."""
        if not person.has_body[0] or person.visible[0, _MARKS[0]].min() < VISIBLE:
            return self
        shoulders, hips = person.world[0, _MARKS[:2]].mean(axis=1)
        up = shoulders - hips
        tilt, time = float(np.arctan2(up[2], np.hypot(up[0], up[1]))), float(person.time[0])
        if up[1] <= 0 or abs(tilt) > np.radians(STEEPEST):
            return self
        elapsed = min(time - self.time, LONGEST_ANGLE)
        share = 1.0 if not self.sat else elapsed / (self.sat + elapsed)
        trunk = self.trunk + share * (tilt - self.trunk)
        return replace(self, trunk=trunk, sat=min(self.sat + elapsed, LONGEST_MEAN), time=time)

    @property
    def likely_tilt(self) -> float:
        """rad: the tilt of the camera, from the time of standing if there was any, and from the trunk."""
        share = self.stood / (self.stood + ENOUGH) if self.sat else 1.0
        return share * self.tilt + (1 - share) * TRUNK_SHARE * self.trunk

    @property
    def likely_roll(self) -> float:
        """rad: the roll, reduced if it is within people's sway."""
        return self.roll**3 / (self.roll**2 + np.radians(SWAY) ** 2)


def tilt_matrix(tilt: float) -> np.ndarray:
    """Return (3, 3) room ← upright camera that looks down by `tilt` rad."""
    cosine, sine = np.cos(tilt), np.sin(tilt)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, sine], [0.0, -sine, cosine]])


def roll_matrix(roll: float) -> np.ndarray:
    """Return (3, 3) upright camera ← camera in whose picture upright things lean to the right by `roll` rad."""
    cosine, sine = np.cos(roll), np.sin(roll)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def remove_roll(person: PersonLandmarks, roll: float) -> PersonLandmarks:
    """Return landmarks as seen by an upright camera in the same place."""
    turn = roll_matrix(roll)
    flat = turn[:2, :2]
    return replace(
        person,
        world=person.world @ turn.T,
        picture=person.picture @ flat.T,
        hand=person.hand @ flat.T,
        hand_world=person.hand_world @ turn.T,
    )


def _upright(person: PersonLandmarks) -> np.ndarray | None:
    """Return the unit vector (3,) from feet to shoulders in the camera's axes; None unless the body stands or walks."""
    if not person.has_body[0] or person.visible[0, _MARKS].min() < VISIBLE:
        return None
    joints = person.world[0, _MARKS]  # (part, side, 3)
    bones = [*(joints[1] - joints[2]), *(joints[2] - joints[3]), (joints[0] - joints[1]).mean(axis=0)]
    up = joints[0].mean(axis=0) - joints[3].mean(axis=0)
    up = up / max(float(np.linalg.norm(up)), 1e-9)
    straight = min(float(bone @ up) / max(float(np.linalg.norm(bone)), 1e-9) for bone in bones)
    level = abs(np.arctan2(up[2], np.hypot(up[0], up[1]))) < np.radians(STEEPEST) and abs(
        np.arctan2(up[0], up[1])
    ) < np.radians(MOST_ROLLED)
    return up if straight > np.cos(np.radians(UPRIGHT)) and level else None
