"""What a glove's markers look like: nine markers in a few shapes of the hand, to recognise a glove by."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from bodysense.body.glove import default_glove, marker_positions
from bodysense.body.hand import FINGERS, FREEDOMS, rotations_of
from bodysense.body.pose import Pose
from bodysense.body.registration import register
from bodysense.body.skeleton import Skeleton

_CLOSED = ((0.0, 0.0), (0.25, 0.2), (0.5, 0.4), (0.8, 0.6))  # of their range, how far fingers and thumb are bent


@lru_cache(maxsize=16)
def hand_shapes(hand: Skeleton) -> np.ndarray:
    """Markers (S, M, 3) m of a left hand whose wrist is the origin: flat, relaxed, half closed, nearly a fist."""
    rotation = np.zeros((len(_CLOSED), len(hand.joints), 4))
    rotation[:, 0, 0] = 1.0
    for shape, (fingers, thumb) in zip(rotation, _CLOSED, strict=True):
        share = [thumb if row.joint.startswith("thumb") else fingers for row in FREEDOMS]
        flexion = [np.radians(row.high) if row.angle == "flexion" else 0.0 for row in FREEDOMS]
        shape[1:] = rotations_of(np.array(share) * flexion)
    return np.asarray(marker_positions(default_glove(), Pose(hand, np.zeros((len(_CLOSED), 3)), rotation)))


@lru_cache(maxsize=16)
def marker_ranges(hand: Skeleton) -> np.ndarray:
    """(M, K, 3) m where the markers of a left hand may be, its wrist the origin: bent more or less, fingers not spread.

    A marker on the back of the hand stands in one place, K times.
    """
    steps = np.linspace(0, 1, 8)
    base, middle = (grid.ravel()[:, None] for grid in np.meshgrid(-20 + 110 * steps, 100 * steps))
    aside, ahead, bent = (grid.ravel()[:, None] for grid in np.meshgrid(*[np.linspace(0, 1, 4)] * 3))
    # Degrees. The last joint of a finger bends with the one before it, by two thirds.
    turns = {f"{finger}{k}": turn for finger in FINGERS[1:] for k, turn in ((1, base), (2, middle), (3, middle / 1.5))}
    turns |= {"thumb1": -25 + 65 * ahead, "thumb2": -10 + 50 * bent, "thumb3": -10 + 70 * bent}
    angles = np.zeros((len(base), len(FREEDOMS)))
    for place, row in enumerate(FREEDOMS):
        if row.angle == "flexion":
            angles[:, place] = turns[row.joint][:, 0]
        elif row.joint == "thumb1" and row.angle == "abduction":
            angles[:, place] = (-35 + 70 * aside)[:, 0]
    rotation = np.zeros((len(base), len(hand.joints), 4))
    rotation[:, 0, 0] = 1.0
    rotation[:, 1:] = rotations_of(np.radians(angles))
    pose = Pose(hand, np.zeros((len(base), 3)), rotation)
    return np.ascontiguousarray(np.asarray(marker_positions(default_glove(), pose)).swapaxes(0, 1))


def unlikeness(shapes: np.ndarray, markers: np.ndarray) -> np.ndarray:
    """How far (N,) m, root mean square, N gloves' markers (N, M, 3) m of left hands are from the shape most like them.

    Markers are NaN where missing; without any it is infinite.
    """
    count = len(shapes)
    several, like = np.repeat(markers, count, axis=0), np.tile(shapes, (len(markers), 1, 1))
    known = np.asarray(np.isfinite(several).all(axis=-1))
    rotation, translation = register(like, several, known)[:2]
    apart = several - (like @ rotation.swapaxes(-1, -2) + translation[:, None])
    squared = np.where(known, (apart**2).sum(axis=-1), 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    squared = np.where(known.any(axis=1), squared, np.inf).reshape(-1, count)
    return np.sqrt(squared.min(axis=1))
