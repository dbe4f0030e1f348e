"""What checks of scripted poses share: angles of limbs, the head's height, steps of a label.

Who is to blame. The head is what every tracker knows best: where it is where the pose puts it and the limbs are not,
the device is wrong; where the head is not there either, the performer did something else.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from bodysense_conform.check import Check, Unanswered, Value, check_of
from bodysense_conform.subject import Step, Subject

HELD = 0.6  # of a step in which a pose is held: the last part is judged
SIDES = ("left", "right")
_UP = np.array([0.0, 1.0, 0.0])
Measure = Callable[[Subject, np.ndarray], Value | Unanswered]


def flexion(subject: Subject, side: str, parts: tuple[str, str, str]) -> np.ndarray:
    """(T,) degrees by which a limb is bent at its middle joint; 0: straight."""
    a, b, c = (subject.at(f"{side}_{part}") for part in parts)
    return angle(b - a, c - b)


def angle(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(...) degrees between vectors (..., 3)."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v), axis=-1), (u * v).sum(axis=-1)))


def knee(subject: Subject, side: str) -> np.ndarray:
    """(T,) degrees by which a knee is bent."""
    return flexion(subject, side, ("hip", "knee", "ankle"))


def hip(subject: Subject, side: str) -> np.ndarray:
    """(T,) degrees of a thigh from straight down."""
    return angle(subject.at(f"{side}_knee") - subject.at(f"{side}_hip"), np.broadcast_to(-_UP, (len(subject), 3)))


def elevation(subject: Subject, side: str) -> np.ndarray:
    """(T,) degrees of the line from shoulder to wrist over the horizon."""
    arm = subject.at(f"{side}_wrist") - subject.at(f"{side}_shoulder")
    return np.degrees(np.arctan2(arm[:, 1], np.linalg.norm(arm[:, [0, 2]], axis=-1)))


def standing_head(subject: Subject) -> float:
    """Height of the head of the standing body over the floor, m: of step 'stand', else the tallest of the take."""
    steps = subject.labelled("stand", "t_pose", "a_pose")
    head = subject.at("head")[:, 1] - subject.ground
    if steps:
        return float(np.nanmedian(np.concatenate([head[subject.during(step, HELD)] for step in steps])))
    return float(np.nanpercentile(head, 98))


def drop(subject: Subject) -> np.ndarray:
    """(T,) m by which the head is lower than when it stands."""
    return standing_head(subject) - (subject.at("head")[:, 1] - subject.ground)


def held(label: str, measure: Measure, subject: Subject) -> Value | Unanswered:
    """The worst of a measure over the steps of a label, each by its last part."""
    return _each(subject, label, lambda step: measure(subject, subject.during(step, HELD)))


def moved(label: str, measure: Measure, subject: Subject) -> Value | Unanswered:
    """The worst of a measure over the steps of a label, each whole."""
    return _each(subject, label, lambda step: measure(subject, subject.during(step)))


def _each(subject: Subject, label: str, judge: Callable[[Step], Value | Unanswered]) -> Value | Unanswered:
    steps = subject.labelled(label)
    if not steps:
        return Unanswered(f"no step {label!r} in the script")
    if not subject.has("head", "pelvis", *(f"{s}_{p}" for s in SIDES for p in ("hip", "knee", "ankle", "wrist"))):
        return Unanswered("some of the needed joints do not come")
    found = [judge(step) for step in steps if subject.during(step, HELD).sum() >= 5]
    values = [one for one in found if isinstance(one, Value)]
    if not values:
        return next((one for one in found if isinstance(one, Unanswered)), Unanswered("too few frames in the step"))
    return max(values, key=lambda one: one.value)


def middle(values: np.ndarray, during: np.ndarray) -> float:
    """The median over some frames; NaN where nothing is known."""
    return float(np.nanmedian(values[during])) if np.isfinite(values[during]).any() else float("nan")


def last_frame(during: np.ndarray) -> int:
    """The last of some frames."""
    return int(np.flatnonzero(during)[-1])


_BODY = (
    "data.joints_present",
    "data.windows_wellformed",
    "data.windows_covered",
    "data.time_increases",
    "anatomy.height",
    "anatomy.up_axis",
    "anatomy.joint_order",
    "motion.floor_level",
    "motion.under_floor",
    "motion.hover",
)


def pose_check(
    name: str,
    way: Callable[..., Value | Unanswered],
    label: str,
    measure: Callable[..., Any],
    unit: str,
    why: str,
    most: float | None,
    after: tuple[str, ...] = (),
    performer: bool = False,
) -> Check:
    """A check of group poses, which needs a body that stands on a floor, and its script.

    `way` is `held` or `moved`: how the steps of the label are judged by the measure.
    """
    blame = "performer" if performer else "device"
    judged = partial(way, label, measure)
    return check_of("poses", name, judged, unit, why, before=_BODY, after=after, most=most, blame=blame)
