"""How trackers are worn, refined while the wearer moves.

A calibration second tells where a tracker's joint is up to what standing still leaves open, above all how a body's
height is shared between legs and torso. Moving tells more: a bone has one length however its two ends turn, and a leg
is never longer than thigh and shin together. A Kalman filter of each person holds corrections of the joints' places, in
the joints' axes, and lengths of bones; ten times a second it takes in the distances that are tracked. What no distance
tells of keeps its uncertainty and its place. Bodies are moved so slowly that nothing jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.person import Person
from bodysense.body.rigid import RigidTransform
from bodysense.body.rotation import quaternion_rotate, quaternion_to_matrix
from bodysense.body.skeleton import default_skeleton
from bodysense.completion.inputs import Frames

WORN = ("pelvis", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_elbow", "right_elbow")
BONES = ("thigh", "shin", "forearm")  # of both sides
_BONE_ENDS = ("left_knee", "left_ankle", "left_wrist")  # whose offsets are those bones
# m: standard deviation of a calibrated joint's place, in its axes: sideways, up, forward.
_UNSURE = {
    "pelvis": (0.008, 0.022, 0.012),
    "knee": (0.01, 0.016, 0.012),
    "ankle": (0.01, 0.008, 0.012),
    "elbow": (0.016, 0.012, 0.012),
}
_LEAST_UNSURE = 0.001  # m, of a bone
_EVERY = 0.1  # s between two looks
_HALF_LIFE = 2.0  # s in which half of a correction is shown
_NOISE = 0.01  # m, standard deviation of a distance: joints are no ball joints, straps give
_SHORT_NOISE = 0.1  # m, of a leg that is shorter than it may be: it may be bent
_BENT = 0.01  # m by which a straight leg may seem too short, beside what is not known yet
_FARTHEST = 4.0  # standard deviations from what is expected: farther is an error of tracking
_MOST = 0.05  # m, along each axis: a correction beyond is an error, too
_SLIP = 1e-4  # m/√s by which straps slip
_SIZE = 3 * len(WORN) + len(BONES)


@dataclass(frozen=True)
class Distance:
    """A distance between two points that move with tracked joints."""

    start: str  # joint with a tracker
    offset: str | None  # the point of its body that counts; None: the joint itself
    end: str  # joint with a tracker
    bones: tuple[str, ...]  # whose lengths add up to it
    at_most: bool  # so long at most; else always
    without: str | None = None  # counts only where this joint is not tracked


def _distances() -> tuple[Distance, ...]:
    found = []
    for side in ("left", "right"):
        hip, knee, ankle, elbow, wrist = (f"{side}_{part}" for part in ("hip", "knee", "ankle", "elbow", "wrist"))
        found += [
            Distance("pelvis", hip, knee, ("thigh",), False),
            Distance("pelvis", hip, ankle, ("thigh", "shin"), True, without=knee),
            Distance(knee, None, ankle, ("shin",), False),
            Distance(elbow, None, wrist, ("forearm",), False),
        ]
    return tuple(found)


DISTANCES = _distances()


@dataclass(frozen=True, eq=False)
class Worn:
    """What is believed of how the trackers of one person are worn, beside what the person says."""

    person: Person
    correction: np.ndarray  # (W, 3) m, shown: from a joint as its person's mount has it, in the joint's axes
    mean: np.ndarray  # (N,) m: corrections as believed, then lengths of bones
    covariance: np.ndarray  # (N, N) m²
    due: float  # s since distances were last taken in

    @property
    def believed(self) -> np.ndarray:
        """(W, 3) m: corrections that are not shown in full yet."""
        return self.mean[: 3 * len(WORN)].reshape(-1, 3)

    def updated(self, frame: Frames, k: int, interval: float) -> Worn:
        """The same after one more frame, of which this is person `k`, `interval` s after the one before."""
        due, mean, covariance = self.due + interval, self.mean, self.covariance
        if due >= _EVERY:
            mean, covariance = _taken_in(self.person, frame, k, mean, covariance, due)
            due = 0.0
        share = 1 - 2.0 ** (-interval / _HALF_LIFE)
        moved = mean[: 3 * len(WORN)].reshape(-1, 3) - self.correction
        return Worn(self.person, self.correction + share * moved, mean, covariance, due)


@dataclass(frozen=True, eq=False)
class Mounts:
    """What is believed of how the trackers of B people are worn."""

    people: tuple[Person, ...]
    worn: tuple[Worn | None, ...]  # None for whoever wears no tracker that can be told of

    def updated(self, frame: Frames, interval: np.ndarray) -> Mounts:
        """The mounts after one more frame, its joints as the persons' mounts have them, `interval` (B,) s later."""
        if not any(self.worn):
            return self
        each = enumerate(self.worn)
        worn = tuple(None if one is None else one.updated(frame, k, float(interval[k])) for k, one in each)
        return Mounts(self.people, worn)

    def applied(self, frame: Frames) -> Frames:
        """The frame with its joints where they are believed to be."""
        if not any(self.worn):
            return frame
        position = frame.position.copy()
        for k, one in enumerate(self.worn):
            if one is None:
                continue
            known = frame.has_position[k, _PLACES] & frame.has_rotation[k, _PLACES]
            turned = np.asarray(quaternion_rotate(frame.rotation[k, _PLACES].astype(np.float64), one.correction))
            position[k, _PLACES] += np.where(known[:, None], turned, 0.0).astype(np.float32)
        return replace(frame, position=position)

    def told(self, people: tuple[Person, ...]) -> Mounts:
        """The same where a person's mounts are the same ones, else as they are told anew."""
        rows = zip(self.people, people, self.worn, mounts_of(people).worn, strict=True)
        return Mounts(people, tuple(old if was.mounts == now.mounts else new for was, now, old, new in rows))

    @classmethod
    def stacked(cls, parts: Sequence[Mounts]) -> Mounts:
        """Those of several people as one of all of them."""
        people = tuple(person for part in parts for person in part.people)
        return cls(people, tuple(one for part in parts for one in part.worn))

    def alone(self, k: int) -> Mounts:
        """Those of one of several people."""
        return Mounts(self.people[k : k + 1], self.worn[k : k + 1])

    def person(self, k: int) -> dict[str, RigidTransform]:
        """A person's mounts as believed now: T_joint_tracker."""
        mounts, worn = dict(self.people[k].mounts), self.worn[k]
        if worn is None:
            return mounts
        for joint, moved in zip(WORN, worn.believed, strict=True):
            if joint in mounts:
                mounts[joint] = RigidTransform(moved).inverse() @ mounts[joint]
        return mounts


def mounts_of(people: tuple[Person, ...]) -> Mounts:
    """What is known of how trackers are worn before the first frame."""
    return Mounts(people, tuple(_worn_by(person) for person in people))


def _worn_by(person: Person) -> Worn | None:
    if person.mounts.keys().isdisjoint(WORN):
        return None
    ends = person.skeleton.indices(_BONE_ENDS)
    mean, unsure = np.zeros(_SIZE), np.zeros(_SIZE)
    mean[-len(BONES) :] = person.skeleton.bone_length[ends]
    unsure[-len(BONES) :] = np.maximum(person.bone_deviation[ends], _LEAST_UNSURE)
    for w, joint in enumerate(WORN):
        if joint in person.mounts:
            unsure[3 * w : 3 * w + 3] = _UNSURE[joint.rpartition("_")[-1]]
    return Worn(person, np.zeros((len(WORN), 3)), mean, np.diag(unsure**2), 0.0)


_PLACES = default_skeleton().indices(WORN)


def _taken_in(
    person: Person, frame: Frames, k: int, mean: np.ndarray, covariance: np.ndarray, passed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of a person after the distances of a frame were taken in."""
    skeleton = person.skeleton
    unsure = np.diag(covariance) > 0
    covariance = covariance + np.diag(np.where(unsure, _SLIP**2 * passed, 0.0))
    for distance in DISTANCES:
        if person.mounts.keys().isdisjoint((distance.start, distance.end)):
            continue
        start, end = skeleton.index(distance.start), skeleton.index(distance.end)
        if not (frame.has_position[k, [start, end]] & frame.has_rotation[k, [start, end]]).all():
            continue
        if distance.without is not None and frame.has_position[k, skeleton.index(distance.without)]:
            continue
        from_axes, to_axes = np.asarray(quaternion_to_matrix(frame.rotation[k, [start, end]].astype(np.float64)))
        offset = np.zeros(3) if distance.offset is None else skeleton.rest_offset[skeleton.index(distance.offset)]
        slope = np.zeros(_SIZE)
        apart = (frame.position[k, end] - frame.position[k, start]).astype(np.float64) - from_axes @ offset
        for joint, axes, sign in ((distance.start, from_axes, -1.0), (distance.end, to_axes, 1.0)):
            if joint in WORN:
                own = slice(3 * WORN.index(joint), 3 * WORN.index(joint) + 3)
                apart = apart + sign * axes @ mean[own]
        far = float(np.linalg.norm(apart))
        for joint, axes, sign in ((distance.start, from_axes, -1.0), (distance.end, to_axes, 1.0)):
            if joint in WORN:
                slope[3 * WORN.index(joint) : 3 * WORN.index(joint) + 3] = sign * (apart / max(far, 0.01)) @ axes
        bones = [3 * len(WORN) + BONES.index(bone) for bone in distance.bones]
        slope[bones] = -1.0
        excess = far - float(mean[bones].sum())
        spread = covariance @ slope
        expected = float(slope @ spread)
        noise = _NOISE
        if distance.at_most and excess < 0:
            if -excess > _BENT + 2 * expected**0.5:
                continue
            noise = _SHORT_NOISE
        variance = expected + noise**2
        if abs(excess) > _FARTHEST * variance**0.5:
            continue
        trial = mean - spread * (excess / variance)
        if np.abs(trial[: 3 * len(WORN)]).max() > _MOST:
            continue
        mean = trial
        covariance = covariance - np.outer(spread, spread) / variance
    return mean, covariance
