"""A body: rotations and places."""

from dataclasses import dataclass

import numpy as np

from .points import HAND_JOINTS, HEAD, JOINTS, PARENT, PATH, POINTS, WRISTS
from .tracked import Tracked


@dataclass
class Body:
    """A completed body."""

    rotation: np.ndarray  # (52, 3, 3) world ← joint
    point: np.ndarray  # (65, 3) m, from base


def empty_body() -> Body:
    """A body before anything is known of it."""
    return Body(np.tile(np.eye(3), (JOINTS, 1, 1)), np.zeros((POINTS, 3)))


def place(body: Body, seen: Tracked, head: np.ndarray) -> None:
    """Forward kinematics from the head, with flat hands: points = head + (path - path of the head) bones."""
    for wrist, fingers in zip(WRISTS, HAND_JOINTS, strict=True):
        body.rotation[fingers] = body.rotation[wrist]
    bones = np.zeros((POINTS, 3))
    bones[1:] = np.einsum("pij,pj->pi", body.rotation[PARENT[1:]], seen.rest_offset[1:])
    body.point = head + (PATH - PATH[HEAD]) @ bones
