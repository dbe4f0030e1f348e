"""A body in the making: rotations and places; the trunk hung on its head, its spine bent to a measured pelvis."""

from dataclasses import dataclass

import numpy as np

from .points import HAND_JOINTS, HEAD, HIPS, JOINTS, NECK, PARENT, PATH, PELVIS, POINTS, SPINE1, SPINE2, SPINE3
from .points import WRISTS as WRIST_JOINTS
from .tracked import Tracked
from .vectors import length, reach, turned_onto

LEAST_MOVE = 1e-4  # m: the spine is not bent for less, which rounding alone may ask for
SPINE_BACK = 0.3  # of its length: how far a straight spine bends backward first


@dataclass
class Body:
    """A completed body."""

    rotation: np.ndarray  # (52, 3, 3) world ← joint
    point: np.ndarray  # (65, 3) m, from base


def empty_body() -> Body:
    """A body before anything is known of it."""
    return Body(np.tile(np.eye(3), (JOINTS, 1, 1)), np.zeros((POINTS, 3)))


def place_points(body: Body, rest_offset: np.ndarray, head: np.ndarray) -> None:
    """Forward kinematics from the head: points = head + (path - path of the head) bones."""
    bones = np.zeros((POINTS, 3))
    bones[1:] = np.einsum("pij,pj->pi", body.rotation[PARENT[1:]], rest_offset[1:])
    body.point = head + (PATH - PATH[HEAD]) @ bones


def place(body: Body, seen: Tracked, head: np.ndarray) -> None:
    """Place all points of a body with flat hands by its rotations and the place of its head."""
    for wrist, fingers in zip(WRIST_JOINTS, HAND_JOINTS, strict=True):
        body.rotation[fingers] = body.rotation[wrist]
    place_points(body, seen.rest_offset, head)


def _mean_off(body: Body, seen: Tracked, points: np.ndarray) -> np.ndarray:
    """Return the mean offset from the body to measured points; 0 without measured points."""
    seen_points = points[seen.has_position[points]]
    if not len(seen_points):
        return np.zeros(3)
    return (seen.position - body.point)[seen_points].mean(axis=0)


def placement(body: Body, seen: Tracked) -> np.ndarray:
    """By how much a body has to move so that its measured head, else pelvis, else the mean of what is seen is met."""
    if not seen.has_position.any():  # it stays where it was
        return seen.position[HEAD] - body.point[HEAD]
    for point in (HEAD, PELVIS):
        if seen.has_position[point]:
            return seen.position[point] - body.point[point]
    return _mean_off(body, seen, np.arange(POINTS))


def onto_floor(body: Body, seen: Tracked) -> np.ndarray:
    """By how much a body of which no place was ever measured has to move so that it is on the floor."""
    off = seen.position[HEAD] - body.point[HEAD]
    return np.array([off[0], seen.floor - body.point[:, 1].min(), off[2]])


def pelvis_seen(seen: Tracked) -> bool:
    """Whether the pelvis or a hip is measured."""
    return bool(seen.has_position[[PELVIS, *HIPS]].any())


def pelvis_off(body: Body, seen: Tracked) -> np.ndarray:
    """How far a measured pelvis, or measured hips, are from where the body has them."""
    return _mean_off(body, seen, np.array([PELVIS] if seen.has_position[PELVIS] else HIPS))


def turn_neck(body: Body, seen: Tracked) -> None:
    """Turn the neck so that a measured chest, whose rotation is known, is where it is below a measured head."""
    if not seen.has_position[HEAD] or not seen.has_position[SPINE3] or seen.turned(NECK):
        return
    neck = seen.position[SPINE3] + body.rotation[SPINE3] @ seen.rest_offset[NECK]
    head = body.point[HEAD]
    body.rotation[NECK] = turned_onto(body.rotation[NECK], head - body.point[NECK], head - neck)
    place(body, seen, head)


def bend_spine(body: Body, seen: Tracked, move: np.ndarray) -> None:
    """Bend the spine so that the pelvis, which keeps its rotation, moves (m).

    Between the neck and the lowest joint of the spine are two bones, of which the upper one is stiff; between a chest
    that is measured and that joint as well.
    """
    if length(move) < LEAST_MOVE:
        return
    chest = bool(seen.has_position[SPINE3]) or seen.turned(SPINE3)
    top = body.point[SPINE3 if chest else NECK]
    upper, lower = body.point[SPINE2] - top, body.point[SPINE1] - body.point[SPINE2]
    side = upper - SPINE_BACK * length(upper) * body.rotation[SPINE3][:, 2]  # a straight spine bends backward
    middle, end = reach(body.point[SPINE1] - top + move, length(upper), length(lower), side)
    for joint in (SPINE2,) if chest else (SPINE3, SPINE2):
        body.rotation[joint] = turned_onto(body.rotation[joint], upper, middle)
    body.rotation[SPINE1] = turned_onto(body.rotation[SPINE1], lower, end - middle)
    place(body, seen, body.point[HEAD])
