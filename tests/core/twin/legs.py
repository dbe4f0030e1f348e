"""Legs: to measured or predicted ankles, with feet that stand on the floor."""

from math import sqrt

import numpy as np

from bodysense.tracking.tracker import TrackerSettings

from .blend import BLEND, ease_limb, limb_heading
from .feet import Foot, hold_feet
from .limbs import LIMBS, Task, keep_forward, limb_goal, solve_limb, turn_limb
from .points import HEAD, HIPS, PELVIS, SIDES, at, rest_height
from .state import PoseState
from .tracked import Tracked
from .trunk import Body, bend_spine, pelvis_seen
from .vectors import STRAIGHT, UP, length, limited, mix, turn_between, turned_by, turned_onto, unit

PULLS = 6  # times that measured legs pull a pelvis
MAX_PELVIS_SHIFT = 0.15  # m, largest shift of the pelvis toward targets out of reach
SETTLE = 0.06  # s in which half of what a standing pelvis lacks is made up
LOW_HEAD = 0.71  # of a standing head's height; a lower head sits low, kneels or lies
SEATED = 0.76  # of it; a higher head stands, or sits on a chair
STRETCHED = 0.92  # of it; a body lands from a jump with a head that is higher
STEADY = 0.7  # m/s; a head that moves faster up or down belongs to a body that jumps
FALLING = 2.0  # m/s, of a head that goes down below that; a slower one sits down or crouches
LEGS = [LIMBS[f"{side}_leg"] for side in SIDES]


def leg_lack(task: Task) -> np.ndarray:
    """How far the pelvis has to move for a leg whose measured knee or ankle it does not reach."""
    if task.middle_seen:
        return task.middle - length(task.upper) * unit(task.middle)
    lacking = length(task.end) - STRAIGHT * task.longest
    return max(lacking, 0.0) * unit(task.end) if task.end_seen else np.zeros(3)


def move_pelvis(body: Body, seen: Tracked, tasks: list[Task], move: np.ndarray) -> None:
    """Move the pelvis by bending the spine. Measured joints of the legs stay where they are."""
    before = body.point[PELVIS]
    bend_spine(body, seen, move)
    pelvis_shift = body.point[PELVIS] - before
    for task in tasks:
        task.end = task.end - pelvis_shift * task.end_seen
        task.middle = task.middle - pelvis_shift * task.middle_seen


def pull_pelvis(body: Body, seen: Tracked, state: PoseState, tasks: list[Task]) -> None:
    """Move a pelvis that is not measured so that legs reach their measured joints."""
    before = body.point[PELVIS]
    pulling = tuple((task.middle_seen, task.end_seen) if not pelvis_seen(seen) else (False, False) for task in tasks)
    if np.any(pulling):
        for _ in range(PULLS):
            lack = np.mean([leg_lack(task) for task in tasks if task.middle_seen or task.end_seen], axis=0)
            pelvis_shift = body.point[PELVIS] - before
            move_pelvis(body, seen, tasks, limited(pelvis_shift + lack, MAX_PELVIS_SHIFT) - pelvis_shift)
    pelvis_shift = body.point[PELVIS] - before
    breaks = state.begun and pulling != state.pulling
    span = 0.0 if seen.at_once else BLEND
    eased_shift = state.pull.vector(pelvis_shift, state.pulled, state.pulled_speed, seen.interval, breaks, span)
    move_pelvis(body, seen, tasks, eased_shift - pelvis_shift)
    pulled = body.point[PELVIS] - before
    state.pulled_speed = (pulled - state.pulled) / seen.interval if state.begun else np.zeros(3)
    state.pulling, state.pulled = pulling, pulled


def uprightness(body: Body, seen: Tracked, state: PoseState) -> float:
    """Return 1 if feet carry the body (standing, crouching or on a chair), 0 if it lies, sits on the floor or jumps."""
    tall, high = rest_height(seen.rest_offset, HEAD), body.point[HEAD][1] - seen.floor
    risen = float(np.clip((high / tall - LOW_HEAD) / (SEATED - LOW_HEAD), 0, 1))
    fastest = FALLING if state.head_speed[1] < 0 and high < STRETCHED * tall else STEADY
    calm = float(np.clip((fastest - abs(state.head_speed[1])) / (0.5 * fastest), 0, 1))
    return 0.0 if high > tall + 0.03 else risen * calm


def lacking_height(hip: np.ndarray, ankle: np.ndarray, task: Task) -> float:
    """How much lower the pelvis must be for a leg to reach its ankle (m)."""
    end, longest = ankle, STRAIGHT * task.longest
    if task.middle_turned:  # a shin with a measured rotation does not stretch the leg
        end, longest = ankle - task.lower, length(task.upper)
    away = (end - hip) * [1, 0, 1]
    square = longest**2 - away @ away
    return max(hip[1] - end[1] - sqrt(square), 0.0) if square > 0 else 0.0


def flatten_foot(body: Body, seen: Tracked, ankle: int, ball: int, below: float, share: float) -> None:
    """Turn a foot that stands so that its ball is `below` its ankle, as at rest."""
    if share == 0 or seen.turned(ankle) or seen.has_position[ball]:
        return
    bone = body.rotation[ankle] @ seen.rest_offset[ball]
    forward = sqrt(max(bone @ bone - below**2, 0.0))
    level = forward * unit(bone * [1, 0, 1]) - below * UP
    flat = turned_onto(body.rotation[ankle], bone, mix(bone, level, share))
    turn = turn_between(body.rotation[ankle], flat)
    body.rotation[ankle] = turned_by(body.rotation[ankle], turn)
    if not seen.turned(ball):
        body.rotation[ball] = turned_by(body.rotation[ball], turn)


def move_legs(
    body: Body,
    seen: Tracked,
    contact: np.ndarray,
    goal: np.ndarray,
    settings: TrackerSettings,
    changed: set[str],
    state: PoseState,
) -> None:
    """Bend both legs, and move a pelvis that is not measured so far that they reach."""
    tasks = [limb_goal(seen, leg, goal, body.rotation, body.point[leg.start]) for leg in LEGS]
    pull_pelvis(body, seen, state, tasks)
    turn, feet, free = limb_heading(body, LEGS[0]), [], []
    for k, (side, leg, task) in enumerate(zip(SIDES, LEGS, tasks, strict=True)):
        name = f"{side}_leg"
        ease_limb(task, seen, settings.ease, leg, name in changed, turn, state.begun, state.limb[name])
        if state.limb[name].end.runs or state.limb[name].middle.runs:
            keep_forward(task, seen, leg, body.rotation[leg.start])
        free.append(solve_limb(task))
        end = free[k][1]
        ball, toe = at(f"{side}_foot"), at(f"{side}_toe")
        ankle_rest, ball_rest = (rest_height(seen.rest_offset, point) for point in (leg.end, ball))
        flatten_foot(body, seen, leg.end, ball, ankle_rest - ball_rest, state.foot[k].flatness)
        ankle_place = body.point[leg.start] + end
        ball_place = ankle_place + body.rotation[leg.end] @ seen.rest_offset[ball]
        toe_place = ball_place + body.rotation[ball] @ seen.rest_offset[toe]
        measured = bool(seen.has_position[[leg.end, ball, toe]].any())
        places = (ankle_place, ball_place, toe_place)
        feet.append(Foot(*places, ankle_rest, ball_rest, contact[k], contact[2 + k], measured))
    moves = [np.zeros(3), np.zeros(3)]
    if settings.hold_feet:
        upright = uprightness(body, seen, state)
        moves = hold_feet(feet, seen.floor, seen.interval, upright, state.foot)
    settle = 1 - 2 ** (-seen.interval / SETTLE)
    lacking = max(
        lacking_height(body.point[HIPS[k]], foot.ankle + moves[k], task) * bool(held.held)
        for k, (task, foot, held) in enumerate(zip(tasks, feet, state.foot, strict=True))
    )
    if pelvis_seen(seen):
        lacking = 0.0
    state.standing_drop += settle * (min(lacking, MAX_PELVIS_SHIFT) - state.standing_drop)
    pelvis = body.point[PELVIS]
    bend_spine(body, seen, -state.standing_drop * UP)
    pelvis_shift = body.point[PELVIS] - pelvis
    for side, leg, task, move, foot, (free_middle, free_end) in zip(
        SIDES, LEGS, tasks, moves, state.foot, free, strict=True
    ):
        task.end = task.end + move - pelvis_shift  # feet stay where they are when the pelvis is lowered for them
        if task.middle_seen:
            task.middle = task.middle - pelvis_shift
        else:
            keep_forward(task, seen, leg, body.rotation[leg.start])
        middle, end = solve_limb(task)
        turn_limb(body.rotation, seen, leg, middle, end)
        own, refused = state.limb[f"{side}_leg"], np.zeros(3)
        own.end_shift, own.middle_shift = end - free_end, middle - free_middle
        if task.middle_seen or task.start_turned or task.middle_turned:
            # Measured bones do not give way: what they refuse is not held.
            refused = own.end_shift - (move - pelvis_shift)
            foot.anchor, foot.slide = foot.anchor + refused, foot.slide + refused * [1, 0, 1]
            foot.drop -= refused[1]
        own.end_held, own.middle_held = move + refused, own.middle_shift + pelvis_shift
