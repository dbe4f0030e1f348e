"""Exercises: does the body squat, raise its limbs and march as the performer did?"""

from __future__ import annotations

from functools import partial

import numpy as np

from bodysense.body.gaps import runs
from bodysense_conform.check import Unanswered, Value
from bodysense_conform.checks.steps import (
    SIDES,
    drop,
    elevation,
    hip,
    knee,
    last_frame,
    moved,
    pose_check,
    standing_head,
)
from bodysense_conform.subject import Subject


def squat_depth(subject: Subject, during: np.ndarray) -> Value:
    """How far the head goes down, as a share of its standing height: the least of what counts as a squat."""
    return Value(-100 * float(np.nanmax(drop(subject)[during])) / standing_head(subject), "", _deepest(subject, during))


def squat_knees(subject: Subject, during: np.ndarray) -> Value | Unanswered:
    """Degrees by which the knees lack what the head's way down asks for, were the trunk upright and bent by 60°."""
    frame = _deepest(subject, during)
    legs = np.mean([np.nanmedian(subject.length(f"{s}_hip", f"{s}_knee")) for s in SIDES])
    legs += np.mean([np.nanmedian(subject.length(f"{s}_knee", f"{s}_ankle")) for s in SIDES])
    trunk = float(np.nanmedian(subject.length("pelvis", "head")))
    # What bending the trunk forward by 60° explains; the legs must explain the rest.
    rest = float(drop(subject)[frame]) - 0.5 * trunk
    if rest < 0.05:
        return Unanswered("the head goes down no further than a bow")
    needed = 2 * np.degrees(np.arccos(np.clip(1 - rest / legs, 0, 1)))
    return Value(float(needed - max(knee(subject, side)[frame] for side in SIDES)), "knees", frame)


def squat_symmetry(subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which the knees differ at the deepest frame; ankles at other heights say that the performer did."""
    frame = _deepest(subject, during)
    left, right = (float(knee(subject, side)[frame]) for side in SIDES)
    ankles = abs(float(subject.at("left_ankle")[frame, 1] - subject.at("right_ankle")[frame, 1]))
    return Value(abs(left - right), "knees", frame, "performer" if ankles > 0.08 else "device")


def feet_stay(subject: Subject, during: np.ndarray) -> Value:
    """Centimetres by which an ankle strays from its median place on the floor."""
    off = {}
    for side in SIDES:
        place = subject.at(f"{side}_ankle")[during][:, [0, 2]]
        off[side] = 100 * float(np.nanpercentile(np.linalg.norm(place - np.nanmedian(place, axis=0), axis=-1), 95))
    side = max(off, key=lambda name: off[name])
    return Value(off[side], f"{side}_ankle", last_frame(during))


def squats_alike(subject: Subject, during: np.ndarray) -> Value | Unanswered:
    """How much the thighs' angle of the two deepest squats of a step differs, as a share."""
    bent = np.mean([hip(subject, side) for side in SIDES], axis=0)[during]
    bent = bent - np.nanpercentile(bent, 5)
    down = np.nan_to_num(bent) > 0.5 * np.nanmax(bent)
    peaks = [float(np.nanmax(bent[a:b])) for a, b in runs(down)]
    if len(peaks) < 2:
        return Unanswered("fewer than two squats")
    return Value(100 * abs(peaks[0] - peaks[1]) / max(peaks[:2]))


def lacks_raise(side: str, subject: Subject, during: np.ndarray) -> Value:
    """The highest elevation of an arm, negative so that the worst counts."""
    return Value(-float(np.nanmax(elevation(subject, side)[during])), f"{side}_wrist", last_frame(during))


def lacks_lift(side: str, subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which a thigh is raised, negative so that the worst counts."""
    swept = hip(subject, side)[during]
    return Value(-float(np.nanpercentile(swept, 95) - np.nanpercentile(swept, 5)), f"{side}_hip", last_frame(during))


def crosstalk(side: str, subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which the leg that stands moves while the other is raised."""
    other = "right" if side == "left" else "left"
    bent = hip(subject, other)[during]
    return Value(float(np.nanpercentile(bent, 95) - np.nanpercentile(bent, 5)), f"{other}_hip", last_frame(during))


def march_lifts(subject: Subject, during: np.ndarray) -> Value:
    """Degrees that the thigh that is raised less sweeps, negative so that the worst counts."""
    return max((lacks_lift(side, subject, during) for side in SIDES), key=lambda one: one.value)


def march_in_phase(subject: Subject, during: np.ndarray) -> Value | Unanswered:
    """Correlation of both thighs' angles: −1 when one goes up as the other goes down."""
    left, right = (np.nan_to_num(hip(subject, side)[during]) for side in SIDES)
    if len(left) < 20 or left.std() < 1 or right.std() < 1:
        return Unanswered("too few frames, or a leg that does not move")
    return Value(float(np.corrcoef(left, right)[0, 1]), "", last_frame(during))


def march_cadence(subject: Subject, during: np.ndarray) -> Value | Unanswered:
    """Coefficient of variation of the time between lifts of the left thigh."""
    bent = hip(subject, "left")[during]
    middle = (np.nanpercentile(bent, 95) + np.nanpercentile(bent, 5)) / 2
    lifts = np.flatnonzero((bent[1:] > middle) & (bent[:-1] <= middle))
    if len(lifts) < 4:
        return Unanswered("fewer than four lifts of the left knee")
    between = np.diff(subject.time[during][lifts])
    return Value(100 * float(between.std() / between.mean()))


def goes_away(subject: Subject, during: np.ndarray) -> Value:
    """Metres between the pelvis's farthest places on the floor and its first."""
    place = subject.at("pelvis")[during][:, [0, 2]]
    return Value(float(np.nanmax(np.linalg.norm(place - place[0], axis=-1))), "pelvis", last_frame(during))


def _deepest(subject: Subject, during: np.ndarray) -> int:
    down = np.where(during, np.nan_to_num(drop(subject), nan=-9.0), -9.0)
    return int(np.argmax(down))


CHECKS = (
    pose_check("squat_deep", moved, "squat", squat_depth, "% of height", "The head goes down.", -12, performer=True),
    pose_check(
        "squat_knees", moved, "squat", squat_knees, "° too straight", "Who squats bends the knees.", 15, ("squat_deep",)
    ),
    pose_check("squat_symmetry", moved, "squat", squat_symmetry, "°", "Both knees bend alike.", 15, ("squat_deep",)),
    pose_check("squat_feet", moved, "squat", feet_stay, "cm", "Feet stay where they are.", 10, ("squat_deep",)),
    pose_check(
        "squats_alike", moved, "squat", squats_alike, "%", "Two squats look alike.", 25, ("squat_deep", "squat_knees")
    ),
    *(
        pose_check(
            f"{side}_arm_raise",
            moved,
            f"{side}_arm_raise",
            partial(lacks_raise, side),
            "° below",
            "The arm is raised by 60°.",
            -60,
            performer=True,
        )
        for side in SIDES
    ),
    *(
        pose_check(
            f"{side}_leg_raise",
            moved,
            f"{side}_leg_raise",
            partial(lacks_lift, side),
            "° below",
            "The leg is raised by 15°.",
            -15,
            performer=True,
        )
        for side in SIDES
    ),
    *(
        pose_check(
            f"{side}_leg_crosstalk",
            moved,
            f"{side}_leg_raise",
            partial(crosstalk, side),
            "°",
            "The other leg stands.",
            None,
        )
        for side in SIDES
    ),
    pose_check("march_lifts", moved, "march", march_lifts, "° below", "Knees go up.", -15, performer=True),
    pose_check("march_antiphase", moved, "march", march_in_phase, "", "One knee after the other.", 0, ("march_lifts",)),
    pose_check(
        "march_cadence",
        moved,
        "march",
        march_cadence,
        "%",
        "The beat is steady.",
        25,
        ("march_lifts", "march_antiphase"),
        performer=True,
    ),
    pose_check("march_in_place", moved, "march", goes_away, "m", "The marcher stays.", 0.6, performer=True),
)
