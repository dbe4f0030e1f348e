"""Blending a limb at a time: which sensors came or went, and how each limb goes on from what was output."""

from dataclasses import dataclass, field
from math import exp

import numpy as np

from .ease import FASTEST, Ease
from .limbs import LIMBS, Limb, Task
from .points import BODY, PELVIS, SPINE3, WRISTS, at
from .tracked import Tracked
from .trunk import Body
from .vectors import heading, limited, mix

BLEND = 0.25  # s in which predicted joints are eased after sensors of their group came or went

# A lost wrist or ankle continues with its velocity, which decays in LEAVING s, and blends into the prediction. Half of
# the distance remains after KEPT s, or for a raised arm after KEPT_RAISED s in which the head moves.
LEAVING, KEPT_LEG, KEPT_ARM, KEPT_RAISED = 0.08, 0.12, 0.35, 3.0
STEEPEST_ARM = 3.0  # m/s: largest speed of a hand relative to its goal when it is found or lost

# The group of each joint of the body: its limb, else the trunk. A hip is of its leg, a collar of the trunk.
GROUP = ["trunk"] * BODY
for _name, _limb in LIMBS.items():
    for _joint in (_limb.start, _limb.middle, _limb.end):
        GROUP[_joint] = _name
for _side in ("left", "right"):
    GROUP[at(f"{_side}_foot")] = f"{_side}_leg"
_SITES = {at("left_toe"): "left_leg", at("right_toe"): "right_leg", at("head_top"): "trunk"}


def _zeros() -> np.ndarray:
    return np.zeros(3)


@dataclass
class LimbState:
    """The memory of a limb. Vectors are in the heading of the body, from the limb's start."""

    end: Ease = field(default_factory=Ease)
    middle: Ease = field(default_factory=Ease)
    end_output: np.ndarray = field(default_factory=_zeros)  # m, in the frame before
    end_speed: np.ndarray = field(default_factory=_zeros)  # m/s
    middle_output: np.ndarray = field(default_factory=_zeros)
    middle_speed: np.ndarray = field(default_factory=_zeros)
    # m, world: how floor, pelvis and collar moved them, from their start and in place.
    end_shift: np.ndarray = field(default_factory=_zeros)
    middle_shift: np.ndarray = field(default_factory=_zeros)
    end_held: np.ndarray = field(default_factory=_zeros)
    middle_held: np.ndarray = field(default_factory=_zeros)
    end_kept: np.ndarray = field(default_factory=_zeros)  # m: where the end was last seen
    end_leaving: np.ndarray = field(default_factory=_zeros)  # m/s: how fast it then moved
    middle_kept: np.ndarray = field(default_factory=_zeros)
    lost: float | None = None  # s since the end was last seen; None: never, or not kept
    waned: float = 0.0  # s as `waning` counts them, by which the end is given up
    stood: float = 0.0  # s for which points that stand in for the end have been seen
    seen: int = 0  # 2: the end, 1: points that stand in for it, 0: neither
    middle_seen: bool = False
    pull: Ease = field(default_factory=Ease)  # m, of a shoulder that its collar gives
    pulled: np.ndarray = field(default_factory=_zeros)  # m, how far it was given
    pulled_speed: np.ndarray = field(default_factory=_zeros)  # m/s
    pulling: tuple[bool, bool] = (False, False)  # which measured joints of the arm pulled it


def find_changes(seen: Tracked, had_position: np.ndarray, had_rotation: np.ndarray) -> set[str]:
    """Groups with a sensor that came or went. A change of the trunk is one of all limbs; fingers are in none."""
    changed = {GROUP[j] for j in range(BODY) if seen.has_position[j] != had_position[j]}
    changed |= {GROUP[j] for j in range(BODY) if seen.turned(j) != had_rotation[j] and j not in WRISTS}
    changed |= {group for point, group in _SITES.items() if seen.has_position[point] != had_position[point]}
    return {*changed, *LIMBS} if "trunk" in changed else changed


def find_stand_ins(seen: Tracked, ease: float, begun: bool, states: dict[str, LimbState]) -> None:
    """Find which limbs have points that stand in for their ends: a finger only after `ease` seconds in sight."""
    for name, limb in LIMBS.items():
        has, state = bool(seen.has_position[list(limb.stand_in)].any()), states[name]
        state.stood = 0.0 if not has else state.stood + seen.interval if begun else ease
        if has and (limb.kind == "leg" or state.stood >= ease):
            seen.stands_in.add(name)


def limb_heading(body: Body, limb: Limb) -> np.ndarray:
    """The heading that a limb is eased in: the chest's for arms, the pelvis's for legs."""
    return heading(body.rotation[PELVIS if limb.kind == "leg" else SPINE3])


def _kept_share(task: Task, seen: Tracked, limb: Limb, state: LimbState) -> float:
    """Let a lost end wane for a frame, and return the share left of where it was last seen: 2^(-2 u² / (1 + u))."""
    half, raised = KEPT_LEG, 0.0
    if limb.kind == "arm":
        raised = min(max((state.end_kept[1] / task.longest + 0.1) / 0.4, 0.0), 1.0)
        half = KEPT_ARM + (KEPT_RAISED - KEPT_ARM) * raised
    state.waned += seen.interval + (seen.waning - seen.interval) * raised
    u = state.waned / half
    return 2 ** (-2 * u * u / (1 + u))


def ease_limb(
    task: Task, seen: Tracked, ease: float, limb: Limb, changed: bool, turn: np.ndarray, begun: bool, state: LimbState
) -> None:
    """Ease a limb's task, and keep an end that is lost where it was last seen for a while.

    `turn` is world ← heading.
    """
    now = 2 if task.end_seen else int(limb.name in seen.stands_in)
    end, middle = turn.T @ task.end, turn.T @ task.middle
    found = begun and now > state.seen
    if begun and now < state.seen and now == 0 and not task.middle_seen:
        state.end_kept, state.middle_kept = state.end_output, state.middle_output
        state.end_leaving, state.lost = limited(state.end_speed, FASTEST), 0.0
        state.waned = 0.0
        state.end.stop()  # what is kept is what was output, eased or not
        state.middle.stop()
    if now > 0 or task.middle_seen or not begun:
        state.lost = None
    if state.lost is not None:
        state.lost += seen.interval
        share = _kept_share(task, seen, limb, state)
        gone = LEAVING * (1 - exp(-state.lost / LEAVING))
        end = mix(end, state.end_kept + state.end_leaving * gone, share)
        middle = mix(middle, state.middle_kept + state.end_leaving * gone / 2, share)
    free = state.lost is None
    end_breaks = found or (begun and free and now != state.seen) or (changed and free and now == 0)
    middle_found = begun and task.middle_seen and not state.middle_seen
    middle_breaks = begun and (
        task.middle_seen != state.middle_seen or (not task.middle_seen and (found or (changed and free)))
    )
    # A joint that is measured again keeps the shifts that held or pulled its predicted position.
    end_before = state.end_output + found * (turn.T @ state.end_held)
    middle_before = state.middle_output + middle_found * (turn.T @ state.middle_held)
    steepest = STEEPEST_ARM if limb.kind == "arm" else 0.0
    span = ease if now > 0 else BLEND
    end = state.end.vector(end, end_before, state.end_speed, seen.interval, end_breaks, span, steepest)
    span = ease if task.middle_seen else BLEND
    speed = state.middle_speed
    middle = state.middle.vector(middle, middle_before, speed, seen.interval, middle_breaks, span, steepest)
    task.end, task.middle = turn @ end, turn @ middle
    state.seen, state.middle_seen = now, task.middle_seen


def remember_limb(body: Body, limb: Limb, interval: float, begun: bool, state: LimbState) -> None:
    """Remember what a limb output, but for what floor, pelvis and collar added."""
    back, start = limb_heading(body, limb).T, body.point[limb.start]
    end = back @ (body.point[limb.end] - start - state.end_shift)
    middle = back @ (body.point[limb.middle] - start - state.middle_shift)
    rate = 1 / interval if begun else 0.0
    state.end_speed, state.middle_speed = (end - state.end_output) * rate, (middle - state.middle_output) * rate
    state.end_output, state.middle_output = end, middle
