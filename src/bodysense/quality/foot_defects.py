"""Defects of feet: standing feet that slide, and feet through the floor.

Thresholds are chosen on training and validation people of CMU and Rocketbox (`bodysense evaluate repair`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.footing import side_clearance
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.geometry.gaps import runs
from bodysense.geometry.rotation import geodesic_angle

Found = tuple[str, int, int, float]  # joint, first and last frame, size

LOW = 0.025  # m above the foot's usual lowest height: a foot this low may stand
LEVEL, RISING = 0.045, 0.1  # m/s; a sliding foot, and one that stands, rise and fall more slowly
TURNING = 0.3  # rad/s; a sliding foot turns more slowly, else a dancer turns on it
SLIDE, SWING = 0.13, 0.8  # m/s; a slower foot stands, a faster one swings
LONGEST_GAP = 0.07  # s; shorter interruptions of a slide are part of it
SHORTEST = 0.2  # s of a slide
SUNKEN = 0.06  # m below the usual floor
USUAL = 25.0  # percentile of the clearance that is the usual floor, if it is below 0
LOWEST = 5.0  # percentile of the clearance that is the foot's usual lowest height


def slides(pose: Pose, frame_rate: float) -> list[Found]:
    """Return feet, by their ankles, that stand and slide; sizes in cm/s."""
    found: list[Found] = []
    for side in ("left", "right"):
        motion = foot_motion(pose, frame_rate, side)
        for first, end in runs(_sliding(motion, frame_rate)):
            found.append((f"{side}_ankle", first, end - 1, 100 * float(motion.along[first:end].mean())))
    return found


def _sliding(foot: FootMotion, rate: float) -> np.ndarray:
    """Return (T,) bool: a foot stands, keeps its direction, and slides."""
    slide = (foot.height < LOW) & (foot.up < LEVEL) & (foot.turning < TURNING)
    slide &= (foot.along > SLIDE) & (foot.along < SWING)
    for first, end in runs(~slide):
        if first > 0 and end < len(slide) and (end - first) / rate <= LONGEST_GAP:
            slide[first:end] = True
    for first, end in runs(slide):
        if (end - first) / rate < SHORTEST:
            slide[first:end] = False
    return slide


@dataclass(frozen=True, eq=False)
class FootMotion:
    """How a foot moves over the floor; arrays (T,)."""

    height: np.ndarray  # m of its lowest point over its usual lowest height
    along: np.ndarray  # m/s along the floor, of the slowest of ankle, ball and toe
    up: np.ndarray  # m/s upward or downward, of the fastest of them
    turning: np.ndarray  # rad/s

    @property
    def stands(self) -> np.ndarray:
        """(T,) bool: the foot is low and level, so that it stands or slides."""
        return (self.height < LOW) & (self.up < RISING) & (self.along < SWING)


def foot_motion(pose: Pose, frame_rate: float, side: str) -> FootMotion:
    """Return the motion of the foot of a side, 'left' or 'right'."""
    place, turn = (np.asarray(part) for part in forward_kinematics(pose))
    skeleton, frames = pose.skeleton, len(pose.root_position)
    points = place[:, [skeleton.index(f"{side}_{part}") for part in ("ankle", "foot", "toe")]]
    velocity = np.gradient(points, axis=0) * frame_rate if frames > 1 else np.zeros_like(points)
    ankle, turning = turn[:, skeleton.index(f"{side}_ankle")], np.zeros(frames)
    turning[1:] = geodesic_angle(ankle[1:], ankle[:-1]) * frame_rate
    clearance = side_clearance(place, skeleton, side)
    return FootMotion(
        height=clearance - np.percentile(clearance, LOWEST),
        along=np.linalg.norm(velocity[..., [0, 2]], axis=-1).min(axis=1),
        up=np.abs(velocity[..., 1]).max(axis=1),
        turning=turning,
    )


def sunken_feet(pose: Pose, frame_rate: float) -> list[Found]:
    """Return feet, by their ankles, that are through the floor; sizes in cm."""
    place, found = np.asarray(forward_kinematics(pose)[0]), list[Found]()
    floor = min(0.0, *(np.percentile(side_clearance(place, pose.skeleton, s), USUAL) for s in ("left", "right")))
    for side in ("left", "right"):
        depth = floor - side_clearance(place, pose.skeleton, side)
        for first, end in runs(depth > SUNKEN):
            found.append((f"{side}_ankle", first, end - 1, 100 * float(depth[first:end].max())))
    return found
