"""Mountings of trackers, refined while the wearer moves.

A bone has one length however its two ends turn, and a leg is never longer than thigh and shin together. A Kalman filter
holds corrections of the joints' places, in the joints' axes, and lengths of bones. For a distance d with slope s:

    x ← x - P s (d - expected) / (sᵀ P s + n²),  P ← P - P s sᵀ P / (sᵀ P s + n²)
"""

from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from bodysense.body.person import SENSOR, Person
from bodysense.geometry.rotation import quaternion_to_matrix

from .points import PELVIS, SIDES, at
from .tracked import Tracked

LEAST_UNSURE = 0.001  # m, of a bone
EVERY = 0.1  # s between two looks
HALF_LIFE = 2.0  # s in which half of a correction comes into use
NOISE = 0.01  # m, standard deviation of a distance: joints are no ball joints, straps give
SHORT_NOISE = 0.1  # m, of a leg that is shorter than it may be: it may be bent
BENT = 0.01  # m by which a straight leg may seem too short, besides what is not known yet
FARTHEST = 4.0  # standard deviations from what is expected: farther is an error of tracking
MOST = 0.05  # m, along each axis: a correction beyond is an error, too
SLIP = 1e-4  # m/√s by which straps slip

# m: standard deviation of a calibrated place: sideways, up, forward.
UNSURE = {
    PELVIS: (0.008, 0.022, 0.012),
    **{
        at(f"{side}_{name}"): unsure
        for name, unsure in (
            ("knee", (0.01, 0.016, 0.012)),
            ("ankle", (0.01, 0.008, 0.012)),
            ("elbow", (0.016, 0.012, 0.012)),
        )
        for side in SIDES
    },
}
REFINED_JOINTS = tuple(UNSURE)
BONES = {"thigh": at("left_knee"), "shin": at("left_ankle"), "forearm": at("left_wrist")}
SIZE = 3 * len(REFINED_JOINTS) + len(BONES)


@dataclass(frozen=True)
class Distance:
    """A distance between points that move with two tracked joints, and the bones whose lengths add up to it."""

    start: int
    end: int
    bones: tuple[str, ...]
    offset: int | None = None  # the point of the start's body that counts; None: the joint itself
    without: int | None = None  # counts only if this joint is not tracked
    at_most: bool = False  # else always so long


def _distances(side: str) -> list[Distance]:
    hip, knee, ankle, elbow, wrist = (at(f"{side}_{name}") for name in ("hip", "knee", "ankle", "elbow", "wrist"))
    return [
        Distance(PELVIS, knee, ("thigh",), hip),
        Distance(PELVIS, ankle, ("thigh", "shin"), hip, knee, at_most=True),
        Distance(knee, ankle, ("shin",)),
        Distance(elbow, wrist, ("forearm",)),
    ]


DISTANCES = [distance for side in SIDES for distance in _distances(side)]


@dataclass
class Mounts:
    """Beliefs about how trackers are worn."""

    mean: np.ndarray  # (N,) m: corrections as believed, then lengths of bones
    covariance: np.ndarray  # (N, N) m²
    correction: np.ndarray = field(default_factory=lambda: np.zeros((len(REFINED_JOINTS), 3)))  # m, in use
    due: float = 0.0  # s since distances were last taken in


def mounts_of(person: Person) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Mounts by the joint that carries each: translation (3,) m and joint ← tracker (3, 3)."""
    return {
        at(joint): (np.asarray(mount.translation), quaternion_to_matrix(mount.rotation))
        for joint, mount in person.mounts.items()
        if not joint.endswith(SENSOR)
    }


def first_mounts(person: Person) -> Mounts:
    """Return the beliefs before the first frame."""
    mounts, offset = mounts_of(person), person.skeleton.rest_offset
    variance, mean = np.zeros(SIZE), np.zeros(SIZE)
    for k, joint in enumerate(REFINED_JOINTS):
        if joint in mounts:
            variance[3 * k : 3 * k + 3] = np.square(UNSURE[joint])
    for k, end in enumerate(BONES.values(), start=3 * len(REFINED_JOINTS)):
        mean[k] = np.linalg.norm(offset[end])
        variance[k] = max(person.bone_deviation[end], LEAST_UNSURE) ** 2
    return Mounts(mean, np.diag(variance))


def apply(person: Person, seen: Tracked) -> None:
    """Put joints in place of the trackers that they carry."""
    for joint, (translation, rotation) in mounts_of(person).items():
        if seen.has_rotation[joint] and seen.has_position[joint]:
            seen.rotation[joint] = seen.rotation[joint] @ rotation.T
            seen.position[joint] = seen.position[joint] - seen.rotation[joint] @ translation


def _take_in(one: Distance, offset: np.ndarray, seen: Tracked, own: Mounts) -> None:
    """Take in one distance: a step of the filter."""
    apart = seen.position[one.end] - seen.position[one.start]
    if one.offset is not None:
        apart = apart - seen.rotation[one.start] @ offset[one.offset]
    ends = [
        (REFINED_JOINTS.index(joint), joint, sign)
        for joint, sign in ((one.start, -1), (one.end, 1))
        if joint in REFINED_JOINTS
    ]
    for k, joint, sign in ends:
        apart = apart + sign * seen.rotation[joint] @ own.mean[3 * k : 3 * k + 3]
    far, slope = float(np.linalg.norm(apart)), np.zeros(SIZE)
    for k, joint, sign in ends:
        slope[3 * k : 3 * k + 3] = sign * seen.rotation[joint].T @ (apart / max(far, 0.01))
    for bone in one.bones:
        slope[3 * len(REFINED_JOINTS) + list(BONES).index(bone)] = -1
    excess = far + slope[3 * len(REFINED_JOINTS) :] @ own.mean[3 * len(REFINED_JOINTS) :]
    spread, noise = own.covariance @ slope, NOISE
    expected = max(float(slope @ spread), 0.0)
    if one.at_most and excess < 0:
        if -excess > BENT + 2 * sqrt(expected):
            return
        noise = SHORT_NOISE
    variance = expected + noise**2
    mean = own.mean - spread * excess / variance
    if abs(excess) > FARTHEST * sqrt(variance) or (np.abs(mean[: 3 * len(REFINED_JOINTS)]) > MOST).any():
        return
    own.mean, own.covariance = mean, own.covariance - np.outer(spread, spread) / variance


def step(person: Person, interval: float, own: Mounts, seen: Tracked) -> None:
    """Take in the distances of a frame, and put its joints where they are believed to be."""
    mounts = mounts_of(person)
    if not any(joint in mounts for joint in REFINED_JOINTS):
        return
    own.due += interval
    whole = seen.has_position[: len(seen.has_rotation)] & seen.has_rotation
    if own.due >= EVERY:
        unsure = np.diag(own.covariance) > 0
        own.covariance = own.covariance + np.diag(unsure * SLIP**2 * own.due)
        for one in DISTANCES:
            hidden = one.without is None or not seen.has_position[one.without]
            if hidden and (one.start in mounts or one.end in mounts) and whole[one.start] and whole[one.end]:
                _take_in(one, person.skeleton.rest_offset, seen, own)
        own.due = 0.0
    share = 1 - 2 ** (-interval / HALF_LIFE)
    own.correction += share * (own.mean[: 3 * len(REFINED_JOINTS)].reshape(-1, 3) - own.correction)
    for joint, correction in zip(REFINED_JOINTS, own.correction, strict=True):
        if whole[joint]:
            seen.position[joint] = seen.position[joint] + seen.rotation[joint] @ correction
