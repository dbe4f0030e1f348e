"""Hand contact: hands do not pass through each other or themselves, and fingertips meet if their markers do.

The networks' hands are moved as little as possible so that no two capsules (body/hand_capsules.py) overlap: fingers
turn within their limits, and colliding hands both give way. If the markers of a thumb and a finger, or of fingertips
of two hands, are as close as touching fingertips, the model's fingertips are brought as close; touching fingertips
stay in touch. Every frame starts from the correction of the frame before, and the correction has a maximum speed: a
sudden collision takes a few frames to be resolved, and nothing jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bodysense.body.glove import ALIGNMENT, MARKERS, default_glove
from bodysense.body.hand import FINGERS, Side, default_axes, joint_angles, joint_places, joint_rotations, limits
from bodysense.body.hand_capsules import GIVE
from bodysense.body.products import CONJUGATE, multiply
from bodysense.body.skeleton import Skeleton
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
from bodysense.devices.gloves.meetings import HandFlesh, Meeting, Pairs
from bodysense.errors import BodysenseError

_PLACE, _FREE = joint_places()  # (15, 3) which angles a joint has: flexion, abduction, twist
_LOW, _HIGH = (np.where(_FREE, of[_PLACE], 0.0) for of in limits())  # (15, 3) rad
_TIP_MARKERS = [MARKERS.index(f"{finger}_tip") for finger in FINGERS]
_LONGEST_STEP, _SHORT_STEP = 0.3, 0.01  # rad of a linear step; after a short one no other is needed
_MOST_ROWS = 48  # of collisions at a time, the deepest
_SOFT, _SOFT_PINCH = 1e-3, 1e-2  # softness of collisions and touches, and of pinches, relative to a finger's own ease
_UNSEEN = 2e-4  # m; smaller corrections are ignored
_SLACK = 3e-4  # m; smaller residuals are ignored
_ALIGNMENT = list(ALIGNMENT)
# (48,) the markers that weight each part of the change: those of five fingers, and the back of the hand.
_WEIGHED = np.repeat([0, 1, 2, 3, 4, 5], [9, 9, 9, 9, 9, 3])


@dataclass(frozen=True, eq=False)
class ContactState:
    """State for the next frame."""

    begun: bool = False  # whether there was a frame
    change: np.ndarray | None = None  # (H, 48): correction of 45 angles, rad, and of the wrist, m; None: zero
    way: float = 0.0  # m: upper bound of a point's displacement by it


class _Pinches(NamedTuple):
    """Pairs of fingertips that are to be brought together."""

    tips: np.ndarray  # (2, N) numbers of fingertips, hand · 5 + finger
    offset: np.ndarray  # (N, 3) m world, wanted vector from the first to the second


@dataclass(frozen=True, eq=False)
class _Given:
    """A frame before contact, to which a change is applied."""

    root: np.ndarray  # (H, 3)
    wrist: np.ndarray  # (H, 1, 4)
    angles: np.ndarray  # (H, 15, 3) rad
    rest: np.ndarray  # (H, 15, 4) the rest of the joints' rotations after their angles
    pinches: _Pinches


@dataclass(frozen=True, eq=False)
class Contact:
    """The contact solver of some hands: their skeletons (body.hand.hand_skeleton), and sides.

    Suited to few hands: all pairs are tested. Raises BodysenseError unless there is one side for each hand.
    """

    hands: Sequence[Skeleton]
    sides: Sequence[Side]
    settings: ContactSettings = ContactSettings()

    def __post_init__(self) -> None:
        if len(self.hands) != len(self.sides):
            raise BodysenseError(f"contact: {len(self.hands)} hands and {len(self.sides)} sides; give one side a hand")

    @cached_property
    def _flesh(self) -> HandFlesh:
        return HandFlesh(self.hands, self.sides)

    @cached_property
    def _shape(self) -> HandShape:
        return hand_shape(self.hands, (default_glove(),) * len(self.hands))

    @cached_property
    def _lever(self) -> np.ndarray:
        """(H, 45) m from each angle's joint to its fingertip, with the finger straight."""
        rest = np.stack([hand.path @ hand.rest_offset for hand in self.hands])[:, CHAINS]  # (H, 5, 4, 3)
        return np.linalg.norm(rest[:, :, 3:] - rest[:, :, :3], axis=-1).reshape(-1, 15).repeat(3, axis=1)

    @cached_property
    def _ease(self) -> np.ndarray:
        """(H, 48) compliance of each part without seen markers; 0 if fixed."""
        shift = np.full((len(self.hands), PARTS - ANGLES), 1 / self.settings.hand_weight)
        return np.concatenate([_FREE.ravel() / self._lever**2, shift], axis=1)

    @cached_property
    def _tips(self) -> np.ndarray:
        """(2, N) numbers of fingertips that can pinch."""
        return np.array(tip_pairs(len(self.hands))).T

    def start(self) -> ContactState:
        """The state before the first frame."""
        return ContactState()

    def step(
        self, posed: HandPoses, markers: np.ndarray, known: np.ndarray, interval: float, state: ContactState
    ) -> tuple[HandPoses, ContactState]:
        """Return the hands of the next frame with the least correction for contact.

        Args:
            posed: the hands without contact.
            markers: (H, 9, 3) m in each hand's own mirrored world, seen or filled; NaN if unknown.
            known: (H, 9) bool: markers that are seen.
            interval: seconds since the frame before.
            state: from `start` or the frame before.

        Returns:
            `posed` itself if nothing moves, and the state for the next frame.
        """
        pairs, pinching = self._flesh.pairs(posed.position), self._pinches(posed, markers, known)
        meeting = self._flesh.meet(posed.position, pairs)
        needed = len(pinching.offset) > 0 or self._collides(pairs, meeting).any()
        remaining = 0.5 ** (interval / self.settings.half_life)
        if not needed and remaining * state.way < _UNSEEN:
            return posed, ContactState(True)
        before = np.zeros((len(posed.root), PARTS)) if state.change is None else state.change
        given, rest = self._given(posed, pinching), remaining * before
        wanted, placed = self._solved(given, known, pairs, self._farthest(pairs, meeting), rest)
        limited, way = wanted, remaining * state.way if wanted is rest else self._way(wanted)
        if state.begun:
            moved = (1 - remaining) * state.way if wanted is rest else self._way(wanted - before)
            allowed = self.settings.speed * interval
            if moved > allowed:
                limited = before + (allowed / moved) * (wanted - before)
                placed, way = self._placed(given, limited), self._way(limited)
        if way < _UNSEEN:
            return posed, ContactState(True)
        return _moved(posed, limited, placed), ContactState(True, limited, way)

    def _collides(self, pairs: Pairs, meeting: Meeting) -> np.ndarray:
        """(P,) whether pairs overlap by more than the tolerance."""
        return meeting.distance < pairs.reach - self.settings.tolerance - _SLACK

    def _farthest(self, pairs: Pairs, meeting: Meeting) -> np.ndarray:
        """Return the largest allowed distance (P,) m of pairs in a frame.

        Fingertips that touch, or nearly, keep their distance; other pairs are free.
        """
        farthest, tips = np.full(len(pairs.reach), np.inf), pairs.tips
        distance, touch = meeting.distance[tips], pairs.reach[tips] / (1 - GIVE)
        gap, keeping = np.maximum(distance - touch, 0.0), self.settings.keeping
        most = np.maximum(distance, touch) + gap * gap * gap / keeping**2
        farthest[tips] = np.where(gap < keeping, most, np.inf)
        return farthest

    def _pinches(self, posed: HandPoses, markers: np.ndarray, known: np.ndarray) -> _Pinches:
        """Return fingertips whose markers are close to each other but which are farther apart than these.

        A filled marker is not evidence of touch.
        """
        tips, settings = self._tips, self.settings
        told = (markers.take(_TIP_MARKERS, axis=1) * self._flesh.flip[:, None]).reshape(-1, 3)
        offset, present = (of[tips[1]] - of[tips[0]] for of in (told, self._tip_points(posed)))
        distance, gap = (np.linalg.norm(of, axis=-1) for of in (offset, present))
        seen = known.take(_TIP_MARKERS, axis=1).ravel()[tips].all(axis=0)
        near = seen & (distance < settings.apart) & (gap - distance > settings.missed)
        offset, present, distance = offset[near], present[near], distance[near]
        share = np.minimum((settings.apart - distance) / (settings.apart - settings.touching), 1.0)[:, None]
        return _Pinches(tips[:, near], present + share * (offset - present))

    def _tip_points(self, posed: HandPoses) -> np.ndarray:
        """Return the fingertips (H · 5, 3) m, world."""
        return (posed.position[:, -5:] * self._flesh.flip[:, None]).reshape(-1, 3)

    def _given(self, posed: HandPoses, pinching: _Pinches) -> _Given:
        """Split a frame into parts that may change and parts that are fixed."""
        local = posed.rotation[:, 1:]
        angles = joint_angles(local, default_axes()) * _FREE
        rest = multiply(joint_rotations(angles, default_axes()) * CONJUGATE, local)
        return _Given(posed.root, posed.rotation[:, :1], angles, rest, pinching)

    def _freedom(self, given: _Given, known: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Return the compliance of each part of a change (H · 48,), and its bounds (H · 48,), (H · 48,)."""
        seen = np.empty((len(known), 6))
        seen[:, :5] = known.take(_TIP_MARKERS, axis=1)
        seen[:, 5] = np.logical_and.reduce(known.take(_ALIGNMENT, axis=1), axis=1)
        ease = self._ease / (1 + (self.settings.seen_weight - 1) * seen).take(_WEIGHED, axis=1)
        low, high = np.full(ease.shape, -np.inf), np.full(ease.shape, np.inf)
        low[:, :ANGLES] = np.minimum(_LOW - given.angles, 0).reshape(-1, ANGLES)
        high[:, :ANGLES] = np.maximum(_HIGH - given.angles, 0).reshape(-1, ANGLES)
        return ease.ravel(), (low.ravel(), high.ravel())

    def _placed(self, given: _Given, change: np.ndarray) -> HandPoses:
        """Return hands after a change (H, 48)."""
        local = multiply(joint_rotations(_angles(given, change), default_axes()), given.rest)
        return place_hands(self._shape, given.root + change[:, ANGLES:], np.concatenate([given.wrist, local], axis=1))

    def _solved(
        self, given: _Given, known: np.ndarray, pairs: Pairs, farthest: np.ndarray, rest: np.ndarray
    ) -> tuple[np.ndarray, HandPoses]:
        """Return the change (H, 48) after which nothing collides, and the hands after it.

        Takes linear steps from the remaining correction of the last frame, `rest`.
        """
        change, placed, freedom = rest, self._placed(given, rest), None
        for _ in range(self.settings.max_iterations):
            meeting = self._flesh.meet(placed.position, pairs)
            wrong = self._collides(pairs, meeting) | (meeting.distance > farthest + _SLACK)
            if not len(given.pinches.offset) and not wrong.any():
                break
            rows, demand, softness = self._demands(given, change, placed, pairs, farthest, meeting)
            ease, (low, high) = freedom = freedom or self._freedom(given, known)
            bounds = (low - change.ravel(), high - change.ravel())
            exact = np.arange(len(rows)) >= len(rows) - 3 * len(given.pinches.offset)
            way = least_change(rows, demand, exact, ease, bounds, softness)
            way = np.clip(way, -_LONGEST_STEP, _LONGEST_STEP)
            change = change + way.reshape(change.shape)
            placed = self._placed(given, change)
            if np.abs(way).max() < _SHORT_STEP:
                break
        return change, placed

    def _demands(
        self,
        given: _Given,
        change: np.ndarray,
        placed: HandPoses,
        pairs: Pairs,
        farthest: np.ndarray,
        meeting: Meeting,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows (K, H · 48), their demanded growth (K,), and its softness (K,).

        Collisions and fingertips that must stay in touch come first, then pinches, which are met exactly.
        """
        distance = meeting.distance
        gap = distance - pairs.reach
        parting = distance > (pairs.reach + farthest) / 2  # of fingertips: closer to parting than to colliding
        close = (gap < self.settings.nearby) & ~parting
        if np.count_nonzero(close) > _MOST_ROWS:
            close[np.argsort(np.where(close, gap, np.inf))[_MOST_ROWS:]] = False
        which = np.flatnonzero(close | parting)
        demand = np.where(parting, distance - farthest, -gap - self.settings.tolerance)[which]
        sign = np.where(parting, -1.0, 1.0) / np.maximum(distance, 1e-9)
        place = meeting.place[:, which]
        toward = (place[1] - place[0]) * sign[which, None]
        tips, wanted = given.pinches
        tip = self._tip_points(placed)[tips]  # (2, N, 3)
        # Each pinch makes three demands, one along each axis of the world.
        capsule = np.concatenate([pairs.capsule[:, which], tip_capsules(tips).repeat(3, axis=1)], axis=1)
        place = np.concatenate([place, tip.repeat(3, axis=1)], axis=1)
        toward = np.concatenate([toward, np.tile(np.eye(3), (len(wanted), 1))])
        demand = np.concatenate([demand, (wanted - tip[1] + tip[0]).ravel()])
        softness = np.repeat([_SOFT, _SOFT_PINCH], [len(which), 3 * len(wanted)])
        axes = turning_axes(self._shape, placed, _angles(given, change))
        return growth_rows(placed, axes, self._flesh.flip, capsule, place, toward), demand, softness

    def _way(self, change: np.ndarray) -> float:
        """Return an upper bound (m) of a point's displacement by a change (H, 48)."""
        turned = (np.abs(change[:, :ANGLES]) * self._lever).reshape(-1, 5, 9).sum(axis=-1)  # of every fingertip
        return float((turned.max(axis=1) + np.linalg.norm(change[:, ANGLES:], axis=1)).max())


def _angles(given: _Given, change: np.ndarray) -> np.ndarray:
    """Return angles (H, 15, 3) rad after a change (H, 48)."""
    return given.angles + change[:, :ANGLES].reshape(given.angles.shape)


def _moved(posed: HandPoses, change: np.ndarray, placed: HandPoses) -> HandPoses:
    """Return the hands after a change; untouched values are bit-identical."""
    touched = change != 0
    turned = touched[:, :ANGLES].reshape(-1, 5, 9).max(axis=-1)
    shifted = touched[:, ANGLES:].max(axis=-1, keepdims=True)
    joints = turned.repeat(3, axis=1)
    points = shifted | np.concatenate([shifted, joints, turned], axis=1)
    position = np.where(points[..., None], placed.position, posed.position)
    rotation = np.where(np.insert(joints, 0, False, axis=1)[..., None], placed.rotation, posed.rotation)
    return HandPoses(position[:, 0], rotation, position)
