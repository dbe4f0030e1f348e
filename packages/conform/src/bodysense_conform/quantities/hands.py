"""Hands: sizes, sides and order of the fingers, and gestures. Hands that never come are not judged."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_rotate
from bodysense_conform.quantities.motion import noise
from bodysense_conform.quantities.shape import SIDES, angle
from bodysense_conform.series import NotEnough, Series, stacked
from bodysense_conform.subject import Subject, is_finger

_FINGERS = ("index", "middle", "ring", "pinky")
_ALL = ("thumb", *_FINGERS)
_TOUCH = 0.04  # m; a thumb this near to a fingertip touches it
_CURLED = 0.9  # straightness of fingers that are curled


def missing_joints(subject: Subject) -> Series:
    """Whether a joint of a hand never comes although others of it do."""
    columns = {}
    for side in SIDES:
        names = [f"{side}_{finger}{k}" for finger in _ALL for k in (1, 2, 3)]
        if any(subject.has(name) for name in names):
            columns |= {name: np.array([not subject.has(name)]) for name in names}
    return stacked(columns, "no finger comes")


def missing(subject: Subject) -> Series:
    """Whether a point of a finger that comes at all is missing in a frame whose wrist is valid."""
    columns = {}
    for name in subject.points:
        wrist = f"{name.partition('_')[0]}_wrist"
        if is_finger(name) and subject.has(name, wrist):
            k, w = subject.columns([name, wrist])
            columns[name] = np.where(subject.valid[:, w], ~subject.valid[:, k], np.nan)
    return stacked(columns, "no finger comes")


def size(subject: Subject) -> Series:
    """Length from wrist to the end of the middle finger along the bones, cm; 15 % more without its tip."""

    def of(side: str) -> np.ndarray:
        chain = [f"{side}_wrist", *_chain(subject, side, "middle")]
        total = sum(float(np.nanmedian(subject.length(a, b))) for a, b in pairwise(chain))
        return np.array([100 * total * (1 if chain[-1].endswith("tip") else 1.15)])

    return _hands(subject, of)


def finger_share(subject: Subject) -> Series:
    """Length of the middle finger's first two bones, as a share of the palm."""

    def of(side: str) -> np.ndarray:
        finger = sum(np.nanmedian(subject.length(f"{side}_middle{k}", f"{side}_middle{k + 1}")) for k in (1, 2))
        return np.array([finger / max(np.nanmedian(subject.length(f"{side}_wrist", f"{side}_middle1")), 1e-4)])

    return _hands(subject, of)


def order_wrong(subject: Subject) -> Series:
    """Whether the knuckles do not follow each other from index to little finger."""

    def of(side: str) -> np.ndarray:
        knuckles = np.stack([subject.at(f"{side}_{finger}1") for finger in _FINGERS])
        along = ((knuckles - knuckles[0]) * (knuckles[-1] - knuckles[0])).sum(axis=-1)
        return (np.diff(along, axis=0) <= 0).any(axis=0)

    return _hands(subject, of)


def thumb_wrong(subject: Subject) -> Series:
    """Whether the thumb is nearer to the little finger's knuckle than to the index finger's."""

    def of(side: str) -> np.ndarray:
        near, far = (subject.length(f"{side}_thumb2", f"{side}_{finger}1") for finger in ("index", "pinky"))
        return near > far

    return _hands(subject, of)


def curls_back(subject: Subject) -> Series:
    """Whether curled fingers are on the back of the hand: the hand is the other side's."""

    def of(side: str) -> np.ndarray:
        along = subject.at(f"{side}_middle1") - subject.at(f"{side}_wrist")
        across = subject.at(f"{side}_index1") - subject.at(f"{side}_pinky1")
        palm = np.cross(along, across) * (-1 if side == "right" else 1)
        tips = np.mean([subject.at(f"{side}_{f}3") - subject.at(f"{side}_{f}1") for f in _FINGERS], axis=0)
        return np.where(_straight(subject, side) < _CURLED, (tips * palm).sum(axis=-1) < 0, np.nan)

    return _hands(subject, of)


def wrist_axes(subject: Subject) -> Series:
    """Angles between the hand's direction and knuckles and those of the wrist's rotation, degrees: the greater."""

    def of(side: str) -> np.ndarray:
        wrist = f"{side}_wrist"
        if not subject.has_rotation(wrist):
            raise NotEnough("no rotations of the wrists")
        back = quaternion_conjugate(subject.turn(wrist))
        along, across = (
            quaternion_rotate(back, subject.at(f"{side}_{a}") - subject.at(f"{side}_{b}"))
            for a, b in (("middle1", "wrist"), ("index1", "pinky1"))
        )
        outward = 1 if side == "left" else -1
        # A palm may be narrow and skewed, so its twist counts half.
        return np.maximum(angle(along, np.array([outward, 0.0, 0.0])), angle(across, np.array([0.0, 0.0, 1.0])) / 2)

    return _hands(subject, of)


def tremor(subject: Subject) -> Series:
    """Noise of the fingertips at rest, seen from the wrist, mm."""
    return _tips(subject, lambda place: 1000 * noise(place, subject, 0.1))


def leap(subject: Subject) -> Series:
    """Way of a fingertip, seen from the wrist, within a frame, cm."""
    near = np.diff(subject.time, prepend=np.nan) <= 0.1
    return _tips(
        subject,
        lambda place: np.where(near, 100 * np.linalg.norm(np.diff(place, axis=0, prepend=np.nan), axis=-1), np.nan),
    )


def straightness(subject: Subject) -> Series:
    """Distance from root to tip of the fingers, as a share of their bones: 1 is straight."""
    return _hands(subject, lambda side: _straight(subject, side))


def touch(subject: Subject) -> Series:
    """Distance from the thumb's tip to the nearest fingertip, cm."""
    return _hands(subject, lambda side: 100 * _apart(subject, side).min(axis=0))


def touches_other(subject: Subject, fingers: tuple[str, ...]) -> Series:
    """Whether the thumb touches another finger than this, in frames in which it touches one."""

    def of(side: str) -> np.ndarray:
        apart = _apart(subject, side)
        wrong = np.argmin(np.nan_to_num(apart, nan=9.0), axis=0) != _FINGERS.index(fingers[0])
        return np.where(apart.min(axis=0) < _TOUCH, wrong, np.nan)

    return _hands(subject, of)


def turned(subject: Subject) -> Series:
    """Turn of the knuckles since the first frame of a step 'wrist_rotate', degrees."""
    firsts = [int(np.argmax(subject.during(step))) for step in subject.labelled("wrist_rotate")]

    def of(side: str) -> np.ndarray:
        across = subject.at(f"{side}_index1") - subject.at(f"{side}_pinky1")
        since = np.searchsorted(firsts, np.arange(len(subject)), side="right") - 1
        return angle(across, across[np.array(firsts or [0])[np.maximum(since, 0)]])

    return _hands(subject, of)


def _hands(subject: Subject, of: Callable[[str], np.ndarray]) -> Series:
    found = {f"{side}_wrist": of(side) for side in SIDES if _whole(subject, side)}
    return stacked(found, "no hand comes with all its fingers")


def _tips(subject: Subject, of: Callable[[np.ndarray], np.ndarray]) -> Series:
    """A measure of every fingertip's place (T, 3) in the frame of its wrist."""
    columns = {}
    for side in (side for side in SIDES if _whole(subject, side)):
        wrist = f"{side}_wrist"
        for tip in (_chain(subject, side, finger)[-1] for finger in _ALL):
            place = subject.at(tip) - subject.at(wrist)
            if subject.has_rotation(wrist):
                place = quaternion_rotate(quaternion_conjugate(subject.turn(wrist)), place)
            columns[tip] = of(place)
    return stacked(columns, "no hand comes with all its fingers")


def _whole(subject: Subject, side: str) -> bool:
    return subject.has(f"{side}_wrist", *(f"{side}_{finger}{k}" for finger in _ALL for k in (1, 2, 3)))


def _chain(subject: Subject, side: str, finger: str) -> list[str]:
    """Joints of a finger, with its tip if it comes."""
    tip = f"{side}_{finger}_tip"
    return [*(f"{side}_{finger}{k}" for k in (1, 2, 3)), *([tip] if subject.has(tip) else [])]


def _straight(subject: Subject, side: str) -> np.ndarray:
    shares = []
    for chain in (_chain(subject, side, finger) for finger in _FINGERS):
        total = sum(np.nanmedian(subject.length(a, b)) for a, b in pairwise(chain))
        shares.append(subject.length(chain[0], chain[-1]) / total)
    return np.mean(shares, axis=0)


def _apart(subject: Subject, side: str) -> np.ndarray:
    """Distances (4, T) from the thumb's end to those of the fingers, m."""
    thumb = _chain(subject, side, "thumb")[-1]
    return np.stack([subject.length(thumb, _chain(subject, side, finger)[-1]) for finger in _FINGERS])
