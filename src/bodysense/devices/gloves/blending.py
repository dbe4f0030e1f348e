"""Blending of hands if markers are found again: an offset of the pose absorbs the jump, then decays.

Blending markers one by one deforms the hand, so blend poses: first position and rotation of the back of the hand, then
every finger. Each part moves as far as allowed. No point is corrected faster than `speed`, and none moves farther in a
frame than its known motion plus `speed`. For points with hidden markers this is `unseen_speed`, because their positions
are less certain. A finger that would still move too far is turned back.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import Glove
from bodysense.body.hands.hand import FINGERS
from bodysense.devices.gloves.fingers import CHAINS, POINT_COUNT, HandPoses, HandShape, place_hands, shortest_arcs
from bodysense.geometry.products import CONJUGATE, exp, log, multiply, to_matrix

_TOLERANCE = 1e-4  # m; smaller residuals are ignored
_NO_MOTION = 1e-14  # m²; smaller squared motions are ignored
_BACK = np.array([0, *CHAINS[:, 0]])  # points that the fingers do not move
_ALL = np.ones((1, 5))
_ONES = np.ones(3)
_STAY = np.array([1.0, 0.0, 0.0, 0.0])


class PoseOffset(NamedTuple):
    """Offset of H output hands from the solved ones."""

    root: np.ndarray  # (H, 3) m
    turn: np.ndarray  # (H, 16, 3) rotation vectors that follow the solved rotations, the wrist's in the world


class BlendState(NamedTuple):
    """State after the frame before."""

    output: np.ndarray  # (H, 21, 3) m
    solved: np.ndarray  # (H, 21, 3) m
    known: np.ndarray  # (H, 9) bool
    offset: PoseOffset | None  # None: the output equals the solved poses
    speed: np.ndarray  # (H, 1) m/s, at which the offset decays


@dataclass(frozen=True, eq=False)
class Blend:
    """Blending of hands of a `shape` with a glove. Speeds in m/s."""

    shape: HandShape
    glove: Glove
    speed: float
    unseen_speed: float
    longest: float = 0.5  # s: larger offsets decay faster, so that they take no longer

    @cached_property
    def _needed(self) -> np.ndarray:
        """(9, 21) 1 if the motion of a point is reliable only while the marker is seen, else 0."""
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
        """Return the output hands, which are the object `solved` without an offset, and the state for the next frame.

        Args:
            solved: hands by all markers.
            without: hands by the markers except those found in this frame; the object `solved` if none was found.
            known: (H, 9) bool: markers that are seen.
            interval: seconds since the frame before.
            state: after the frame before; None before the first.
        """
        if state is None or (state.offset is None and without is solved):
            speed = np.full((len(known), 1), self.speed) if state is None else state.speed
            return solved, BlendState(solved.position, solved.position, known, None, speed)
        start, speed = apply_offset(without, state.offset, self.shape), state.speed
        if without is not solved:
            farthest = np.linalg.norm(start.position - solved.position, axis=-1).max(axis=1, keepdims=True)
            speed = np.maximum(self.speed, farthest / self.longest)
        most = speed * interval
        sure = ~(known & state.known) @ self._needed == 0
        motion = np.linalg.norm(without.position - state.solved, axis=-1)
        reach = motion + most * np.where(sure, 1.0, self.unseen_speed / self.speed)

        def remaining(begin: HandPoses, end: HandPoses, points: np.ndarray) -> np.ndarray:
            """Return (H, …): the share of the motion that remains when one of the points (…, N) reaches its limit."""
            step, path = begin.position - state.output, end.position - begin.position
            step, path, far = (part.take(points, axis=1) for part in (step, path, reach))
            return 1 - _share(step, path, far, most).min(axis=-1)

        offset = offset_between(start, solved)
        offset = scale_offset(offset, remaining(start, solved, _BACK[None]), _ALL)
        end = apply_offset(solved, scale_offset(offset, _ALL[:, :1], 0 * _ALL), self.shape)
        offset = scale_offset(offset, _ALL[:, :1], remaining(apply_offset(solved, offset, self.shape), end, CHAINS))
        output = apply_offset(solved, offset, self.shape)
        arc = _limiting_arcs(output, state.output, reach)
        if arc is not None:
            output.rotation[:, 1::3] = multiply(arc, output.rotation[:, 1::3])
            output = place_hands(self.shape, output.root, output.rotation)
            offset = offset_between(output, solved)
        elif not offset.root.any() and not offset.turn.any():
            return solved, BlendState(solved.position, solved.position, known, None, speed)
        return output, BlendState(output.position, solved.position, known, offset, speed)


def offset_between(output: HandPoses, solved: HandPoses) -> PoseOffset:
    """Return the offset of output hands from solved ones."""
    turn = multiply(output.rotation, solved.rotation * CONJUGATE)
    return PoseOffset(output.root - solved.root, log(turn))


def scale_offset(offset: PoseOffset, back: np.ndarray, fingers: np.ndarray) -> PoseOffset:
    """Scale an offset by a share (H, 1) for the back of the hand and shares (H, 5) for the fingers, or (1, …)."""
    share = np.empty(offset.turn.shape[:2])
    share[:, :1], share[:, 1:] = back, fingers.repeat(3, axis=1)
    return PoseOffset(offset.root * back, offset.turn * share[..., None])


def apply_offset(solved: HandPoses, offset: PoseOffset | None, shape: HandShape) -> HandPoses:
    """Apply an offset to hands; return the object `solved` if there is no offset."""
    if offset is None:
        return solved
    return place_hands(shape, solved.root + offset.root, multiply(exp(offset.turn), solved.rotation))


def _share(step: np.ndarray, path: np.ndarray, reach: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Return the largest share s ≤ 1 with |step + s · path| ≤ reach and |s · path| ≤ most, vectors (H, …, 3), m.

    If no s meets the first condition, return the one with the smallest |step + s · path|.
    """
    squared, along = (path * path) @ _ONES, (step * path) @ _ONES
    over = (step * step) @ _ONES - reach * reach
    root = np.sqrt(np.maximum(along * along - squared * over, 0.0))
    most = most[..., None] / np.maximum(np.sqrt(squared), 1e-12)
    share = np.where(squared + 2 * along + over <= 0, 1.0, (root - along) / np.maximum(squared, _NO_MOTION))
    return np.minimum(np.maximum(share, 0.0), np.minimum(most, 1.0))


def _limiting_arcs(output: HandPoses, before: np.ndarray, reach: np.ndarray) -> np.ndarray | None:
    """Return arcs (H, 5, 4) about fingers' bases that bring points back within their limits; None if all are within.

    The point with the largest excess decides for each finger.
    """
    path = output.position - before
    length = np.linalg.norm(path, axis=-1)
    over = (length - reach)[:, CHAINS]
    if not (over > _TOLERANCE).any():
        return None
    worst = np.argmax(over, axis=-1, keepdims=True)
    point = np.take_along_axis(np.broadcast_to(CHAINS, over.shape), worst, axis=-1)[..., 0]
    hand = np.arange(len(path))[:, None]
    base, place = output.position[:, CHAINS[:, 0]], output.position[hand, point]
    allowed = before[hand, point] + path[hand, point] * (reach / np.maximum(length, 1e-12))[hand, point][..., None]
    axes = to_matrix(output.rotation[:, 0])
    arc = shortest_arcs((place - base) @ axes, (allowed - base) @ axes)
    return np.where(np.take_along_axis(over, worst, axis=-1) > _TOLERANCE, arc, _STAY)
