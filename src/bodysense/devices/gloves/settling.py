"""No jump of a hand where markers are found again: it settles on what they say, no faster than its own motion allows.

Markers that settle one by one leave a hand no hand: one whose back is out of shape has no sure place, and a finger's
joints can go twice as far as its tip. Poses settle in its place: first the back of the hand, its place and its turn,
then every finger. Each goes as far as it may. No point is corrected faster than `speed`, and none goes farther in a
frame than what was known before says that it moves, and `speed` beside: `unseen_speed` where its markers are not seen,
because what is said of it then is less sure. A finger that would go farther even where it was is turned back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bodysense.body.glove import Glove
from bodysense.body.hand import FINGERS, HAND_JOINTS
from bodysense.body.products import CONJUGATE
from bodysense.body.registration import moved, to_matrix
from bodysense.devices.gloves.fingers import POINT_COUNT, HandShape, in_order, product, reached, shortest_arcs
from bodysense.devices.gloves.joints import HandPoses

_OVER = 1e-4  # m: what is missed by less is left
_NOWHERE = 1e-14  # m²: what goes less far stays where it is
_BACK = np.array([0, *(HAND_JOINTS.index(f"{finger}1") for finger in FINGERS)])  # points that the fingers do not move
_FINGERS = np.array([[*range(3 * k + 1, 3 * k + 4), len(HAND_JOINTS) + k] for k in range(len(FINGERS))])  # (5, 4)
_ALL = np.ones((1, 5))
_ONES = np.ones(3)
_STAY = np.array([1.0, 0.0, 0.0, 0.0])


class Away(NamedTuple):
    """How far H hands are shown from where they are."""

    root: np.ndarray  # (H, 3) m
    turn: np.ndarray  # (H, 16, 4) wxyz, w ≥ 0: shown = turn · rotation, the wrist's in the world


class SettlingState(NamedTuple):
    """The frame before."""

    shown: np.ndarray  # (H, 21, 3) m
    told: np.ndarray  # (H, 21, 3) m
    known: np.ndarray  # (H, 9) bool
    away: Away | None  # None: hands are shown where they are
    speed: np.ndarray  # (H, 1) m/s at which they come at most


@dataclass(frozen=True, eq=False)
class Settling:
    """The way in which hands of a `shape` that wear a glove settle. Speeds in m/s."""

    shape: HandShape
    glove: Glove
    speed: float
    unseen_speed: float
    longest: float = 0.5  # s: what is far comes faster, so that it takes no longer

    @cached_property
    def _needed(self) -> np.ndarray:
        """(9, 21): 1 for markers that must be seen for a point's motion to be sure."""
        needed = np.zeros((len(self.glove.markers), POINT_COUNT))
        for marker, joint in enumerate(self.glove.carried_by):
            if joint == "wrist":
                needed[marker] = 1.0
            else:
                needed[marker, _FINGERS[FINGERS.index(joint[:-1]), 1:]] = 1.0
        return needed

    @cached_property
    def _slowest(self) -> np.ndarray:
        """(H, 1) m/s."""
        return np.full((len(self.shape.base), 1), self.speed)

    def step(
        self, told: HandPoses, without: HandPoses, known: np.ndarray, interval: float, state: SettlingState | None
    ) -> tuple[HandPoses, SettlingState]:
        """The hands that are shown, the very same where none is away, and the state after them.

        Args:
            told: where hands are.
            without: where they would be had nothing been found since the frame before; `told` itself if nothing was.
            known: (H, 9) bool.
            interval: seconds since the frame before.
            state: after the frame before; None before the first.
        """
        if state is None or (state.away is None and without is told):
            return told, SettlingState(told.position, told.position, known, None, self._slowest)
        start, speed = displaced(without, state.away, self.shape), state.speed
        if without is not told:
            farthest = _length(start.position - told.position).max(axis=1, keepdims=True)
            speed = np.maximum(self.speed, farthest / self.longest)
        most = speed * interval
        sure = ~(known & state.known) @ self._needed == 0
        reach = _length(without.position - state.told) + most * np.where(sure, 1.0, self.unseen_speed / self.speed)

        def short(begin: HandPoses, end: HandPoses, points: np.ndarray) -> np.ndarray:
            """(H, …): so much of the way between them is left when one of the points (…, N) can go no farther."""
            step, way = begin.position - state.shown, end.position - begin.position
            step, way, far = (part.take(points, axis=1) for part in (step, way, reach))
            return 1 - _share(step, way, far, most).min(axis=-1)

        away = between(start, told)
        away = left(away, short(start, told, _BACK[None]), _ALL)
        end = carried(told, away)
        away = left(away, _ALL[:, :1], short(displaced(told, away, self.shape), end, _FINGERS))
        shown = displaced(told, away, self.shape)
        arc = _back(shown, state.shown, reach)
        if arc is not None:
            away.turn[:, 1::3] = product(arc, away.turn[:, 1::3])
            shown = displaced(told, away, self.shape)
        elif not away.root.any() and not away.turn[..., 1:].any():
            return told, SettlingState(told.position, told.position, known, None, speed)
        return shown, SettlingState(shown.position, told.position, known, away, speed)


def between(shown: HandPoses, told: HandPoses) -> Away:
    """Of hands that are shown but told elsewhere."""
    turn = product(shown.rotation, told.rotation * CONJUGATE)
    return Away(shown.root - told.root, turn * np.copysign(1.0, turn[..., :1]))


def left(away: Away, back: np.ndarray, fingers: np.ndarray) -> Away:
    """What is left of it: a share (H, 1) of the back of the hand's and shares (H, 5) of the fingers', or (1, …)."""
    share = np.empty(away.turn.shape[:2])
    share[:, :1], share[:, 1:] = back, fingers.repeat(3, axis=1)
    vector = away.turn[..., 1:]
    sine = _length(vector)
    half = np.arctan2(sine, away.turn[..., 0]) * share
    vector = vector * (np.sin(half) / np.maximum(sine, 1e-12))[..., None]
    return Away(away.root * back, np.concatenate([np.cos(half)[..., None], vector], axis=-1))


def displaced(told: HandPoses, away: Away | None, shape: HandShape) -> HandPoses:
    """Hands as they are shown: the very same where none is away."""
    if away is None:
        return told
    root, rotation = told.root + away.root, product(away.turn, told.rotation)
    points = in_order(reached(rotation[:, 1:], shape), shape)
    return HandPoses(root, rotation, moved(points, to_matrix(rotation[:, 0]), root))


def carried(told: HandPoses, away: Away) -> HandPoses:
    """Hands as they are shown but for their fingers, which are in the hand where they are told."""
    root, turn = told.root + away.root, away.turn[:, :1]
    rotation = told.rotation.copy()
    rotation[:, :1] = product(turn, rotation[:, :1])
    own = told.position - told.root[:, None]
    return HandPoses(root, rotation, moved(own, to_matrix(turn[:, 0]), root))


def _share(step: np.ndarray, way: np.ndarray, reach: np.ndarray, most: np.ndarray) -> np.ndarray:
    """The largest share s ≤ 1 with |step + s · way| ≤ reach and |s · way| ≤ most, vectors (H, …, 3), m.

    Where no s has the first, that with the least |step + s · way|.
    """
    squared, along = (way * way) @ _ONES, (step * way) @ _ONES
    over = (step * step) @ _ONES - reach * reach
    root = np.sqrt(np.maximum(along * along - squared * over, 0.0))
    most = most[..., None] / np.maximum(np.sqrt(squared), 1e-12)
    share = np.where(squared + 2 * along + over <= 0, 1.0, (root - along) / np.maximum(squared, _NOWHERE))
    return np.minimum(np.maximum(share, 0.0), np.minimum(most, 1.0))


def _back(shown: HandPoses, before: np.ndarray, reach: np.ndarray) -> np.ndarray | None:
    """Arcs (H, 5, 4) about fingers' bases that take points back that go farther than they may; None: none does.

    Of every finger the point that goes too far by most.
    """
    way = shown.position - before
    length = _length(way)
    over = (length - reach)[:, _FINGERS]
    if not (over > _OVER).any():
        return None
    worst = np.argmax(over, axis=-1, keepdims=True)
    point = np.take_along_axis(np.broadcast_to(_FINGERS, over.shape), worst, axis=-1)[..., 0]
    hand = np.arange(len(way))[:, None]
    base, place = shown.position[:, _FINGERS[:, 0]], shown.position[hand, point]
    allowed = before[hand, point] + way[hand, point] * (reach / np.maximum(length, 1e-12))[hand, point][..., None]
    axes = to_matrix(shown.rotation[:, 0])
    arc = shortest_arcs((place - base) @ axes, (allowed - base) @ axes)
    return np.where(np.take_along_axis(over, worst, axis=-1) > _OVER, arc, _STAY)


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors * vectors) @ _ONES)
