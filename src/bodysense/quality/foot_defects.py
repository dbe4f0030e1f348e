"""Defects of feet: standing feet that slide, and feet through the floor.

Thresholds are chosen on validation people of CMU and Rocketbox (`bodysense evaluate repair`).
"""

from __future__ import annotations

import numpy as np

from bodysense.body.footing import side_clearance
from bodysense.body.gaps import runs
from bodysense.body.pose import forward_kinematics
from bodysense.io.clip import Clip

Found = tuple[str, int, int, float]  # joint, first and last frame, size

LOW = 0.025  # m above the foot's usual lowest height: a foot this low may stand
LEVEL = 0.06  # m/s; a standing foot rises and falls more slowly
SLIDE, SWING = 0.10, 0.8  # m/s; a slower foot stands, a faster one swings
LONGEST_GAP = 0.07  # s; shorter interruptions of a slide are part of it
SHORTEST = 0.2  # s of a slide
SUNKEN = 0.04  # m below the usual floor
LOWEST = 5.0  # percentile of the clearance that is the foot's usual lowest height


def slides(clip: Clip) -> list[Found]:
    """Return feet, by their ankles, that stand and slide; sizes in cm/s."""
    place = np.asarray(forward_kinematics(clip.pose)[0])
    found: list[Found] = []
    for side in ("left", "right"):
        for first, end in runs(sliding(clip, place, side)):
            speed = _speed(clip, place, side)[0][first:end].mean()
            found.append((f"{side}_ankle", first, end - 1, 100 * float(speed)))
    return found


def sliding(clip: Clip, place: np.ndarray, side: str) -> np.ndarray:
    """Return (T,) bool: the foot of a side stands and slides; `place` (T, P, 3) m are the clip's points."""
    along, stands = _speed(clip, place, side)[0], standing(clip, place, side)
    slide = stands & (along > SLIDE)
    for first, end in runs(~slide):
        if first > 0 and end < len(slide) and (end - first) / clip.frame_rate <= LONGEST_GAP:
            slide[first:end] = True
    for first, end in runs(slide):
        if (end - first) / clip.frame_rate < SHORTEST:
            slide[first:end] = False
    return slide


def standing(clip: Clip, place: np.ndarray, side: str) -> np.ndarray:
    """Return (T,) bool: the foot of a side is low and level, so that it stands or slides, or just swings past."""
    clearance = side_clearance(place, clip.pose.skeleton, side)
    along, up = _speed(clip, place, side)
    is_low = clearance - np.percentile(clearance, LOWEST) < LOW
    return is_low & (np.abs(up) < LEVEL) & (along < SWING)


def _speed(clip: Clip, place: np.ndarray, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Return speeds (T,) m/s: along the floor, the slower of ankle and ball, and upward, of the ball."""
    skeleton = clip.pose.skeleton
    points = place[:, [skeleton.index(f"{side}_ankle"), skeleton.index(f"{side}_foot")]]
    if len(points) < 3:
        return np.zeros(len(points)), np.zeros(len(points))
    velocity = np.gradient(points, axis=0) * clip.frame_rate
    return np.linalg.norm(velocity[..., [0, 2]], axis=-1).min(axis=1), velocity[:, 1, 1]


def sunken_feet(clip: Clip) -> list[Found]:
    """Return feet, by their ankles, that are through the floor; sizes in cm."""
    place, found = np.asarray(forward_kinematics(clip.pose)[0]), list[Found]()
    floor = min(0.0, *(np.percentile(side_clearance(place, clip.pose.skeleton, s), LOWEST) for s in ("left", "right")))
    for side in ("left", "right"):
        depth = floor - side_clearance(place, clip.pose.skeleton, side)
        for first, end in runs(depth > SUNKEN):
            found.append((f"{side}_ankle", first, end - 1, 100 * float(depth[first:end].max())))
    return found
