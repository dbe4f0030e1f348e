"""Hands: are they hands, on the right arm, and do their fingers do what the performer's do?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_rotate
from bodysense_conform.check import Check, Unanswered, Value, check_of
from bodysense_conform.checks.data import longest_run
from bodysense_conform.checks.still import noise_floor, noisiest
from bodysense_conform.subject import Step, Subject, is_finger

_SIDES = ("left", "right")
_FINGERS = ("index", "middle", "ring", "pinky")
_ALL = ("thumb", *_FINGERS)
_HELD = 0.6  # of a step in which a gesture is held: the last part is judged
_NEAR = 0.04  # m: a thumb this near to a tip touches it
OfSide = Callable[[Subject, str], "Value | Unanswered"]


def each_hand(measure: OfSide, subject: Subject) -> Value | Unanswered:
    """The worse hand of those that there are."""
    found = [measure(subject, side) for side in _SIDES if _whole(subject, side)]
    if not found:
        return Unanswered("no hand comes with all its fingers")
    values = [one for one in found if isinstance(one, Value)]
    return max(values, key=lambda one: one.value) if values else found[0]


def coverage(subject: Subject) -> Value | Unanswered:
    """Share of frames with any point in which the least seen point of the fingers is missing."""
    fingers = [k for k, name in enumerate(subject.points) if is_finger(name)]
    present = subject.valid.any(axis=1)
    if not fingers or not present.any():
        return Unanswered("no fingers come")
    missing = 1 - subject.valid[present][:, fingers].mean(axis=0)
    worst = int(np.argmax(missing))
    return Value(100 * float(missing[worst]), subject.points[fingers[worst]])


def complete(subject: Subject) -> Value | Unanswered:
    """Points of a hand that never come, though others of it do."""
    lacking = []
    for side in _SIDES:
        wanted = [f"{side}_{finger}{k}" for finger in _ALL for k in (1, 2, 3)]
        here = [name for name in wanted if name in subject.points]
        if here:
            lacking += [name for name in wanted if not subject.has(name)]
    if not any(is_finger(name) for name in subject.points):
        return Unanswered("no fingers come")
    return Value(len(lacking), ", ".join(lacking[:4]))


def size(subject: Subject, side: str) -> Value | Unanswered:
    """From wrist to the middle fingertip along the bones."""
    chain = ["wrist", "middle1", "middle2", "middle3"] + (["middle_tip"] if _tips(subject, side) else [])
    total = sum(_length(subject, f"{side}_{a}", f"{side}_{b}") for a, b in pairwise(chain))
    return Value(total if _tips(subject, side) else total * 1.15, side)


def smallness(subject: Subject, side: str) -> Value | Unanswered:
    """The same, negative: the smaller hand counts."""
    found = size(subject, side)
    return Value(-found.value, found.where) if isinstance(found, Value) else found


def bone_constancy(subject: Subject, side: str) -> Value:
    """Greatest coefficient of variation of a finger's bone."""
    worst, where = 0.0, ""
    for finger in _ALL:
        for a, b in pairwise(_chain(subject, side, finger)):
            length = subject.length(a, b)
            low, high = np.nanpercentile(length, [2.5, 97.5])
            variation = 100 * float(np.nanstd(np.clip(length, low, high))) / max(float(np.nanmedian(length)), 1e-3)
            if variation > worst:
                worst, where = variation, b
    return Value(worst, where)


def middle_share(subject: Subject, side: str) -> Value:
    """How far the ratio of the middle finger to the palm is from 1, as its logarithm to the base 2."""
    finger = sum(_length(subject, f"{side}_middle{k}", f"{side}_middle{k + 1}") for k in (1, 2))
    palm = _length(subject, f"{side}_wrist", f"{side}_middle1")
    return Value(abs(float(np.log2(max(finger, 1e-4) / max(palm, 1e-4) / 0.6))), side)


def knuckle_order(subject: Subject, side: str) -> Value:
    """Share of frames in which knuckles do not follow each other from index to little finger."""
    knuckles = [subject.at(f"{side}_{finger}1") for finger in _FINGERS]
    across = knuckles[-1] - knuckles[0]
    along = np.stack([((k - knuckles[0]) * across).sum(axis=-1) for k in knuckles])
    return Value(100 * float((np.diff(along, axis=0) <= 0).any(axis=0).mean()), side)


def thumb_side(subject: Subject, side: str) -> Value:
    """Share of frames in which the thumb's base lies nearer to the little finger's knuckle than to the index's."""
    thumb = subject.at(f"{side}_thumb2")
    near = np.linalg.norm(thumb - subject.at(f"{side}_index1"), axis=-1)
    far = np.linalg.norm(thumb - subject.at(f"{side}_pinky1"), axis=-1)
    return Value(100 * float((near > far).mean()), side)


def chirality(subject: Subject, side: str) -> Value | Unanswered:
    """Share of frames in which fingers curl to the back of the hand, or the hand is the other one mirrored."""
    along = subject.at(f"{side}_middle1") - subject.at(f"{side}_wrist")
    across = subject.at(f"{side}_index1") - subject.at(f"{side}_pinky1")
    palm = np.cross(along, across) * (-1.0 if side == "right" else 1.0)
    palm = palm / np.maximum(np.linalg.norm(palm, axis=-1, keepdims=True), 1e-9)
    tips = np.mean([subject.at(f"{side}_{f}3") - subject.at(f"{side}_{f}1") for f in _FINGERS], axis=0)
    lower = (tips * palm).sum(axis=-1)
    curled = straightness(subject, side) < 0.9
    if curled.sum() < 5:
        return Unanswered("the fingers never curl")
    return Value(100 * float((lower[curled] < 0).mean()), side)


def wrist_axes(subject: Subject, side: str) -> Value | Unanswered:
    """Degrees by which the hand's direction is from what the wrist's rotation says."""
    wrist = f"{side}_wrist"
    if not subject.rotated[subject.points.index(wrist)]:
        return Unanswered("no rotations of the wrists")
    local = quaternion_rotate(
        quaternion_conjugate(subject.turn(wrist)), subject.at(f"{side}_middle1") - subject.at(wrist)
    )
    mean = np.nanmean(local, axis=0)
    return Value(float(np.degrees(np.arccos(np.clip(abs(mean[0]) / np.linalg.norm(mean), -1, 1)))), side)


def straightness(subject: Subject, side: str) -> np.ndarray:
    """(T,) from root to last joint over the sum of bones, the mean of four fingers; 1: straight."""
    shares = []
    for finger in _FINGERS:
        chain = _chain(subject, side, finger)
        way = sum(_length(subject, a, b) for a, b in pairwise(chain))
        shares.append(subject.length(chain[0], chain[-1]) / max(way, 1e-4))
    return np.mean(shares, axis=0)


def shake(subject: Subject, side: str) -> Value | Unanswered:
    """Noise (mm) of the noisiest fingertip, in the wrist, in its calmest second."""
    tips = [_chain(subject, side, finger)[-1] for finger in _ALL]
    noise = {tip: 1000 * noise_floor(_in_wrist(subject, side, tip), subject, 0.1) for tip in tips}
    return noisiest(noise, "no finger rests for a second")


def pop(subject: Subject, side: str) -> Value | Unanswered:
    """The greatest way (cm) of a fingertip, in the wrist, within a frame."""
    worst, where, frame = 0.0, "", None
    for finger in _ALL:
        tip = _chain(subject, side, finger)[-1]
        way = np.linalg.norm(np.diff(_in_wrist(subject, side, tip), axis=0), axis=-1)
        way = np.where(subject.step <= 0.1, way, np.nan)
        if np.isfinite(way).any() and float(np.nanmax(way)) > worst:
            worst, where, frame = float(np.nanmax(way)), tip, int(np.nanargmax(way))
    return Value(100 * worst, where, frame)


def frozen(subject: Subject, side: str) -> Value:
    """The longest time for which the wrist repeats bit for bit while a finger moves in it."""
    still = (np.diff(subject.at(f"{side}_wrist"), axis=0) == 0).all(axis=-1)
    moves = np.zeros(len(subject) - 1, dtype=bool)
    for finger in _ALL:
        tip = _chain(subject, side, finger)[-1]
        moves |= np.linalg.norm(np.diff(subject.at(tip), axis=0), axis=-1) > 0.001
    run, start = longest_run(still & moves)
    return Value(run * subject.interval, side, start)


def gesture(label: str, measure: Callable[[Subject, str, np.ndarray], Value], subject: Subject) -> Value | Unanswered:
    """The worst of a measure over the steps of a label and the hands."""
    steps = subject.labelled(label)
    sides = [side for side in _SIDES if _whole(subject, side) and _tips(subject, side)]
    if not steps:
        return Unanswered(f"no step {label!r} in the script")
    if not sides:
        return Unanswered("no hand comes with all its fingers and their tips")
    found = [
        measure(subject, side, at) for step in steps if (at := _frames(subject, step)).sum() >= 5 for side in sides
    ]
    return max(found, key=lambda one: one.value) if found else Unanswered("too few frames in the step")


def curled(subject: Subject, side: str, during: np.ndarray) -> Value:
    """Straightness of the fingers."""
    return Value(float(np.nanmedian(straightness(subject, side)[during])), side, int(np.flatnonzero(during)[-1]))


def bent(subject: Subject, side: str, during: np.ndarray) -> Value:
    """What fingers lack of being straight."""
    found = curled(subject, side, during)
    return Value(1 - found.value, side, found.frame)


def touching(finger: str | None, subject: Subject, side: str, during: np.ndarray) -> Value:
    """Centimetres from the thumb's tip to a finger's, or to the nearest: the median."""
    tips = {f: _chain(subject, side, f)[-1] for f in ((finger,) if finger else _FINGERS)}
    thumb = _chain(subject, side, "thumb")[-1]
    nearest = np.nanmin(np.stack([subject.length(thumb, tip) for tip in tips.values()]), axis=0)
    return Value(100 * float(np.nanmedian(nearest[during])), side, int(np.flatnonzero(during)[-1]))


def another(finger: str, subject: Subject, side: str, during: np.ndarray) -> Value:
    """Share of the frames in which the thumb touches a finger, that it is not the one that was asked for."""
    thumb = _chain(subject, side, "thumb")[-1]
    apart = np.stack([subject.length(thumb, _chain(subject, side, f)[-1]) for f in _FINGERS])[:, during]
    touches = np.nanmin(apart, axis=0) < _NEAR
    wrong = np.argmin(np.nan_to_num(apart, nan=9.0), axis=0) != _FINGERS.index(finger)
    return Value(100 * float((wrong & touches).sum() / max(touches.sum(), 1)), side, int(np.flatnonzero(during)[-1]))


def lacks_turn(subject: Subject, side: str, during: np.ndarray) -> Value:
    """Degrees that the palm turns, negative so that the worst counts."""
    across = (subject.at(f"{side}_index1") - subject.at(f"{side}_pinky1"))[during]
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    turned = np.degrees(np.arccos(np.clip(across @ across[0], -1, 1)))
    return Value(-float(np.nanmax(turned)), side, int(np.flatnonzero(during)[-1]))


def _frames(subject: Subject, step: Step) -> np.ndarray:
    return subject.during(step, 1.0 if step.label == "wrist_rotate" else _HELD)


def _whole(subject: Subject, side: str) -> bool:
    return subject.has(f"{side}_wrist", *(f"{side}_{finger}{k}" for finger in _ALL for k in (1, 2, 3)))


def _tips(subject: Subject, side: str) -> bool:
    return subject.has(*(f"{side}_{finger}_tip" for finger in _ALL))


def _chain(subject: Subject, side: str, finger: str) -> list[str]:
    """The joints of a finger, with its tip where tips come."""
    return [f"{side}_{finger}{k}" for k in (1, 2, 3)] + ([f"{side}_{finger}_tip"] if _tips(subject, side) else [])


def _in_wrist(subject: Subject, side: str, point: str) -> np.ndarray:
    """(T, 3) m from the wrist, in its frame where it has rotations."""
    wrist = f"{side}_wrist"
    apart = subject.at(point) - subject.at(wrist)
    if not subject.rotated[subject.points.index(wrist)]:
        return apart
    return quaternion_rotate(quaternion_conjugate(subject.turn(wrist)), apart)


def _length(subject: Subject, parent: str, child: str) -> float:
    return float(np.nanmedian(subject.length(parent, child)))


_SEEN = ("data.finite", "anatomy.height", "anatomy.joint_order", "hands.complete")
_FORM = (*_SEEN, "hands.longest", "hands.shortest", "hands.knuckle_order", "hands.thumb_side", "hands.proportions")
_TIMED = ("data.time_increases", "data.time_in_seconds", "data.gaps")


def _hand(name: str, measure: OfSide, unit: str, why: str, most: float | None, after: tuple[str, ...] = ()) -> Check:
    return check_of("hands", name, partial(each_hand, measure), unit, why, before=_SEEN, after=after, most=most)


def _gesture(name: str, label: str, measure: Callable[[Subject, str, np.ndarray], Value], unit: str, why: str,
             most: float | None, after: tuple[str, ...] = (), performer: bool = True) -> Check:  # fmt: skip
    blame = "performer" if performer else "device"
    judged = partial(gesture, label, measure)
    return check_of("hands", name, judged, unit, why, before=_FORM, after=after, most=most, blame=blame)


_check = partial(check_of, "hands")

CHECKS = (
    _check("complete", complete, "joints", "A finger that lacks a joint does not bend.", most=0),
    _check("coverage", coverage, "% missing", "Fingers that are mostly invalid hang.", most=50),
    _hand("longest", size, "m", "Nobody's hand is longer.", 0.28, ("anatomy.height",)),
    _hand("shortest", smallness, "m", "Nobody's hand is shorter.", -0.1, ("anatomy.height",)),
    _hand("bone_constancy", bone_constancy, "%", "Fingers that stretch.", 10),
    _hand(
        "proportions",
        middle_share,
        "doublings",
        "Fingers too long or short for the palm.",
        1.0,
        ("longest", "shortest"),
    ),
    _hand("knuckle_order", knuckle_order, "%", "Fingers that are changed for each other.", 10),
    _hand("thumb_side", thumb_side, "%", "A thumb on the wrong side.", 20, ("knuckle_order",)),
    _hand("chirality", chirality, "%", "A left hand on a right arm.", 20, ("thumb_side", "anatomy.handedness")),
    _hand(
        "wrist_axes",
        wrist_axes,
        "°",
        "A hand that its wrist does not point along.",
        35,
        ("anatomy.component_order", "anatomy.inverse_rotations"),
    ),
    _hand("shake", shake, "mm", "Fingers that tremble.", 2, (*_TIMED, "motion.shake")),
    _hand("pop", pop, "cm", "Fingers that leap.", 15, (*_TIMED, "motion.pop", "longest")),
    _hand("frozen", frozen, "s", "A wrist that hangs while fingers move.", 0.5, ("data.frozen_joint",)),
    _gesture("flat", "flat", bent, "1 − straightness", "The hand is open.", 0.2),
    _gesture("fist", "fist", curled, "straightness", "The hand is a fist.", 0.6),
    *(
        _gesture(f"pinch_{f}", f"pinch_{f}", partial(touching, None), "cm", "The thumb touches a finger.", 100 * _NEAR)
        for f in _FINGERS
    ),
    *(
        _gesture(
            f"pinch_{f}_which",
            f"pinch_{f}",
            partial(another, f),
            "% another",
            "It is the finger that was asked for.",
            40,
            (f"pinch_{f}",),
            performer=False,
        )
        for f in _FINGERS
    ),
    *(
        _gesture(
            f"pinch_{f}_distance",
            f"pinch_{f}",
            partial(touching, f),
            "cm",
            "How near they come.",
            None,
            (f"pinch_{f}",),
        )
        for f in _FINGERS
    ),
    _gesture("wrist_rotate", "wrist_rotate", lacks_turn, "° below", "The hand turns by 60°.", -60),
)
