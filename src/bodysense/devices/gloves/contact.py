"""Hand contact: hands do not pass through each other or themselves, and fingertips meet if their markers do.

The solver moves the networks' hands as little as possible until no two capsules (body/hands/hand_capsules.py) overlap.
It turns fingers within their joint limits and moves both of two colliding hands. If the markers of a thumb and finger,
or of fingertips of two hands, are as close as touching fingertips, it brings the model's fingertips as close. Touching
fingertips stay in touch. Every frame starts from the correction of the frame before, and the correction has a maximum
speed: a sudden collision takes a few frames to resolve, and nothing jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import ALIGNMENT, MARKERS, default_glove
from bodysense.body.hands.hand import FINGERS, Side, angle_indices, default_axes, joint_angles, joint_rotations, limits
from bodysense.body.hands.hand_capsules import GIVE
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.collisions import CapsulePairs, HandColliders, NearestPoints
from bodysense.devices.gloves.contact_rows import (
    ANGLES,
    PARTS,
    ContactSettings,
    growth_rows,
    least_change,
    tip_capsules,
    tip_pairs,
    turning_axes,
)
from bodysense.devices.gloves.fingers import CHAINS, HandPoses, HandShape, hand_shape, place_hands
from bodysense.errors import BodysenseError
from bodysense.geometry.products import CONJUGATE, multiply

_PLACE, _FREE = angle_indices()  # (15, 3) index of each joint's flexion, abduction and twist, and which of them it has
_LOW, _HIGH = (np.where(_FREE, of[_PLACE], 0.0) for of in limits())  # (15, 3) rad
_TIP_MARKERS = [MARKERS.index(f"{finger}_tip") for finger in FINGERS]
_LONGEST_STEP, _SHORT_STEP = 0.3, 0.01  # rad: largest linear step; after a smaller one than the second, iteration stops
_MOST_ROWS = 48  # maximum number of collisions in a step; the deepest are kept
_SOFT, _SOFT_PINCH = 1e-3, 1e-2  # softness of collisions and touches, and of pinches, relative to a finger's compliance
_UNSEEN = 2e-4  # m; smaller corrections are ignored
_SLACK = 3e-4  # m; smaller residuals are ignored
_ALIGNMENT = list(ALIGNMENT)
# (48,) index of the part of the hand to which each part of a change belongs: five fingers, then the back of the hand.
_PART_OF_HAND = np.repeat([0, 1, 2, 3, 4, 5], [9, 9, 9, 9, 9, 3])


@dataclass(frozen=True, eq=False)
class ContactState:
    """State for the next frame."""

    begun: bool = False  # whether there was a frame
    change: np.ndarray | None = None  # (H, 48): correction of 45 angles, rad, and of the wrist, m; None: zero
    displacement: float = 0.0  # m: upper bound of a point's displacement by the correction


class _Pinches(NamedTuple):
    """Pairs of fingertips to bring together."""

    tips: np.ndarray  # (2, N) numbers of fingertips, hand · 5 + finger
    offset: np.ndarray  # (N, 3) m world, wanted vector from the first to the second


@dataclass(frozen=True, eq=False)
class _SplitHands:
    """Hands before contact, split into parts that a change alters and parts that it does not."""

    root: np.ndarray  # (H, 3)
    wrist: np.ndarray  # (H, 1, 4)
    angles: np.ndarray  # (H, 15, 3) rad
    rest: np.ndarray  # (H, 15, 4) the rest of the joints' rotations after their angles
    pinches: _Pinches


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact solver of H hands, given by their skeletons (body.hand.hand_skeleton) and sides.

    It tests all pairs of hands, so it suits a few hands. Raises BodysenseError unless there is one side for each hand.
    """

    hands: Sequence[Skeleton]
    sides: Sequence[Side]
    settings: ContactSettings = ContactSettings()

    def __post_init__(self) -> None:
        if len(self.hands) != len(self.sides):
            raise BodysenseError(f"contact: {len(self.hands)} hands and {len(self.sides)} sides; give one side a hand")

    @cached_property
    def _colliders(self) -> HandColliders:
        return HandColliders(self.hands, self.sides)

    @cached_property
    def _shape(self) -> HandShape:
        return hand_shape(self.hands, (default_glove(),) * len(self.hands))

    @cached_property
    def _lever(self) -> np.ndarray:
        """(H, 45) m from each angle's joint to its fingertip, with the finger straight."""
        rest = np.stack([hand.path @ hand.rest_offset for hand in self.hands])[:, CHAINS]  # (H, 5, 4, 3)
        return np.linalg.norm(rest[:, :, 3:] - rest[:, :, :3], axis=-1).reshape(-1, 15).repeat(3, axis=1)

    @cached_property
    def _compliance(self) -> np.ndarray:
        """(H, 48) compliance of each part without seen markers; 0 if fixed."""
        shift = np.full((len(self.hands), PARTS - ANGLES), 1 / self.settings.hand_weight)
        return np.concatenate([_FREE.ravel() / self._lever**2, shift], axis=1)

    @cached_property
    def _tips(self) -> np.ndarray:
        """(2, N) numbers of fingertips that can pinch."""
        return np.array(tip_pairs(len(self.hands))).T

    def start(self) -> ContactState:
        """Return the state before the first frame."""
        return ContactState()

    def step(
        self, posed: HandPoses, markers: np.ndarray, known: np.ndarray, interval: float, state: ContactState
    ) -> tuple[HandPoses, ContactState]:
        """Return the hands of the next frame with the smallest correction for contact.

        Args:
            posed: hands before contact.
            markers: (H, 9, 3) m in each hand's own mirrored world, seen or filled; NaN if unknown.
            known: (H, 9) bool: markers that are seen.
            interval: seconds since the frame before.
            state: from `start` or the frame before.

        Returns:
            The hands, the object `posed` itself if nothing moves, and the state for the next frame.
        """
        pairs, pinching = self._colliders.pairs(posed.position), self._pinches(posed, markers, known)
        nearest = self._colliders.nearest(posed.position, pairs)
        needed = len(pinching.offset) > 0 or self._collides(pairs, nearest).any()
        remaining = 0.5 ** (interval / self.settings.half_life)
        if not needed and remaining * state.displacement < _UNSEEN:
            return posed, ContactState(True)
        before = np.zeros((len(posed.root), PARTS)) if state.change is None else state.change
        split, rest = self._split(posed, pinching), remaining * before
        change, corrected = self._solve(split, known, pairs, self._farthest(pairs, nearest), rest)
        unsolved = change is rest
        displacement = remaining * state.displacement if unsolved else self._displacement(change)
        if state.begun:
            step = (1 - remaining) * state.displacement if unsolved else self._displacement(change - before)
            allowed = self.settings.speed * interval
            if step > allowed:
                change = before + (allowed / step) * (change - before)
                corrected, displacement = self._apply(split, change), self._displacement(change)
        if displacement < _UNSEEN:
            return posed, ContactState(True)
        return _merged(posed, change, corrected), ContactState(True, change, displacement)

    def _collides(self, pairs: CapsulePairs, nearest: NearestPoints) -> np.ndarray:
        """Return (P,) bool: the pair overlaps by more than the tolerance."""
        return nearest.distance < pairs.reach - self.settings.tolerance - _SLACK

    def _farthest(self, pairs: CapsulePairs, nearest: NearestPoints) -> np.ndarray:
        """Return the largest allowed distance (P,) m of pairs in a frame.

        Fingertips that touch or nearly touch keep their distance. Other pairs have no limit.
        """
        farthest, tips = np.full(len(pairs.reach), np.inf), pairs.tips
        distance, touch = nearest.distance[tips], pairs.reach[tips] / (1 - GIVE)
        gap, keeping = np.maximum(distance - touch, 0.0), self.settings.keeping
        most = np.maximum(distance, touch) + gap * gap * gap / keeping**2
        farthest[tips] = np.where(gap < keeping, most, np.inf)
        return farthest

    def _pinches(self, posed: HandPoses, markers: np.ndarray, known: np.ndarray) -> _Pinches:
        """Return pairs of fingertips that are farther apart than their markers, which are close to each other.

        Only seen markers count: a filled one is no evidence of touch.
        """
        tips, settings = self._tips, self.settings
        tip_markers = (markers.take(_TIP_MARKERS, axis=1) * self._colliders.flip[:, None]).reshape(-1, 3)
        offset, present = (of[tips[1]] - of[tips[0]] for of in (tip_markers, self._tip_points(posed)))
        distance, gap = (np.linalg.norm(of, axis=-1) for of in (offset, present))
        seen = known.take(_TIP_MARKERS, axis=1).ravel()[tips].all(axis=0)
        near = seen & (distance < settings.apart) & (gap - distance > settings.missed)
        offset, present, distance = offset[near], present[near], distance[near]
        share = np.minimum((settings.apart - distance) / (settings.apart - settings.touching), 1.0)[:, None]
        return _Pinches(tips[:, near], present + share * (offset - present))

    def _tip_points(self, posed: HandPoses) -> np.ndarray:
        """Return the fingertips (H · 5, 3) m, world."""
        return (posed.position[:, -5:] * self._colliders.flip[:, None]).reshape(-1, 3)

    def _split(self, posed: HandPoses, pinching: _Pinches) -> _SplitHands:
        """Split hands into parts that may change and parts that are fixed."""
        local = posed.rotation[:, 1:]
        angles = joint_angles(local, default_axes()) * _FREE
        rest = multiply(joint_rotations(angles, default_axes()) * CONJUGATE, local)
        return _SplitHands(posed.root, posed.rotation[:, :1], angles, rest, pinching)

    def _freedom(self, split: _SplitHands, known: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Return the compliance of each part of a change (H · 48,), and its bounds (H · 48,), (H · 48,)."""
        seen = np.empty((len(known), 6))
        seen[:, :5] = known.take(_TIP_MARKERS, axis=1)
        seen[:, 5] = np.logical_and.reduce(known.take(_ALIGNMENT, axis=1), axis=1)
        compliance = self._compliance / (1 + (self.settings.seen_weight - 1) * seen).take(_PART_OF_HAND, axis=1)
        low, high = np.full(compliance.shape, -np.inf), np.full(compliance.shape, np.inf)
        low[:, :ANGLES] = np.minimum(_LOW - split.angles, 0).reshape(-1, ANGLES)
        high[:, :ANGLES] = np.maximum(_HIGH - split.angles, 0).reshape(-1, ANGLES)
        return compliance.ravel(), (low.ravel(), high.ravel())

    def _apply(self, split: _SplitHands, change: np.ndarray) -> HandPoses:
        """Return hands after a change (H, 48)."""
        local = multiply(joint_rotations(_angles(split, change), default_axes()), split.rest)
        return place_hands(self._shape, split.root + change[:, ANGLES:], np.concatenate([split.wrist, local], axis=1))

    def _solve(
        self, split: _SplitHands, known: np.ndarray, pairs: CapsulePairs, farthest: np.ndarray, rest: np.ndarray
    ) -> tuple[np.ndarray, HandPoses]:
        """Return the change (H, 48) after which nothing collides, and the hands after it.

        Takes linear steps from the remaining correction of the last frame, `rest`.
        """
        change, corrected, freedom = rest, self._apply(split, rest), None
        for _ in range(self.settings.max_iterations):
            nearest = self._colliders.nearest(corrected.position, pairs)
            wrong = self._collides(pairs, nearest) | (nearest.distance > farthest + _SLACK)
            if not len(split.pinches.offset) and not wrong.any():
                break
            rows, demand, softness = self._demands(split, change, corrected, pairs, farthest, nearest)
            compliance, (low, high) = freedom = freedom or self._freedom(split, known)
            bounds = (low - change.ravel(), high - change.ravel())
            exact = np.arange(len(rows)) >= len(rows) - 3 * len(split.pinches.offset)
            step = least_change(rows, demand, exact, compliance, bounds, softness)
            step = np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
            change = change + step.reshape(change.shape)
            corrected = self._apply(split, change)
            if np.abs(step).max() < _SHORT_STEP:
                break
        return change, corrected

    def _demands(
        self,
        split: _SplitHands,
        change: np.ndarray,
        corrected: HandPoses,
        pairs: CapsulePairs,
        farthest: np.ndarray,
        nearest: NearestPoints,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows (K, H · 48), their demanded growth (K,), and its softness (K,).

        Collisions and fingertips that must stay in touch come first. Pinches follow; their demands are exact.
        """
        distance = nearest.distance
        gap = distance - pairs.reach
        parting = distance > (pairs.reach + farthest) / 2  # fingertips closer to parting than to colliding
        close = (gap < self.settings.nearby) & ~parting
        if np.count_nonzero(close) > _MOST_ROWS:
            close[np.argsort(np.where(close, gap, np.inf))[_MOST_ROWS:]] = False
        which = np.flatnonzero(close | parting)
        demand = np.where(parting, distance - farthest, -gap - self.settings.tolerance)[which]
        sign = np.where(parting, -1.0, 1.0) / np.maximum(distance, 1e-9)
        place = nearest.place[:, which]
        toward = (place[1] - place[0]) * sign[which, None]
        tips, wanted = split.pinches
        tip = self._tip_points(corrected)[tips]  # (2, N, 3)
        # Each pinch makes three demands, one along each axis of the world.
        capsule = np.concatenate([pairs.capsule[:, which], tip_capsules(tips).repeat(3, axis=1)], axis=1)
        place = np.concatenate([place, tip.repeat(3, axis=1)], axis=1)
        toward = np.concatenate([toward, np.tile(np.eye(3), (len(wanted), 1))])
        demand = np.concatenate([demand, (wanted - tip[1] + tip[0]).ravel()])
        softness = np.repeat([_SOFT, _SOFT_PINCH], [len(which), 3 * len(wanted)])
        axes = turning_axes(self._shape, corrected, _angles(split, change))
        return growth_rows(corrected, axes, self._colliders.flip, capsule, place, toward), demand, softness

    def _displacement(self, change: np.ndarray) -> float:
        """Return an upper bound (m) of a point's displacement by a change (H, 48)."""
        turned = (np.abs(change[:, :ANGLES]) * self._lever).reshape(-1, 5, 9).sum(axis=-1)  # of every fingertip
        return float((turned.max(axis=1) + np.linalg.norm(change[:, ANGLES:], axis=1)).max())


def _angles(split: _SplitHands, change: np.ndarray) -> np.ndarray:
    """Return angles (H, 15, 3) rad after a change (H, 48)."""
    return split.angles + change[:, :ANGLES].reshape(split.angles.shape)


def _merged(posed: HandPoses, change: np.ndarray, corrected: HandPoses) -> HandPoses:
    """Return the hands after a change; untouched values are bit-identical."""
    touched = change != 0
    turned = touched[:, :ANGLES].reshape(-1, 5, 9).max(axis=-1)
    shifted = touched[:, ANGLES:].max(axis=-1, keepdims=True)
    joints = turned.repeat(3, axis=1)
    points = shifted | np.concatenate([shifted, joints, turned], axis=1)
    position = np.where(points[..., None], corrected.position, posed.position)
    rotation = np.where(np.insert(joints, 0, False, axis=1)[..., None], corrected.rotation, posed.rotation)
    return HandPoses(position[:, 0], rotation, position)
