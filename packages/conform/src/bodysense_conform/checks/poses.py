"""Held poses: does the body stand, reach and sit as the performer did?"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bodysense_conform.check import Unanswered, Value
from bodysense_conform.checks.steps import (
    HELD,
    SIDES,
    Measure,
    angle,
    drop,
    elevation,
    flexion,
    held,
    knee,
    last_frame,
    middle,
    pose_check,
    standing_head,
)
from bodysense_conform.subject import Subject

_UP = np.array([0.0, 1.0, 0.0])


def trunk_lean(subject: Subject, during: np.ndarray) -> Value:
    """Degrees of the trunk from upright."""
    trunk = subject.at("head") - subject.at("pelvis")
    return Value(middle(angle(trunk, np.broadcast_to(_UP, trunk.shape)), during))


def knees_bent(subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which the more bent knee of who stands is bent; the head says whether the performer bent it."""
    bent = {side: middle(knee(subject, side), during) for side in SIDES}
    side = max(bent, key=lambda name: bent[name])
    lower = middle(drop(subject), during) > 0.12
    return Value(bent[side], f"{side}_knee", last_frame(during), "performer" if lower else "device")


def feet_off_floor(subject: Subject, during: np.ndarray) -> Value:
    """Centimetres from the floor of the foot that is farther from it."""
    off = {}
    for side in SIDES:
        low = np.nanmin(np.stack([subject.at(n)[:, 1] for n in subject.feet if n.startswith(side)]), axis=0)
        off[side] = 100 * abs(middle(low - subject.ground, during))
    side = max(off, key=lambda name: off[name])
    return Value(off[side], side, last_frame(during))


def arms_from(subject: Subject, during: np.ndarray, wanted: float) -> Value:
    """Degrees by which the arm that is farther off is from its elevation."""
    off = {side: abs(middle(elevation(subject, side), during) - wanted) for side in SIDES}
    side = max(off, key=lambda name: off[name])
    return Value(off[side], f"{side}_wrist", last_frame(during))


def elbows_bent(subject: Subject, during: np.ndarray) -> Value | Unanswered:
    """Degrees by which the more bent elbow is bent, in a pose of straight arms."""
    bent = {side: middle(flexion(subject, side, ("shoulder", "elbow", "wrist")), during) for side in SIDES}
    side = max(bent, key=lambda name: bent[name])
    return Value(bent[side], f"{side}_elbow", last_frame(during))


def asymmetry(subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which the arms' elevations differ."""
    left, right = (middle(elevation(subject, side), during) for side in SIDES)
    return Value(abs(left - right), "", last_frame(during))


def repeats(label: str, angle_of: Callable[[Subject, str], np.ndarray], subject: Subject) -> Value | Unanswered:
    """Degrees by which an angle of the arms in the first and the last step of a label differs."""
    steps = subject.labelled(label)
    if len(steps) < 2 or not subject.has("left_wrist", "right_wrist"):
        return Unanswered(f"fewer than two steps {label!r} in the script")
    ends = [subject.during(step, HELD) for step in (steps[0], steps[-1])]
    offs = [abs(middle(angle_of(subject, s), ends[0]) - middle(angle_of(subject, s), ends[1])) for s in SIDES]
    return Value(max(offs))


def hands_over_head(subject: Subject, during: np.ndarray) -> Value:
    """Centimetres by which the lower hand is under the head's joint."""
    off = {s: 100 * middle(subject.at("head")[:, 1] - subject.at(f"{s}_wrist")[:, 1], during) for s in SIDES}
    side = max(off, key=lambda name: off[name])
    return Value(off[side], f"{side}_wrist", last_frame(during))


def sits_high(subject: Subject, during: np.ndarray) -> Value:
    """How far the head is down, as a share of its standing height, negative so that the worst counts."""
    return Value(-100 * middle(drop(subject), during) / standing_head(subject), "head", last_frame(during))


def sitting_knees(subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which the less bent knee of who sits is from 90°."""
    off = {side: abs(middle(knee(subject, side), during) - 90) for side in SIDES}
    side = max(off, key=lambda name: off[name])
    return Value(off[side], f"{side}_knee", last_frame(during))


def _at(wanted: float) -> Measure:
    return lambda subject, during: arms_from(subject, during, wanted)


CHECKS = (
    pose_check("stand_upright", held, "stand", trunk_lean, "°", "Who stands is upright.", 15),
    pose_check("stand_knees", held, "stand", knees_bent, "°", "Who stands has straight knees.", 25),
    pose_check("stand_feet", held, "stand", feet_off_floor, "cm", "Who stands has both feet on the floor.", 6),
    pose_check("stand_arms", held, "stand", _at(-90), "° from hanging", "Arms hang.", 40, performer=True),
    pose_check("t_pose_held", held, "t_pose", _at(0), "° from level", "Arms are level.", 25, performer=True),
    pose_check("t_pose_elbows", held, "t_pose", elbows_bent, "°", "Straight arms are straight.", 30, ("t_pose_held",)),
    pose_check("t_pose_symmetry", held, "t_pose", asymmetry, "°", "Arms droop alike.", None),
    pose_check("t_pose_repeats", repeats, "t_pose", elevation, "°", "The same pose, later, is the same.", None),
    pose_check(
        "arms_up",
        held,
        "arms_up",
        hands_over_head,
        "cm under the head",
        "Hands are over the head.",
        -10,
        performer=True,
    ),
    pose_check("arms_up_elbows", held, "arms_up", elbows_bent, "°", "Raised arms are straight.", 45, ("arms_up",)),
    pose_check("sit_down", held, "sit", sits_high, "% of height", "The head is lower.", -12, performer=True),
    pose_check("sit_knees", held, "sit", sitting_knees, "° from 90", "Who sits has bent knees.", 40, ("sit_down",)),
    pose_check("sit_feet", held, "sit", feet_off_floor, "cm", "Who sits has the feet on the floor.", 10, ("sit_down",)),
)
