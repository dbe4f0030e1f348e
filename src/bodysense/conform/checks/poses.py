"""Scripted poses: does the body do what the performer did?

Who is to blame. The head is what every tracker knows best: where it is where the pose puts it and the limbs are not,
the device is wrong; where the head is not there either, the performer did something else.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from bodysense.conform.check import Check, Unanswered, Value
from bodysense.conform.subject import Step, Subject

_HELD = 0.6  # of a step in which a pose is held: the last part is judged
_SIDES = ("left", "right")
_UP = np.array([0.0, 1.0, 0.0])
Angles = Callable[[Subject, np.ndarray], Value | Unanswered]


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
        return float(np.nanmedian(np.concatenate([head[subject.during(step, _HELD)] for step in steps])))
    return float(np.nanpercentile(head, 98))


def drop(subject: Subject) -> np.ndarray:
    """(T,) m by which the head is lower than when it stands."""
    return standing_head(subject) - (subject.at("head")[:, 1] - subject.ground)


def held(label: str, measure: Angles, subject: Subject) -> Value | Unanswered:
    """The worst of a measure over the steps of a label, each by its last part."""
    return _each(subject, label, lambda step: measure(subject, subject.during(step, _HELD)))


def moved(label: str, measure: Angles, subject: Subject) -> Value | Unanswered:
    """The worst of a measure over the steps of a label, each whole."""
    return _each(subject, label, lambda step: measure(subject, subject.during(step)))


def _each(subject: Subject, label: str, judge: Callable[[Step], Value | Unanswered]) -> Value | Unanswered:
    steps = subject.labelled(label)
    if not steps:
        return Unanswered(f"no step {label!r} in the script")
    if not subject.has("head", "pelvis", *(f"{s}_{p}" for s in _SIDES for p in ("hip", "knee", "ankle", "wrist"))):
        return Unanswered("some of the needed joints do not come")
    found = [judge(step) for step in steps if subject.during(step, _HELD).sum() >= 5]
    values = [one for one in found if isinstance(one, Value)]
    if not values:
        return next((one for one in found if isinstance(one, Unanswered)), Unanswered("too few frames in the step"))
    return max(values, key=lambda one: one.value)


def _mid(values: np.ndarray, during: np.ndarray) -> float:
    return float(np.nanmedian(values[during])) if np.isfinite(values[during]).any() else float("nan")


def trunk_lean(subject: Subject, during: np.ndarray) -> Value:
    """Degrees of the trunk from upright."""
    trunk = subject.at("head") - subject.at("pelvis")
    return Value(_mid(angle(trunk, np.broadcast_to(_UP, trunk.shape)), during))


def knees_bent(subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which the more bent knee of who stands is bent; the head says whether the performer bent it."""
    bent = {side: _mid(knee(subject, side), during) for side in _SIDES}
    side = max(bent, key=lambda name: bent[name])
    lower = _mid(drop(subject), during) > 0.12
    return Value(bent[side], f"{side}_knee", _first(during), "performer" if lower else "device")


def feet_off_floor(subject: Subject, during: np.ndarray) -> Value:
    """Centimetres from the floor of the foot that is farther from it."""
    off = {}
    for side in _SIDES:
        low = np.nanmin(np.stack([subject.at(n)[:, 1] for n in subject.feet if n.startswith(side)]), axis=0)
        off[side] = 100 * abs(_mid(low - subject.ground, during))
    side = max(off, key=lambda name: off[name])
    return Value(off[side], side, _first(during))


def arms_from(subject: Subject, during: np.ndarray, wanted: float) -> Value:
    """Degrees by which the arm that is farther off is from its elevation."""
    off = {side: abs(_mid(elevation(subject, side), during) - wanted) for side in _SIDES}
    side = max(off, key=lambda name: off[name])
    return Value(off[side], f"{side}_wrist", _first(during))


def elbows_bent(subject: Subject, during: np.ndarray) -> Value | Unanswered:
    """Degrees by which the more bent elbow is bent, in a pose of straight arms."""
    bent = {side: _mid(flexion(subject, side, ("shoulder", "elbow", "wrist")), during) for side in _SIDES}
    side = max(bent, key=lambda name: bent[name])
    return Value(bent[side], f"{side}_elbow", _first(during))


def asymmetry(subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which the arms' elevations differ."""
    left, right = (_mid(elevation(subject, side), during) for side in _SIDES)
    return Value(abs(left - right), "", _first(during))


def repeats(label: str, subject: Subject) -> Value | Unanswered:
    """Degrees by which the arms of the first and the last step of a label differ."""
    steps = subject.labelled(label)
    if len(steps) < 2 or not subject.has("left_wrist", "right_wrist"):
        return Unanswered(f"fewer than two steps {label!r} in the script")
    ends = [subject.during(step, _HELD) for step in (steps[0], steps[-1])]
    offs = [abs(_mid(elevation(subject, s), ends[0]) - _mid(elevation(subject, s), ends[1])) for s in _SIDES]
    return Value(max(offs))


def squat_depth(subject: Subject, during: np.ndarray) -> Value:
    """How far the head goes down, as a share of its standing height: the least of what counts as a squat."""
    return Value(-100 * float(np.nanmax(drop(subject)[during])) / standing_head(subject), "", _deepest(subject, during))


def squat_knees(subject: Subject, during: np.ndarray) -> Value | Unanswered:
    """Degrees by which the knees lack what the head's way down asks for, were the trunk upright and bent by 60°."""
    frame = _deepest(subject, during)
    legs = np.mean([np.nanmedian(subject.length(f"{s}_hip", f"{s}_knee")) for s in _SIDES])
    legs += np.mean([np.nanmedian(subject.length(f"{s}_knee", f"{s}_ankle")) for s in _SIDES])
    trunk = float(np.nanmedian(subject.length("pelvis", "head")))
    # What bending the trunk forward by 60° explains; the legs must explain the rest.
    rest = float(drop(subject)[frame]) - 0.5 * trunk
    if rest < 0.05:
        return Unanswered("the head goes down no further than a bow")
    needed = 2 * np.degrees(np.arccos(np.clip(1 - rest / legs, 0, 1)))
    return Value(float(needed - max(knee(subject, side)[frame] for side in _SIDES)), "knees", frame)


def squat_symmetry(subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which the knees differ at the deepest frame; ankles at other heights say that the performer did."""
    frame = _deepest(subject, during)
    left, right = (float(knee(subject, side)[frame]) for side in _SIDES)
    ankles = abs(float(subject.at("left_ankle")[frame, 1] - subject.at("right_ankle")[frame, 1]))
    return Value(abs(left - right), "knees", frame, "performer" if ankles > 0.08 else "device")


def feet_stay(subject: Subject, during: np.ndarray) -> Value:
    """Centimetres by which an ankle strays from its median place on the floor."""
    off = {}
    for side in _SIDES:
        place = subject.at(f"{side}_ankle")[during][:, [0, 2]]
        off[side] = 100 * float(np.nanpercentile(np.linalg.norm(place - np.nanmedian(place, axis=0), axis=-1), 95))
    side = max(off, key=lambda name: off[name])
    return Value(off[side], f"{side}_ankle", _first(during))


def squats_alike(subject: Subject, during: np.ndarray) -> Value | Unanswered:
    """How much the thighs' angle of the two deepest squats of a step differs, as a share."""
    bent = np.mean([hip(subject, side) for side in _SIDES], axis=0)[during]
    bent = bent - np.nanpercentile(bent, 5)
    down = np.nan_to_num(bent) > 0.5 * np.nanmax(bent)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], down, [False]]).astype(np.int8)))
    peaks = [float(np.nanmax(bent[a:b])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    if len(peaks) < 2:
        return Unanswered("fewer than two squats")
    return Value(100 * abs(peaks[0] - peaks[1]) / max(peaks[:2]))


def lacks_raise(side: str, subject: Subject, during: np.ndarray) -> Value:
    """The highest elevation of an arm, negative so that the worst counts."""
    return Value(-float(np.nanmax(elevation(subject, side)[during])), f"{side}_wrist", _first(during))


def lacks_lift(side: str, subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which a thigh is raised, negative so that the worst counts."""
    swept = hip(subject, side)[during]
    return Value(-float(np.nanpercentile(swept, 95) - np.nanpercentile(swept, 5)), f"{side}_hip", _first(during))


def hands_over_head(subject: Subject, during: np.ndarray) -> Value:
    """Centimetres by which the lower hand is under the head's joint."""
    off = {s: 100 * _mid(subject.at("head")[:, 1] - subject.at(f"{s}_wrist")[:, 1], during) for s in _SIDES}
    side = max(off, key=lambda name: off[name])
    return Value(off[side], f"{side}_wrist", _first(during))


def crosstalk(side: str, subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which the leg that stands moves while the other is raised."""
    other = "right" if side == "left" else "left"
    bent = hip(subject, other)[during]
    return Value(float(np.nanpercentile(bent, 95) - np.nanpercentile(bent, 5)), f"{other}_hip", _first(during))


def march_lifts(subject: Subject, during: np.ndarray) -> Value:
    """Degrees that the thigh that is raised less sweeps, negative so that the worst counts."""
    return max((lacks_lift(side, subject, during) for side in _SIDES), key=lambda one: one.value)


def march_in_phase(subject: Subject, during: np.ndarray) -> Value | Unanswered:
    """Correlation of both thighs' angles: −1 when one goes up as the other goes down."""
    left, right = (np.nan_to_num(hip(subject, side)[during]) for side in _SIDES)
    if len(left) < 20 or left.std() < 1 or right.std() < 1:
        return Unanswered("too few frames, or a leg that does not move")
    return Value(float(np.corrcoef(left, right)[0, 1]), "", _first(during))


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
    return Value(float(np.nanmax(np.linalg.norm(place - place[0], axis=-1))), "pelvis", _first(during))


def sits_high(subject: Subject, during: np.ndarray) -> Value:
    """How far the head is down, as a share of its standing height, negative so that the worst counts."""
    return Value(-100 * _mid(drop(subject), during) / standing_head(subject), "head", _first(during))


def sitting_knees(subject: Subject, during: np.ndarray) -> Value:
    """Degrees by which the less bent knee of who sits is from 90°."""
    off = {side: abs(_mid(knee(subject, side), during) - 90) for side in _SIDES}
    side = max(off, key=lambda name: off[name])
    return Value(off[side], f"{side}_knee", _first(during))


def _first(during: np.ndarray) -> int:
    return int(np.flatnonzero(during)[-1])


def _deepest(subject: Subject, during: np.ndarray) -> int:
    down = np.where(during, np.nan_to_num(drop(subject), nan=-9.0), -9.0)
    return int(np.argmax(down))


_BODY = ("data.joints_present", "data.windows_wellformed", "data.windows_covered", "data.time_increases",
         "anatomy.height", "anatomy.up_axis", "anatomy.joint_order", "motion.floor_level")  # fmt: skip


def _pose(name: str, measure: Callable[[Subject], Value | Unanswered], unit: str, why: str, most: float | None,
          after: tuple[str, ...] = (), performer: bool = False) -> Check:  # fmt: skip
    blame = "performer" if performer else "device"
    return Check(f"poses.{name}", measure, unit, why, most=most, blame=blame, after=(*_BODY, *after))


def _at(wanted: float) -> Angles:
    return lambda subject, during: arms_from(subject, during, wanted)


CHECKS = (
    _pose("stand_upright", partial(held, "stand", trunk_lean), "°", "Who stands is upright.", 15),
    _pose("stand_knees", partial(held, "stand", knees_bent), "°", "Who stands has straight knees.", 25),
    _pose("stand_feet", partial(held, "stand", feet_off_floor), "cm", "Who stands has both feet on the floor.", 6),
    _pose("stand_arms", partial(held, "stand", _at(-90)), "° from hanging", "Arms hang.", 40, performer=True),
    _pose("t_pose_held", partial(held, "t_pose", _at(0)), "° from level", "Arms are level.", 25, performer=True),
    _pose("t_pose_elbows", partial(held, "t_pose", elbows_bent), "°", "Straight arms are straight.", 30,
          ("poses.t_pose_held",)),
    _pose("t_pose_symmetry", partial(held, "t_pose", asymmetry), "°", "Arms droop alike.", None),
    _pose("t_pose_repeats", partial(repeats, "t_pose"), "°", "The same pose, later, is the same.", None),
    _pose("squat_deep", partial(moved, "squat", squat_depth), "% of height", "The head goes down.", -12,
          performer=True),
    _pose("squat_knees", partial(moved, "squat", squat_knees), "° too straight", "Who squats bends the knees.", 15,
          ("poses.squat_deep",)),
    _pose("squat_symmetry", partial(moved, "squat", squat_symmetry), "°", "Both knees bend alike.", 15,
          ("poses.squat_deep",)),
    _pose("squat_feet", partial(moved, "squat", feet_stay), "cm", "Feet stay where they are.", 10,
          ("poses.squat_deep",)),
    _pose("squats_alike", partial(moved, "squat", squats_alike), "%", "Two squats look alike.", 25,
          ("poses.squat_deep", "poses.squat_knees")),
    _pose("arms_up", partial(held, "arms_up", hands_over_head), "cm under the head", "Hands are over the head.", -10,
          performer=True),
    _pose("arms_up_elbows", partial(held, "arms_up", elbows_bent), "°", "Raised arms are straight.", 45,
          ("poses.arms_up",)),
    *(_pose(f"{side}_arm_raise", partial(moved, f"{side}_arm_raise", partial(lacks_raise, side)), "° below",
            "The arm is raised by 60°.", -60, performer=True) for side in _SIDES),
    *(_pose(f"{side}_leg_raise", partial(moved, f"{side}_leg_raise", partial(lacks_lift, side)), "° below",
            "The leg is raised by 15°.", -15, performer=True) for side in _SIDES),
    *(_pose(f"{side}_leg_crosstalk", partial(moved, f"{side}_leg_raise", partial(crosstalk, side)), "°",
            "The other leg stands.", None) for side in _SIDES),
    _pose("march_lifts", partial(moved, "march", march_lifts), "° below", "Knees go up.", -15, performer=True),
    _pose("march_antiphase", partial(moved, "march", march_in_phase), "", "One knee after the other.", 0,
          ("poses.march_lifts",)),
    _pose("march_cadence", partial(moved, "march", march_cadence), "%", "The beat is steady.", 25,
          ("poses.march_lifts", "poses.march_antiphase"), performer=True),
    _pose("march_in_place", partial(moved, "march", goes_away), "m", "The marcher stays.", 0.6, performer=True),
    _pose("sit_down", partial(held, "sit", sits_high), "% of height", "The head is lower.", -12, performer=True),
    _pose("sit_knees", partial(held, "sit", sitting_knees), "° from 90", "Who sits has bent knees.", 40,
          ("poses.sit_down",)),
    _pose("sit_feet", partial(held, "sit", feet_off_floor), "cm", "Who sits has the feet on the floor.", 10,
          ("poses.sit_down",)),
)  # fmt: skip
