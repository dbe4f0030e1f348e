"""Fitting: the predicted body is drawn onto measured points, before limbs meet them exactly.

Position-based constraints (Müller et al., Position Based Dynamics, 2007): joints are moved one constraint after the
other, so that bones keep their lengths and measured joints are where they are measured.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp
from typing import TYPE_CHECKING

import numpy as np

from .points import BODY, HEAD, HIPS, NECK, PARENT, PELVIS, SPINE1, SPINE2, SPINE3, at
from .tracked import Tracked
from .trunk import Body, empty_body, place, placement
from .vectors import frame_of, length, turn_between, turned_by, turned_onto

if TYPE_CHECKING:
    from .network import Prediction
    from .state import PoseState

ROUNDS = 16
DOUBT = 25.0  # 1/m: a point 4 cm off draws half as far as a sure one
FADE = 0.25  # s in which 63 % of a change fades after a measured point came or went
SPINE = (PELVIS, SPINE1, SPINE2, SPINE3)
COLLARS = (at("left_collar"), at("right_collar"))
LIMB_BONES = [
    (at(f"{side}_{joint}"), at(f"{side}_{end}"))
    for joint, end in (
        ("collar", "shoulder"),
        ("shoulder", "elbow"),
        ("elbow", "wrist"),
        ("hip", "knee"),
        ("knee", "ankle"),
    )
    for side in ("left", "right")
]


def _shares() -> np.ndarray:
    """How far each joint (22,) gives way, relative to others."""
    gives = np.ones(BODY)
    gives[[*SPINE, *HIPS, NECK]] = 0.2
    gives[[*COLLARS, at("left_shoulder"), at("right_shoulder")]] = 0.3
    gives[HEAD] = 0.02
    return gives


GIVES = _shares()
STIFF = [  # distances that keep the shape of pelvis and chest
    HIPS,
    (HIPS[0], SPINE1),
    (HIPS[1], SPINE1),
    COLLARS,
    (COLLARS[0], NECK),
    (COLLARS[1], NECK),
    (SPINE2, NECK),
]


@dataclass
class Fitting:
    """How a predicted joint is turned toward what is measured."""

    turn: np.ndarray = field(default_factory=lambda: np.zeros(3))  # rad, world, in the frame before
    off: np.ndarray = field(default_factory=lambda: np.zeros(3))  # rad: remainder of a change of it


def _correct(found: np.ndarray, first: int, second: int, off: np.ndarray) -> None:
    """Move two joints so that the second is where `off` is taken from it, relative to the first."""
    both = GIVES[first] + GIVES[second]
    found[first] = found[first] + GIVES[first] / both * off
    found[second] = found[second] - GIVES[second] / both * off


def _keep_distance(found: np.ndarray, first: int, second: int, size: float) -> None:
    """Move two joints so that they are `size` (m) apart."""
    apart = found[second] - found[first]
    now = length(apart)
    if now > 1e-6:
        _correct(found, first, second, apart * ((now - size) / now))


def agreed_places(seen: Tracked, body: Body) -> np.ndarray:
    """Places (22, 3), m, that measured joints and bones agree on, near those of a predicted body."""
    has, start = seen.has_position[:BODY], body.point[:BODY]
    share = np.where(has, 1 / (1 + (DOUBT * seen.accuracy[:BODY]) ** 2), 0.0)
    displacement = np.zeros((BODY, 3))
    for j in range(BODY):
        if has[j]:
            displacement[j] = share[j] * (seen.position[j] - start[j])
        elif j not in SPINE:  # joints beyond a measured one start with its displacement
            displacement[j] = displacement[PARENT[j]]
    found = np.where(has[:, None], start, start + displacement)
    stiff = [length(start[second] - start[first]) for first, second in STIFF]
    for _ in range(ROUNDS):
        for j in range(1, BODY):
            parent = PARENT[j]
            if seen.turned(parent):  # a bone that a measured rotation turns
                bone = seen.rotation[parent] @ seen.rest_offset[j]
                _correct(found, parent, j, found[j] - found[parent] - bone)
            else:
                _keep_distance(found, parent, j, length(seen.rest_offset[j]))
        for (first, second), size in zip(STIFF, stiff, strict=True):
            _keep_distance(found, first, second, size)
        found = found + share[:, None] * (seen.position[:BODY] - found)
    return found


def _turned_branch(
    rotation: np.ndarray, before: np.ndarray, after: np.ndarray, joints: tuple[int, int, int, int]
) -> np.ndarray:
    """A rotation turned as the frame of a line across a joint and of its spine was."""
    joint, left, right, up = joints
    frames = [frame_of(places[left] - places[right], places[up] - places[joint]) for places in (before, after)]
    if not all(frame[:, 2].any() for frame in frames):  # in one line
        return rotation
    return frames[1] @ frames[0].T @ rotation


def fit_prediction(seen: Tracked, predicted: Prediction, state: PoseState) -> None:
    """Turn the predicted joints so that the whole body is near what is measured."""
    body, before = empty_body(), predicted.rotation.copy()
    for j in range(BODY):
        body.rotation[j] = seen.rotation[j] if seen.turned(j) else before[j]
    place(body, seen, predicted.head)
    place(body, seen, predicted.head + placement(body, seen))
    start, found = body.point, agreed_places(seen, body)
    for joints in ((PELVIS, *HIPS, SPINE1), (SPINE3, *COLLARS, NECK)):
        if not seen.turned(joints[0]):
            predicted.rotation[joints[0]] = _turned_branch(before[joints[0]], start, found, joints)
    for j, end in ((SPINE1, SPINE2), (SPINE2, SPINE3), (NECK, HEAD), *LIMB_BONES):
        if not seen.turned(j):
            predicted.rotation[j] = turned_onto(before[j], start[end] - start[j], found[end] - found[j])
    changed = state.begun and bool((seen.has_position[:BODY] != state.had_position[:BODY]).any())
    for j, joint in enumerate(state.fitting):
        turn = turn_between(before[j], predicted.rotation[j])
        if changed:
            joint.off = joint.turn - turn
        joint.off = np.zeros(3) if seen.at_once else joint.off * exp(-seen.interval / FADE)
        joint.turn = turn + joint.off
        predicted.rotation[j] = turned_by(before[j], joint.turn)
