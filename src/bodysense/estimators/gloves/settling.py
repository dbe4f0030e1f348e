"""No jump of a hand where markers are found again: its pose settles to what they say, no point faster than allowed.

Markers that settle one by one leave a hand no hand: one whose back is out of shape has no sure place, and a finger's
joints can go twice as far as its tip. Whole poses settle in its place: the wrist's place, and all rotations.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bodysense.body.registration import to_matrix
from bodysense.body.rotation import quaternion_conjugate
from bodysense.estimators.gloves.fingers import HandShape, in_order, product, reached
from bodysense.estimators.gloves.joints import HandPoses

_LEVER = 0.02  # m: a turn that moves no point, such as a twist, settles as if it moved one so far away


class Away(NamedTuple):
    """How far H hands are shown from where they are."""

    root: np.ndarray  # (H, 3) m
    turn: np.ndarray  # (H, 16, 4) wxyz, w ≥ 0: shown = turn · rotation, the wrist's in the world
    farthest: np.ndarray  # (H,) m, of any point
    speed: np.ndarray  # (H,) m/s at which the farthest point comes


def between(shown: HandPoses, told: HandPoses, moving: np.ndarray, speed: float, longest: float = 0.5) -> Away:
    """Of hands that are shown but told elsewhere. Those `moving` (H,); others are shown as told.

    They come at `speed` m/s, faster only where that would take more than `longest` s.
    """
    turn = product(shown.rotation, quaternion_conjugate(told.rotation))
    turn *= np.copysign(1.0, turn[..., :1])
    turn[~moving] = [1.0, 0.0, 0.0, 0.0]
    root = np.where(moving[:, None], shown.root - told.root, 0.0)
    farthest = np.where(moving, _farthest(shown.position, told.position, turn), 0.0)
    return Away(root, turn, farthest, np.maximum(speed, farthest / longest))


def nearer(state: Away | None, interval: float) -> Away | None:
    """How far they are `interval` s later; None: they have come."""
    if state is None:
        return None
    left = 1 - state.speed * interval / np.maximum(state.farthest, 1e-12)
    if not (left > 0).any():
        return None
    left = np.maximum(left, 0.0)
    vector = state.turn[..., 1:]
    sine = np.sqrt((vector * vector).sum(axis=-1, keepdims=True))
    half = np.arctan2(sine, state.turn[..., :1]) * left[:, None, None]
    turn = np.concatenate([np.cos(half), vector * (np.sin(half) / np.maximum(sine, 1e-12))], axis=-1)
    return Away(state.root * left[:, None], turn, state.farthest * left, state.speed)


def displaced(told: HandPoses, state: Away | None, shape: HandShape) -> HandPoses:
    """Hands as they are shown: the very same where none is away."""
    if state is None:
        return told
    root, rotation = told.root + state.root, product(state.turn, told.rotation)
    ways = reached(rotation[:, 1:], shape)[..., :4] + shape.base
    return HandPoses(root, rotation, in_order(ways, to_matrix(rotation[:, 0]), root))


def _farthest(shown: np.ndarray, told: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(H,) m."""
    apart = np.sqrt(((shown - told) ** 2).sum(axis=-1)).max(axis=1)
    turned = np.sqrt((turn[..., 1:] ** 2).sum(axis=-1)).max(axis=1)  # the sine of half the angle
    return np.maximum(apart, 2 * _LEVER * turned)
