"""No jump of a hand if markers are found again: an offset of its pose takes up the change, and closes.

Blending markers one by one deforms the hand, so blend poses: first position and rotation of the back of the hand, then
every finger. A deformed back has no reliable position, and a finger's joints can move twice as far as its tip. Each
part moves as far as allowed. No point is corrected faster than `speed`, and none moves farther in a frame than its
known motion plus `speed`: `unseen_speed` if its markers are not seen, because its position is less certain then. A
finger that would still move too far is turned back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bodysense.body.glove import Glove
from bodysense.body.hand import FINGERS
from bodysense.body.products import CONJUGATE, exp, log, multiply, to_matrix
from bodysense.devices.gloves.fingers import CHAINS, POINT_COUNT, HandPoses, HandShape, place_hands, shortest_arcs

_OVER = 1e-4  # m; smaller residuals are ignored
_NOWHERE = 1e-14  # m²; shorter motions are ignored
_BACK = np.array([0, *CHAINS[:, 0]])  # points that the fingers do not move
_ALL = np.ones((1, 5))
_ONES = np.ones(3)
_STAY = np.array([1.0, 0.0, 0.0, 0.0])


class PoseOffset(NamedTuple):
    """Differences of H output hands from the solved ones."""

    root: np.ndarray  # (H, 3) m
    turn: np.ndarray  # (H, 16, 3) rotation vectors that follow the solved rotations, the wrist's in the world


class BlendState(NamedTuple):
    """The frame before."""

    output: np.ndarray  # (H, 21, 3) m
    solved: np.ndarray  # (H, 21, 3) m
    known: np.ndarray  # (H, 9) bool
    offset: PoseOffset | None  # None: the output equals the solved poses
    speed: np.ndarray  # (H, 1) m/s, at which the offset closes


@dataclass(frozen=True, eq=False)
class Blend:
    """Blends hands of a `shape` with a glove. Speeds in m/s."""

    shape: HandShape
    glove: Glove
    speed: float
    unseen_speed: float
    longest: float = 0.5  # s: larger offsets close faster, so that they take no longer

    @cached_property
    def _needed(self) -> np.ndarray:
        """(9, 21): 1 for markers that must be seen for a reliable motion of a point."""
        needed = np.zeros((len(self.glove.markers), POINT_COUNT))
        for marker, joint in enumerate(self.glove.carried_by):
            if joint == "wrist":
                needed[marker] = 1.0
            else:
                needed[marker, CHAINS[FINGERS.index(joint[:-1]), 1:]] = 1.0
        return needed

    def step(
        self, solved: HandPoses, without: HandPoses, known: np.ndarray, interval: float, state: BlendState | None
    ) -> tuple[HandPoses, BlendState]:
        """Return the output hands, the same object without an offset, and the state after them.

        Args:
            solved: the hands by all markers.
            without: the hands without the markers found since the frame before; `solved` itself without such markers.
            known: (H, 9) bool.
            interval: seconds since the frame before.
            state: after the frame before; None before the first.
        """
        if state is None or (state.offset is None and without is solved):
            speed = np.full((len(known), 1), self.speed) if state is None else state.speed
            return solved, BlendState(solved.position, solved.position, known, None, speed)
        start, speed = displaced(without, state.offset, self.shape), state.speed
        if without is not solved:
            farthest = np.linalg.norm(start.position - solved.position, axis=-1).max(axis=1, keepdims=True)
            speed = np.maximum(self.speed, farthest / self.longest)
        most = speed * interval
        sure = ~(known & state.known) @ self._needed == 0
        way = np.linalg.norm(without.position - state.solved, axis=-1)
        reach = way + most * np.where(sure, 1.0, self.unseen_speed / self.speed)

        def remaining(begin: HandPoses, end: HandPoses, points: np.ndarray) -> np.ndarray:
            """Return (H, …): the share of the motion that remains when one of the points (…, N) reaches its limit."""
            step, way = begin.position - state.output, end.position - begin.position
            step, way, far = (part.take(points, axis=1) for part in (step, way, reach))
            return 1 - _share(step, way, far, most).min(axis=-1)

        offset = between(start, solved)
        offset = scaled(offset, remaining(start, solved, _BACK[None]), _ALL)
        end = displaced(solved, scaled(offset, _ALL[:, :1], 0 * _ALL), self.shape)
        offset = scaled(offset, _ALL[:, :1], remaining(displaced(solved, offset, self.shape), end, CHAINS))
        output = displaced(solved, offset, self.shape)
        arc = _back(output, state.output, reach)
        if arc is not None:
            output.rotation[:, 1::3] = multiply(arc, output.rotation[:, 1::3])
            output = place_hands(self.shape, output.root, output.rotation)
            offset = between(output, solved)
        elif not offset.root.any() and not offset.turn.any():
            return solved, BlendState(solved.position, solved.position, known, None, speed)
        return output, BlendState(output.position, solved.position, known, offset, speed)


def between(output: HandPoses, solved: HandPoses) -> PoseOffset:
    """Return the offset of output hands from solved ones."""
    turn = multiply(output.rotation, solved.rotation * CONJUGATE)
    return PoseOffset(output.root - solved.root, log(turn))


def scaled(offset: PoseOffset, back: np.ndarray, fingers: np.ndarray) -> PoseOffset:
    """Scale an offset by a share (H, 1) for the back of the hand and shares (H, 5) for the fingers, or (1, …)."""
    share = np.empty(offset.turn.shape[:2])
    share[:, :1], share[:, 1:] = back, fingers.repeat(3, axis=1)
    return PoseOffset(offset.root * back, offset.turn * share[..., None])


def displaced(solved: HandPoses, offset: PoseOffset | None, shape: HandShape) -> HandPoses:
    """Apply an offset to hands; the same object if there is no offset."""
    if offset is None:
        return solved
    return place_hands(shape, solved.root + offset.root, multiply(exp(offset.turn), solved.rotation))


def _share(step: np.ndarray, way: np.ndarray, reach: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Return the largest share s ≤ 1 with |step + s · way| ≤ reach and |s · way| ≤ most, vectors (H, …, 3), m.

    If no s meets the first, return the one with the least |step + s · way|.
    """
    squared, along = (way * way) @ _ONES, (step * way) @ _ONES
    over = (step * step) @ _ONES - reach * reach
    root = np.sqrt(np.maximum(along * along - squared * over, 0.0))
    most = most[..., None] / np.maximum(np.sqrt(squared), 1e-12)
    share = np.where(squared + 2 * along + over <= 0, 1.0, (root - along) / np.maximum(squared, _NOWHERE))
    return np.minimum(np.maximum(share, 0.0), np.minimum(most, 1.0))


def _back(output: HandPoses, before: np.ndarray, reach: np.ndarray) -> np.ndarray | None:
    """Return arcs (H, 5, 4) about fingers' bases that bring points back within their limits; None: all are within.

    Each finger is judged by the point with the largest excess.
    """
    way = output.position - before
    length = np.linalg.norm(way, axis=-1)
    over = (length - reach)[:, CHAINS]
    if not (over > _OVER).any():
        return None
    worst = np.argmax(over, axis=-1, keepdims=True)
    point = np.take_along_axis(np.broadcast_to(CHAINS, over.shape), worst, axis=-1)[..., 0]
    hand = np.arange(len(way))[:, None]
    base, place = output.position[:, CHAINS[:, 0]], output.position[hand, point]
    allowed = before[hand, point] + way[hand, point] * (reach / np.maximum(length, 1e-12))[hand, point][..., None]
    axes = to_matrix(output.rotation[:, 0])
    arc = shortest_arcs((place - base) @ axes, (allowed - base) @ axes)
    return np.where(np.take_along_axis(over, worst, axis=-1) > _OVER, arc, _STAY)
