"""Defects of joints' rotations: spikes, pops, frozen limbs, swapped sides, and knees that bend backward.

Thresholds are chosen on validation people of CMU and Rocketbox (`bodysense evaluate repair`): larger ones miss small
defects, smaller ones take fast motion for defects.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import BODY
from bodysense.geometry.gaps import runs
from bodysense.geometry.rotation import geodesic_angle, quaternion_log, slerp

Found = tuple[str, int, int, float]  # joint, first and last frame, size

SPIKE = np.deg2rad(10.0)  # least deviation of a spike from the path around it
WIDEST = 3  # frames; longest spike
BESIDE = 4  # frames on either side with which a sudden change is compared
SUDDEN = 2.5  # least ratio of a spike to the largest adjacent step
POP = np.deg2rad(20.0)  # least step of a pop
POP_RATIO = 5.0  # least ratio of a pop to the largest adjacent step
STILL = 1e-5  # rad; a joint that turns by less in a frame holds its rotation
FREEZE = 0.25  # s; shortest freeze
MOVING = 1e-3  # rad; the body moves if its joints turn by more in a frame, in the median
USUALLY_STILL = 0.5  # share of frames; a joint that holds still for more never moves in this take
SWAP = np.deg2rad(40.0)  # least sum of steps of a pair of limbs that change sides
SWAP_RATIO = 2.0  # least ratio of the steps with and without the change of sides
SWAP_SUDDEN = 1.5  # least ratio of that step to adjacent ones; limbs that pass each other move evenly
BACKWARD = np.deg2rad(12.0)  # least angle of a knee that bends backward
KNEE = 0.1  # s; shortest span of a knee that bends backward

# Joints that never hold still while the body moves, unlike knees at their stop, toes and collars, and joints that are
# frozen only together with them.
RESTLESS = (("shoulder",), ("elbow",), ("wrist",), ("hip", "knee", "foot"), ("ankle", "foot"))
LIMBS = {"arm": ("collar", "shoulder", "elbow", "wrist"), "leg": ("hip", "knee", "ankle", "foot")}
_MIRROR = np.array([1.0, 1.0, -1.0, -1.0])  # of a quaternion, left for right


def _rotations(pose: Pose) -> np.ndarray:
    """Return local rotations (T, 22, 4) of the body's joints."""
    return np.asarray(pose.rotation, dtype=float)[:, pose.skeleton.indices(BODY)]


def _steps(rotation: np.ndarray) -> np.ndarray:
    """Return angles (T, J) from the frame before; 0 in the first frame."""
    steps = np.zeros(rotation.shape[:2])
    steps[1:] = geodesic_angle(rotation[1:], rotation[:-1])
    return steps


def _largest_beside(steps: np.ndarray, first: int, end: int) -> np.ndarray:
    """Return the largest steps (J,) in the frames before `first` and from `end` on."""
    beside = np.concatenate([steps[max(first - BESIDE, 1) : first], steps[end : end + BESIDE]])
    return beside.max(axis=0) if len(beside) else np.zeros(steps.shape[1])


def spikes(pose: Pose, frame_rate: float) -> list[Found]:
    """Return joints that leave their path for at most `WIDEST` frames and come back; sizes in degrees."""
    rotation = _rotations(pose)
    steps, frames = _steps(rotation), len(rotation)
    taken = np.zeros(rotation.shape[:2], dtype=bool)
    found: list[Found] = []
    for width in range(1, WIDEST + 1):
        large = steps > 0.4 * SPIKE  # both the step in and the step out, of one joint
        starts = np.flatnonzero((large[1 : frames - width] & large[1 + width :][: frames - width - 1]).any(axis=1)) + 1
        for first in starts.tolist():
            end = first + width
            share = (np.arange(width) + 1.0) / (width + 1)
            before, after = rotation[first - 1], rotation[end]
            base = np.stack([slerp(before, after, np.full(len(before), s)) for s in share])
            deviation = geodesic_angle(rotation[first:end], base)  # (width, J)
            least, largest = deviation.min(axis=0), deviation.max(axis=0)
            beside = np.maximum(_largest_beside(steps, first, end + 1), geodesic_angle(before, after) / (width + 1))
            is_spike = (largest > SPIKE) & (least > 0.4 * largest) & (largest > SUDDEN * beside)
            is_spike &= np.minimum(steps[first], steps[end]) > 0.4 * largest
            is_spike &= ~taken[first:end].any(axis=0)
            for joint in np.flatnonzero(is_spike).tolist():
                taken[first:end, joint] = True
                found.append((BODY[joint], first, end - 1, float(np.rad2deg(largest[joint]))))
    return found


def pops(pose: Pose, frame_rate: float) -> list[Found]:
    """Return joints that jump within a frame and stay there; sizes in degrees."""
    steps = _steps(_rotations(pose))
    jumped = {(joint, frame) for joint, first, last, _ in spikes(pose, frame_rate) for frame in (first, last, last + 1)}
    changes = {frame for _, first, last, _ in swaps(pose, frame_rate) for frame in (first, last + 1)}
    found: list[Found] = []
    for frame in np.flatnonzero((steps > POP).any(axis=1)).tolist():
        beside = _largest_beside(steps, frame, frame + 1)
        for joint in np.flatnonzero((steps[frame] > POP) & (steps[frame] > POP_RATIO * beside)).tolist():
            if (BODY[joint], frame) not in jumped and frame not in changes:
                found.append((BODY[joint], frame, frame, float(np.rad2deg(steps[frame, joint]))))
    return found


def freezes(pose: Pose, frame_rate: float) -> list[Found]:
    """Return joints that hold their rotation while the body moves; sizes in seconds."""
    steps = _steps(_rotations(pose))
    still = steps < STILL
    still[0] = False
    usual = still[1:].mean(axis=0) if len(still) > 1 else np.ones(still.shape[1])
    others = steps[:, usual < USUALLY_STILL]
    body = np.sort(others, axis=1)[:, -max(1, others.shape[1] // 3) :].mean(axis=1) if others.size else others.sum(1)
    least = max(2, round(FREEZE * frame_rate))
    found: list[Found] = []
    for side, (top, *below) in ((side, limb) for side in ("left", "right") for limb in RESTLESS):
        joint = BODY.index(f"{side}_{top}")
        if usual[joint] >= USUALLY_STILL:
            continue
        for first, end in runs(still[:, joint]):
            if end - first + 1 < least or np.median(body[first:end]) <= MOVING:
                continue
            with_it = [k for k in (BODY.index(f"{side}_{part}") for part in below) if still[first:end, k].all()]
            with_it = [k for k in with_it if usual[k] < 1]
            for name in (BODY[k] for k in (joint, *with_it)):
                found.append((name, first, end - 1, (end - first) / frame_rate))
    return list(dict.fromkeys(found))


def swaps(pose: Pose, frame_rate: float) -> list[Found]:
    """Return limbs, by their left shoulder or hip, that have the other side's motion; sizes in degrees."""
    rotation = np.asarray(pose.rotation, dtype=float)
    index, found = pose.skeleton.index, list[Found]()
    for first_joint, parts in (("shoulder", LIMBS["arm"]), ("hip", LIMBS["leg"])):
        left, right = (rotation[:, [index(f"{side}_{part}") for part in parts]] for side in ("left", "right"))
        unchanged = geodesic_angle(left[1:], left[:-1]) + geodesic_angle(right[1:], right[:-1])
        swapped = geodesic_angle(left[1:], right[:-1] * _MIRROR) + geodesic_angle(right[1:], left[:-1] * _MIRROR)
        same, crossed = unchanged.sum(axis=1), swapped.sum(axis=1)  # rad from frame to frame
        beside = np.maximum(np.append(0.0, same[:-1]), np.append(same[1:], 0.0))
        is_change = (same > SWAP) & (same > SWAP_RATIO * crossed) & (same > SWAP_SUDDEN * beside)
        events = np.flatnonzero(is_change) + 1
        for first, end in _between(events.tolist(), len(rotation)):
            size = same[(first or end) - 1]
            found.append((f"left_{first_joint}", first, end - 1, float(np.rad2deg(size))))
    return found


def _between(events: Sequence[int], frames: int) -> list[tuple[int, int]]:
    """Return spans between changes of sides, each at its first frame; the shorter part is the swapped one."""
    edges = [0, *events, frames]
    spans = list(pairwise(edges))
    odd, even = spans[1::2], spans[0::2]
    shorter = min((odd, even), key=lambda some: sum(end - first for first, end in some))
    return shorter if events else []


def backward_knees(pose: Pose, frame_rate: float) -> list[Found]:
    """Return knees that bend backward; sizes in degrees."""
    rotation, found = np.asarray(pose.rotation, dtype=float), list[Found]()
    for side in ("left", "right"):
        name = f"{side}_knee"
        bend = np.asarray(quaternion_log(rotation[:, pose.skeleton.index(name)]))[:, 0]
        for first, end in runs(bend < -BACKWARD):
            if (end - first) / frame_rate >= KNEE:
                found.append((name, first, end - 1, float(np.rad2deg(-bend[first:end].min()))))
    return found
