"""Arms: from a shoulder that may be pulled by its collar to a measured or predicted wrist."""

from dataclasses import replace
from math import exp

import numpy as np

from .blend import BLEND, LimbState, ease_limb, limb_heading
from .limbs import Limb, Task, limb_goal, solve_limb, turn_limb
from .tracked import Tracked
from .trunk import Body
from .vectors import STRAIGHT, length, limited, mix, reach, turn_between, turned_by, turned_onto, unit

SHOULDER_DOUBT = 25.0  # 1/m: a shoulder 4 cm off turns its collar half as far as a sure one
COLLAR_GIVES = 0.8  # of a collar's length: what it gives an arm that is too short
KEPT_WRIST = 10.0  # s: a lost hand mostly keeps its rotation relative to the chest


def _trust(accuracy: float) -> float:
    """1 / (1 + (25 a)²): how far a point that errs by a (m) turns its collar."""
    return 1 / (1 + (SHOULDER_DOUBT * accuracy) ** 2)


def pulled_shoulder(seen: Tracked, limb: Limb, from_collar: np.ndarray, task: Task) -> np.ndarray:
    """Where a shoulder goes: where it is measured, or where a measured elbow or a far wrist pulls it."""
    if seen.turned(limb.carrier) or seen.has_position[limb.start]:
        return from_collar
    size, pulled = length(from_collar), from_collar
    if task.middle_seen:
        pulled = reach(from_collar + task.middle, size, length(task.upper), from_collar)[0]
        pulled = mix(from_collar, pulled, _trust(seen.accuracy[limb.middle]))
    elif task.end_seen:
        lacking = length(task.end) - STRAIGHT * task.longest
        pulled = from_collar + max(lacking, 0.0) * unit(task.end)
    return size * unit(from_collar + limited(pulled - from_collar, COLLAR_GIVES * size))


def move_arm(
    body: Body, seen: Tracked, goal: np.ndarray, ease: float, limb: Limb, changed: bool, begun: bool, state: LimbState
) -> None:
    """Bend an arm. `goal` are the rotations of the body's joints before easing."""
    collar, shoulder = body.point[limb.carrier], body.point[limb.start]
    before = shoulder - collar
    if seen.has_position[limb.start] and not seen.turned(limb.carrier):
        off = (seen.position[limb.start] - shoulder) * _trust(seen.accuracy[limb.start])
        shoulder = collar + length(before) * unit(before + off)
    task = limb_goal(seen, limb, goal, body.rotation, shoulder)
    measured = replace(task)  # a wrist that is still on its way does not pull its shoulder along
    ease_limb(task, seen, ease, limb, changed, limb_heading(body, limb), begun, state)
    pulled = collar + pulled_shoulder(seen, limb, shoulder - collar, measured)
    # A collar that is no longer pulled, or begins to be, goes there slowly.
    pulling = (task.middle_seen, task.end_seen)
    given = state.pull.vector(
        pulled - shoulder,
        state.pulled,
        state.pulled_speed,
        seen.interval,
        begun and pulling != state.pulling,
        ease if any(pulling) else BLEND,
    )
    pulled = collar + length(before) * unit(shoulder + given - collar)
    given = pulled - shoulder
    state.pulled_speed = (given - state.pulled) / seen.interval if begun else np.zeros(3)
    state.pulled, state.pulling = given, pulling
    state.end_shift = state.middle_shift = -given
    task.end, task.middle = task.end - state.pulled, task.middle - state.pulled
    body.rotation[limb.carrier] = turned_onto(body.rotation[limb.carrier], before, pulled - collar)
    turn_limb(body.rotation, seen, limb, *solve_limb(task))


def kept_wrist(rotation: np.ndarray, kept: np.ndarray, lost: float) -> np.ndarray:
    """A wrist's rotation `lost` s after it was last measured as `kept`, which it gives up by (1 + u) e^-u."""
    u = lost / KEPT_WRIST
    return turned_by(rotation, (1 + u) * exp(-u) * turn_between(rotation, kept))
