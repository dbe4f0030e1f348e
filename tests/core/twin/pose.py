"""From what the network predicts to a body that meets what is measured and moves without jumps.

predicted body fitted to measured points → rotations: measured, implied or predicted → eased where sensors came or
went → the body hung on its head → spine bent to the pelvis → legs, feet held and on the floor → arms → places
"""

import numpy as np

from bodysense.tracking.tracker import TrackerSettings

from .arms import kept_wrist, move_arm
from .blend import BLEND, GROUP, find_changes, find_stand_ins, remember_limb
from .fit import fit_prediction
from .legs import move_legs
from .limbs import LIMBS
from .network import Prediction
from .offset_decay import decay_offsets
from .points import BODY, BODY_POINTS, HEAD, HIPS, PELVIS, POINTS, SPINE3, WRISTS, at
from .state import PoseState
from .tracked import Tracked, find_knuckles, imply_rotations, place_head
from .trunk import (
    Body,
    bend_spine,
    empty_body,
    onto_floor,
    pelvis_off,
    pelvis_seen,
    place,
    place_points,
    placement,
    turn_neck,
)
from .vectors import heading, length, mix, turn_between, turned_onto

LEAST_DOUBT = 1e-6  # m
STIRRED, CALM = 0.1, 0.1  # m/s of a head that contradicts raised arms, and the share of that of a still one

# Joints that are turned by a measured point further on, with that point. Limbs are bent instead.
DIRECTED = [
    (at(joint), at(child))
    for joint, child in (
        ("spine1", "spine2"),
        ("spine2", "spine3"),
        ("neck", "head"),
        ("head", "head_top"),
        ("left_collar", "left_shoulder"),
        ("right_collar", "right_shoulder"),
        ("left_ankle", "left_foot"),
        ("right_ankle", "right_foot"),
        ("left_foot", "left_toe"),
        ("right_foot", "right_toe"),
    )
]


def directed(seen: Tracked, joint: int, child: int, rotation: np.ndarray) -> np.ndarray:
    """Turn a rotation so that the joint points at its measured child.

    The direction is unreliable if the points' error e is near their distance b, so its weight is b² / (b² + (2 e)²).
    """
    if not seen.has_position[joint] or not seen.has_position[child]:
        return rotation
    bone = rotation @ seen.rest_offset[child]
    doubt = 2 * (seen.accuracy[joint] + seen.accuracy[child]) + LEAST_DOUBT
    trust = bone @ bone / (bone @ bone + doubt**2)
    return turned_onto(rotation, bone, mix(bone, seen.position[child] - seen.position[joint], trust))


def rotation_goals(seen: Tracked, predicted: Prediction) -> np.ndarray:
    """The rotations to come to: measured or implied, else as predicted and turned onto measured points."""
    goal = np.array([seen.rotation[j] if seen.turned(j) else predicted.rotation[j] for j in range(BODY)])
    for joint, child in DIRECTED:
        if not seen.turned(joint):
            goal[joint] = directed(seen, joint, child, goal[joint])
    left, right = HIPS
    if not seen.turned(PELVIS) and seen.has_position[left] and seen.has_position[right]:
        line = goal[PELVIS] @ (seen.rest_offset[left] - seen.rest_offset[right])
        goal[PELVIS] = turned_onto(goal[PELVIS], line, seen.position[left] - seen.position[right])
    return goal


def redirected(seen: Tracked, state: PoseState, joint: int) -> bool:
    """Whether measured points turn a joint now that did not before, or no longer do."""
    pairs = [list(HIPS)] if joint == PELVIS else [[j, child] for j, child in DIRECTED if j == joint]
    return any(seen.has_position[pair].all() != state.had_position[pair].all() for pair in pairs)


def pose_read(settings: TrackerSettings, seen: Tracked, state: PoseState) -> None:
    """Derive rotations and other points from measured points, before the network runs."""
    seen.waning = seen.interval * min(max(length(state.head_speed) / STIRRED, CALM), 1.0)
    find_stand_ins(seen, settings.ease, state.begun, state.limb)
    find_knuckles(seen)
    imply_rotations(seen)
    place_head(seen, state.point if state.begun else None)
    found = (seen.has_position & ~state.had_position)[BODY_POINTS].any()
    seen.at_once = settings.ease == 0 and state.begun and bool(found)


def pose_body(settings: TrackerSettings, seen: Tracked, predicted: Prediction, state: PoseState) -> Body:
    """The body without its fingers: rotations of the body's joints, and all points of a body with flat hands."""
    body, begun, interval = empty_body(), state.begun, seen.interval
    fit_prediction(seen, predicted, state)
    decay_offsets(seen, predicted, state)
    changed = find_changes(seen, state.had_position, state.had_rotation) if begun else set()
    goal = rotation_goals(seen, predicted)
    for j in range(BODY):
        known = seen.turned(j)
        came = begun and known != state.had_rotation[j]
        breaks = came and known if j in WRISTS else came or (GROUP[j] in changed and not known)
        breaks |= begun and not known and redirected(seen, state, j)
        span = settings.ease if known or seen.at_once else BLEND
        body.rotation[j] = state.turn[j].rotation(goal[j], state.rotation[j], state.spin[j], interval, breaks, span)

    # The body hangs on its head, or on its pelvis, or on what is seen.
    place(body, seen, predicted.head)
    state.has_measured_position = state.has_measured_position or bool(seen.has_position.any())
    head = predicted.head + (placement(body, seen) if state.has_measured_position else onto_floor(body, seen))
    has_head = bool(seen.has_position[HEAD])
    breaks = begun and (
        has_head != state.had_position[HEAD]
        or (not has_head and not changed.isdisjoint(("trunk", "left_arm", "right_arm")))
    )
    span = settings.ease if has_head else BLEND
    head = state.head.vector(head, state.point[HEAD], state.head_speed, interval, breaks, span)
    place(body, seen, head)

    turn_neck(body, seen)

    # The spine bends to a measured pelvis.
    hips = [PELVIS, *HIPS]
    breaks = begun and bool((seen.has_position[hips] != state.had_position[hips]).any())
    pelvis, span = body.point[PELVIS], settings.ease if pelvis_seen(seen) else BLEND
    wanted = pelvis + pelvis_off(body, seen)
    wanted = state.pelvis.vector(wanted, state.pelvis_bent, state.pelvis_speed, interval, breaks, span)
    bend_spine(body, seen, wanted - pelvis)
    state.pelvis_speed = (body.point[PELVIS] - state.pelvis_bent) / interval if begun else np.zeros(3)
    state.pelvis_bent = body.point[PELVIS]

    # Legs first: the pelvis may be moved for them, and the chest with it.
    move_legs(body, seen, predicted.contact, goal, settings, changed, state)
    _keep_wrists(body, seen, state)
    for name in ("left_arm", "right_arm"):
        move_arm(body, seen, goal, settings.ease, LIMBS[name], name in changed, begun, state.limb[name])
    place(body, seen, head)
    return body


def _keep_wrists(body: Body, seen: Tracked, state: PoseState) -> None:
    """Turn wrists whose rotation is lost: they keep it to the chest's heading, and give it up slowly."""
    for k, wrist in enumerate(WRISTS):
        lost = state.wrist_lost[k]
        if seen.turned(wrist):
            state.wrist_lost[k] = 0.0
        elif lost is not None:
            state.wrist_lost[k] = lost = lost + seen.interval
            kept = heading(body.rotation[SPINE3]) @ state.wrist_kept[k]
            body.rotation[wrist] = kept_wrist(body.rotation[wrist], kept, lost)


def pose_finish(seen: Tracked, state: PoseState, body: Body) -> np.ndarray:
    """After the fingers: place all points, remember what was output, and return how far measured points are off (m)."""
    place_points(body, seen.rest_offset, body.point[HEAD])
    rate = 1 / seen.interval if state.begun else 0.0
    state.head_speed = (body.point[HEAD] - state.point[HEAD]) * rate
    for name, limb in LIMBS.items():
        remember_limb(body, limb, seen.interval, state.begun, state.limb[name])
    for j in range(BODY):
        state.spin[j] = turn_between(state.rotation[j], body.rotation[j]) * rate
        state.rotation[j], state.had_rotation[j] = body.rotation[j], seen.turned(j)
    for k, wrist in enumerate(WRISTS):
        if seen.turned(wrist):
            state.wrist_kept[k] = heading(body.rotation[SPINE3]).T @ body.rotation[wrist]
    state.point, state.had_position, state.begun = body.point.copy(), seen.has_position.copy(), True
    off = np.linalg.norm(seen.position - body.point, axis=1)
    return np.where(seen.has_position, off, np.zeros(POINTS))
