"""Rejection of wrong markers: spikes, ghosts, swapped identifiers (two-hands, section 7.2, Figure 16b).

A frame is predicted from the last one. If every marker is close to its prediction, nothing more is checked. Otherwise
the hand may be anywhere, because it moves faster than its fingers move in it. The rigid motion that most markers agree
on is found twice: with the hand's last shape, and with fingers that keep their velocity. Markers that are too far from
both are judged. Two with exchanged positions are exchanged back. One that stays in place for `patience` s is accepted,
unless another marker is there. Others are dropped. The tolerance grows with the time for which a marker was hidden.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import isnan
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import ALIGNMENT, Glove, template
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.gap_fillers import missing
from bodysense.errors import BodysenseError
from bodysense.geometry.registration import register, to_world

_SAME_PLACE = 0.005  # m: two identifiers closer than this are one marker
_TRIPLES = np.array([np.isin(range(9), three) for three in combinations(range(9), 3)])  # (84, 9)


@dataclass(frozen=True)
class RejectionSettings:
    """Limits of accepted markers."""

    tolerance: float = 0.005  # m, distance from the prediction
    speed: float = 0.3  # m/s, growth of the tolerance with time
    haste: float = 1.0  # share of a marker's last step in the hand that is added to its tolerance
    patience: float = 0.015  # s for which an unexpected marker must stay in place to be accepted
    slack: float = 0.02  # m by which the distance of two markers may exceed the hand's largest one

    def __post_init__(self) -> None:
        for name in ("tolerance", "speed", "haste", "patience", "slack"):
            if not getattr(self, name) >= 0:
                raise BodysenseError(f"rejection: {name} is {getattr(self, name):g}; it must be 0 or more")


class RejectionState(NamedTuple):
    """The last two frames, and the doubted markers of the last one."""

    place: np.ndarray  # (H, 9, 3) m in the last frame; NaN before the first frame
    before: np.ndarray  # (H, 9, 3) m in the frame before it
    interval: float  # s between these two
    known: np.ndarray  # (H, 9) bool, in the last frame
    known_before: np.ndarray  # (H, 9) bool, in the frame before it
    doubted: np.ndarray  # (H, 9, 3) m, offset from the expected position; NaN for accepted markers
    since: np.ndarray  # (H, 9) s for which the marker has been doubted
    settled: tuple[bool, ...]  # (H) whether all markers were accepted


@dataclass(frozen=True, eq=False)
class Rejection:
    """Rejection of wrong markers of H left-model hands."""

    hands: Sequence[Skeleton]
    glove: Glove
    settings: RejectionSettings = RejectionSettings()

    def start(self) -> RejectionState:
        """Return the state without predictions."""
        shape = (len(self.hands), 9, 3)
        nothing, none = np.full(shape, np.nan), np.zeros(shape[:2])
        return RejectionState(nothing, nothing, 1.0, none > 0, none > 0, nothing, none, (False,) * len(self.hands))

    @cached_property
    def _farthest(self) -> np.ndarray:
        """(H, 9, 9) m: largest distance of two markers, along the bones between them."""
        return np.stack([_bone_distances(hand, self.glove) for hand in self.hands]) + self.settings.slack

    @cached_property
    def _nearest(self) -> np.ndarray:
        """(H, 9, 9) m: least distance of two markers; 0 except on the back of the hand."""
        nearest = np.zeros((len(self.hands), 9, 9))
        for place, hand in enumerate(self.hands):
            back = template(self.glove, hand)[list(ALIGNMENT)]
            apart = np.linalg.norm(back[:, None] - back, axis=-1)
            nearest[place][np.ix_(ALIGNMENT, ALIGNMENT)] = np.maximum(0.7 * apart - self.settings.slack, 0.0)
        return nearest

    def check(
        self, markers: np.ndarray, interval: float, hidden: np.ndarray, state: RejectionState
    ) -> tuple[np.ndarray, RejectionState]:
        """Replace wrong markers of (H, 9, 3) m by NaN and correct exchanged identifiers; return markers and state.

        Hidden markers are NaN. `hidden` (H, 9) s is the time for which each was hidden in the last frame. Call
        `remember` with the completed frame before the next `check`.
        """
        expected = state.place + (state.place - state.before) * (interval / state.interval)
        limit = 0.577 * (self.settings.tolerance + self.settings.speed * interval)
        far = np.abs(markers - expected) > limit  # NaN compares false
        if not far.any() and False not in state.settled:
            return markers, state
        known = ~missing(markers)
        # A marker that was filled in one of the last two frames has no reliable velocity.
        moving = np.where((state.known & state.known_before)[..., None], expected, np.nan)
        shapes = np.stack([state.place, moving], axis=1)
        markers, doubted, since = markers.copy(), np.full_like(state.doubted, np.nan), np.zeros_like(state.since)
        for hand, settled in enumerate(state.settled):
            if not settled or far[hand].any():
                markers[hand], doubted[hand], since[hand] = self._judge(
                    hand, markers[hand], known[hand], shapes[hand], hidden[hand] + interval, interval, state
                )
        settled = tuple(not doubt.any() for doubt in since)
        return markers, state._replace(doubted=doubted, since=since, settled=settled)

    def remember(
        self, markers: np.ndarray, known: np.ndarray, interval: float, state: RejectionState
    ) -> RejectionState:
        """Return the state after a frame with markers (H, 9, 3) m, which are filled unless `known` (H, 9)."""
        before = markers if isnan(state.place.item(0)) else state.place
        return RejectionState(markers, before, interval, known, state.known, state.doubted, state.since, state.settled)

    def _judge(
        self,
        hand: int,
        markers: np.ndarray,
        known: np.ndarray,
        shapes: np.ndarray,
        unseen: np.ndarray,
        interval: float,
        state: RejectionState,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Judge the markers (9, 3) of one hand by two expected shapes (2, 9, 3).

        Returns the accepted markers (9, 3), the offsets of doubted ones (9, 3) and their times of doubt (9,) s.
        """
        settings = self.settings
        markers, since, wrong = np.where(known[:, None], markers, np.nan), np.zeros(9), np.zeros(9, dtype=bool)
        held = ~np.isnan(shapes[0, :, 0])
        tolerance = settings.tolerance + settings.speed * (unseen - state.since[hand])  # doubt does not widen it
        sure = known & held
        if sure.sum() >= 4:
            shapes = _align(shapes, markers, sure, tolerance)
            step = np.linalg.norm(shapes[1] - shapes[0], axis=-1)
            tolerance = tolerance + settings.haste * np.where(np.isnan(step), 0.0, step)
            outside = sure & ~(np.linalg.norm(markers - shapes, axis=-1) < tolerance).any(axis=0)
            if 2 * outside.sum() <= sure.sum():  # otherwise the prediction of the hand is wrong
                wrong = outside
        expected = np.where(np.isnan(shapes[1]), shapes[0], shapes[1])
        wrong = self._exchange(markers, wrong, expected, tolerance)
        wrong = wrong | self._impossible(hand, np.where(wrong[:, None], np.nan, markers), expected)
        doubted = np.where(wrong[:, None], markers - np.where(held[:, None], expected, 0.0), np.nan)
        displacement = np.linalg.norm(doubted - state.doubted[hand], axis=-1)
        stays = wrong & (displacement < tolerance)
        since[wrong] = np.where(stays, state.since[hand] + interval, 1e-9)[wrong]
        for marker in np.flatnonzero(stays & (since >= settings.patience)):
            trial = np.where(wrong[:, None], np.nan, markers)
            others = np.linalg.norm(trial - markers[marker], axis=-1)
            trial[marker] = markers[marker]
            if not (others < _SAME_PLACE).any() and not self._violations(hand, trial)[marker]:
                wrong[marker], doubted[marker], since[marker] = False, np.nan, 0.0
        return np.where(wrong[:, None], np.nan, markers), doubted, since

    def _violations(self, hand: int, markers: np.ndarray) -> np.ndarray:
        """Return (9,) for each marker the number of others at an impossible distance."""
        apart = np.linalg.norm(markers[:, None] - markers, axis=-1)
        return ((apart > self._farthest[hand]) | (apart < self._nearest[hand])).sum(axis=1)

    def _impossible(self, hand: int, markers: np.ndarray, expected: np.ndarray) -> np.ndarray:
        """Return the mask (9,) of markers that are impossible for a hand of this size.

        The marker with the most impossible distances is removed until the others are possible.
        """
        trial, wrong = markers.copy(), np.zeros(9, dtype=bool)
        while (count := self._violations(hand, trial)).any():
            worst = np.flatnonzero(count == count.max())
            apart = np.nan_to_num(np.linalg.norm(markers - expected, axis=-1))
            marker = worst[np.argmax(apart[worst])]
            trial[marker], wrong[marker] = np.nan, True
        return wrong

    def _exchange(
        self, markers: np.ndarray, wrong: np.ndarray, expected: np.ndarray, tolerance: np.ndarray
    ) -> np.ndarray:
        """Exchange wrong markers that have each other's positions, in place; return the mask (9,) of others."""
        rows = np.flatnonzero(wrong)
        if len(rows) < 2:
            return wrong
        apart = np.linalg.norm(markers[rows][:, None] - expected[rows], axis=-1)  # measured × expected
        origin = np.argmin(apart, axis=0)  # for every wrong marker the measurement closest to its expected position
        fits = apart[origin, np.arange(len(rows))] < tolerance[rows]
        fits &= np.bincount(origin, minlength=len(rows))[origin] == 1
        found = markers[rows[origin[fits]]]
        markers[rows[fits]] = found
        still = wrong.copy()
        still[rows[fits]] = False
        return still


def _align(expected: np.ndarray, markers: np.ndarray, sure: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """Move expected positions (2, 9, 3) by the rigid motion that most of the reliable markers (9,) agree on."""
    lacking = np.isnan(expected[..., 0])
    origin = markers[sure.argmax()]  # differences from it are small, for precision
    source = np.where(lacking[..., None], 0.0, expected - origin)
    target = np.where(sure[:, None], markers - origin, 0.0)
    sure = sure & ~lacking  # (2, 9)
    aligned = []
    for shape, usable in zip(source, sure, strict=True):
        if usable.sum() < 3:
            aligned.append(np.full_like(shape, np.nan))
            continue
        threes = _TRIPLES[~(_TRIPLES & ~usable).any(axis=1)]
        tried, wanted = (np.broadcast_to(points, (len(threes), 9, 3)) for points in (shape, target))
        apart = np.linalg.norm(to_world(tried, *register(tried, wanted, threes)) - target, axis=-1)
        near = usable & (apart < tolerance)
        score = np.where(near, 1 - apart / (9 * tolerance), 0.0).sum(axis=1)  # most markers, then the closest ones
        best = near[score.argmax()]
        best = best if best.any() else usable
        aligned.append(to_world(shape[None], *register(shape, target[None], best[None]))[0] + origin)
    return np.where(lacking[..., None], np.nan, np.stack(aligned))


def _bone_distances(hand: Skeleton, glove: Glove) -> np.ndarray:
    """Return the distances (9, 9) m of two markers along the bones between their joints, and out to the markers."""
    points = hand.indices(glove.points)
    joints = hand.indices(glove.carried_by)
    length = hand.bone_length
    back = hand.index("wrist")
    out = np.linalg.norm(glove.offset_on(hand), axis=1)
    distances = np.zeros((9, 9))
    on_back = joints == back
    flat = template(glove, hand)
    for a, b in combinations(range(9), 2):
        if on_back[a] and on_back[b]:
            distances[a, b] = distances[b, a] = 1.15 * np.linalg.norm(flat[a] - flat[b])
            continue
        one, other = hand.path[points[a]], hand.path[points[b]]
        along = float((np.abs(one - other) * length).sum())
        distances[a, b] = distances[b, a] = along + out[a] + out[b]
    return distances
