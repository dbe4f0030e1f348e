"""Labels for passive markers: which of the cameras' points is which marker of which glove.

Points have no names, come in any order, and some belong to no glove. While a hand is followed, the position of every
marker is predicted from its motion and its hand, and limited to the range of the hand's shape. Points are assigned at
the least total cost. Another assignment replaces the current one after it has fitted better for some time. A hand that
is not followed is searched for: every three points that form the triangle on the back of a hand propose a hand, and the
one whose other markers match best is chosen. This starts a recording and repairs labels after occlusion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import ALIGNMENT, MARKERS, default_glove, glove_points, side_of, template
from bodysense.body.hands.hand import mirrored_vectors
from bodysense.body.hands.hand_shapes import marker_ranges
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.labels.assignment import assigned_or_none, cost_of
from bodysense.devices.gloves.labels.hand_search import SIDES, HandReading, find_hands, most_certain, range_distances
from bodysense.geometry.registration import register, to_hand, to_world
from bodysense.io.markers.raw_markers import points_alone
from bodysense.observing.checks import check_order
from bodysense.observing.observation import Observation

_COUNT = len(MARKERS)
_BACK = list(ALIGNMENT)
_UNKNOWN = np.full((_COUNT, 3), np.nan)  # velocities of a hand that was just found
_FIRMNESS = 8  # weight of a marker on the back of the hand in its registration, compared with one of a finger
_NEAR = 0.015  # m, largest distance of a marker from its expected position
_ACCELERATION = 40.0  # m/s², acceleration of a hand, by which this limit grows in a frame
_DRIFT = 0.3  # m/s, growth of this limit while a marker is hidden
_FARTHEST = 0.05  # m, upper bound of this limit
_SHAPE = 0.035  # m, largest distance of a finger's marker from its range in the hand
_BACK_LIMIT = 0.02  # m, the same for a marker on the back of the hand or at the middle of the thumb
_SHAPE_SHARE = 0.3  # weight of the distance from the range, 1 − this is that of the distance from the expected position
_NO_HAND = 0.4  # mean squared distance, as a share of the limits, above which markers are no hand
_BETTER = 0.8  # share of the cost of the current labels below which another assignment is better
_PATIENCE = 0.1  # s for which another assignment must be better, and for which a hand with few markers is followed
_FEWEST = 6  # markers needed to find a hand
_AGAIN = 5  # markers needed if the size of the hands is known
_FOLLOWED = 3  # markers needed to follow a hand
_STIFFNESS = 0.008  # m, largest difference between sides of the triangle on the back and the template's
_SIZES = (0.8, 1.25)  # range of searched sizes, as factors of the given hand's
_SAME_SIZE = 0.05  # share by which sizes of other hands may differ once one hand is known
_PROVEN = 0.2  # s of following after which the size of a hand is known
_MARGIN = 0.5  # cost, in markers, by which a hand must be better than others: points that fit two equally are neither
_WORST = 0.12  # largest mean squared distance, as a share of the limits, of a found hand
_KEPT = 1.0  # cost, in markers, by which another hand must be better than a followed one
_CHECK = 0.1  # s between comparisons of followed hands with others
_HALF_LIFE = 0.008  # s, half-life of the error of a marker's velocity


class HandTrack(NamedTuple):
    """One followed hand at its last sighting, in its own mirrored world."""

    size: float  # as a factor of the given hand; 0 while the hand is not followed
    place: np.ndarray  # (9, 3) m, seen or predicted positions of markers
    velocity: np.ndarray  # (9, 3) m/s
    hidden: np.ndarray  # (9,) s for which each marker has been hidden
    weak: float  # s with too few or badly fitting markers
    age: float = 0.0  # s for which the hand has been followed
    usual: float = 0.0  # size after long following; 0 before that


class LabelState(NamedTuple):
    """State for the next frame."""

    time: float | None
    hands: tuple[HandTrack, ...]
    doubt: float  # s for which another assignment has fitted better
    checked: float  # s, time of the last comparison of followed hands with others


@dataclass(frozen=True, eq=False)
class Labeller:
    """Finder of gloves' markers among unnamed points. `hands` maps names of hands to their skeletons as left hands.

    Immutable; state is an argument.
    """

    hands: Mapping[str, Skeleton]

    @cached_property
    def points(self) -> tuple[str, ...]:
        """Names of all markers."""
        return tuple(name for hand in self.hands for name in glove_points(hand))

    @cached_property
    def _ranges(self) -> list[np.ndarray]:
        """For every hand, possible positions (9, K, 3) m of its markers."""
        return [marker_ranges(hand) for hand in self.hands.values()]

    @cached_property
    def _templates(self) -> list[np.ndarray]:
        """For every hand, markers (9, 3) m of the flat hand."""
        return [template(default_glove(), hand) for hand in self.hands.values()]

    @cached_property
    def _flips(self) -> np.ndarray:
        """(H, 3) factors from the world to each hand's mirrored world."""
        return np.stack([mirrored_vectors(np.ones(3), side_of(hand)) for hand in self.hands])

    def start(self) -> LabelState:
        """Return the initial state: no hand is followed."""
        return LabelState(None, tuple(_not_followed() for _ in self.hands), 0.0, -np.inf)

    def step(self, observation: Observation, state: LabelState) -> tuple[Observation, LabelState]:
        """Label T frames of points, ignoring their names; return the markers of all gloves by name, and the state.

        Raises BodysenseError if time does not increase.
        """
        position = np.full((len(observation), len(self.points), 3), np.nan)
        for t, now in enumerate(np.asarray(observation.time, dtype=float).tolist()):
            points = observation.position[t, np.flatnonzero(observation.has_position[t])]
            labels, state = self.label(points, now, state)
            position[t, labels[labels >= 0]] = points[labels >= 0]
        return points_alone(self.points, position, observation.time), state

    def label(self, points: np.ndarray, now: float, state: LabelState) -> tuple[np.ndarray, LabelState]:
        """Return labels (N,) of the points (N, 3) m of one frame, and the state.

        Labels are indices in `self.points`, −1 for points of no glove.
        """
        check_order(now, state.time, "labelling")
        interval = 0.0 if state.time is None else now - state.time
        expected = [_predict(hand, interval) for hand in state.hands]
        labels, doubt = self._label_followed(points, expected, interval, state.doubt)
        hands = [self._update(k, points, labels, hand, interval) for k, hand in enumerate(expected)]
        for k, hand in enumerate(hands):
            if not hand.size:
                labels[_of_hand(labels, k)] = -1
        # Search a hand that was just found once more, because its motion is not known yet.
        doubtful = {
            k
            for k, (hand, before) in enumerate(zip(hands, state.hands, strict=True))
            if not hand.size or hand.weak > 0 or not before.velocity.any()
        }
        check = now - state.checked >= _CHECK
        self._search(doubtful, set(range(len(hands))) if check else doubtful, points, labels, hands)
        after = [
            _with_velocity(hand, before, interval) if hand.velocity is _UNKNOWN else hand
            for hand, before in zip(hands, state.hands, strict=True)
        ]
        return labels, LabelState(now, tuple(after), doubt, now if check else state.checked)

    def _label_followed(
        self, points: np.ndarray, expected: list[HandTrack], interval: float, doubt: float
    ) -> tuple[np.ndarray, float]:
        """Return labels (N,) of points as markers of the followed hands, and the time (s) of doubt about them."""
        labels = np.full(len(points), -1)
        rows = [k for k, hand in enumerate(expected) if hand.size]
        if not rows or not len(points):
            return labels, 0.0
        names = np.concatenate([k * _COUNT + np.arange(_COUNT) for k in rows])
        shape = np.minimum(np.concatenate([self._range_distances(k, points, expected[k]) for k in rows]), 1.0)
        place = np.concatenate([expected[k].place * self._flips[k] for k in rows])
        hidden = np.concatenate([expected[k].hidden for k in rows])
        near = _NEAR + _ACCELERATION * interval**2 / 2
        near = np.minimum(near + _DRIFT * np.maximum(hidden - interval, 0), _FARTHEST)
        apart = ((place[:, None] - points) ** 2).sum(axis=-1) / near[:, None] ** 2
        # Points outside a marker's limit cost more than leaving it unassigned. A hidden marker that is found again must
        # also fit the hand's shape.
        share, found_again = _SHAPE_SHARE, (hidden > 1.5 * interval)[:, None]
        possible = (apart < 1) & ((shape < 1) | ~found_again)
        chosen = assigned_or_none(np.where(possible, (1 - share) * apart + share * shape, np.inf))
        alone = assigned_or_none(np.where(shape < 1, shape, np.inf))
        if cost_of(shape, alone) < _BETTER * cost_of(shape, chosen):
            doubt += interval
            if doubt > _PATIENCE:
                chosen, doubt = alone, 0.0
        else:
            doubt = 0.0
        labels[chosen[chosen >= 0]] = names[chosen >= 0]
        return labels, doubt

    def _range_distances(self, k: int, points: np.ndarray, hand: HandTrack) -> np.ndarray:
        """Return squared distances (9, N) of points from the range of each marker, as a share of its limit."""
        known = np.ones((1, len(_BACK)), dtype=bool)
        at = register(hand.size * self._templates[k][_BACK], hand.place[None, _BACK], known)
        local = to_hand((points * self._flips[k])[None], *at)[0] / hand.size
        return range_distances(local, self._ranges[k], self._allowed)

    @cached_property
    def _allowed(self) -> np.ndarray:
        """(9, 1) m²: largest squared distance of markers from their ranges."""
        allowed = np.full((_COUNT, 1), _SHAPE**2)
        allowed[[*_BACK, MARKERS.index("thumb_middle")]] = _BACK_LIMIT**2
        return allowed

    def _update(
        self, k: int, points: np.ndarray, labels: np.ndarray, expected: HandTrack, interval: float
    ) -> HandTrack:
        """Return a hand after its points were labelled; remove labels of impossible points in place."""
        if not expected.size:
            return expected
        place, mine = np.full((_COUNT, 3), np.nan), _of_hand(labels, k)  # m, in the hand's mirrored world
        place[labels[mine] - k * _COUNT] = points[mine] * self._flips[k]
        seen = np.asarray(np.isfinite(place[:, 0]))
        for marker in self._misplaced_on_back(k, place, seen, expected.size):
            seen[marker] = False
            labels[labels == k * _COUNT + marker] = -1
        enough = seen.sum() >= _FOLLOWED
        now = np.where(seen[:, None], place, expected.place)
        if enough and not seen.all():  # hidden markers move with the seen ones
            now = np.where(seen[:, None], place, _move_rigidly(expected.place, now, seen))
        hand = expected._replace(place=now)
        own = np.diagonal(self._range_distances(k, now * self._flips[k], hand))
        good = enough and np.minimum(own[seen], 1.0).mean() < _NO_HAND
        weak = 0.0 if good else expected.weak + interval
        if weak > _PATIENCE:
            return _not_followed(expected.usual)
        velocity = expected.velocity
        if interval:
            share = 1 - 0.5 ** (interval / _HALF_LIFE)
            velocity = velocity + share * (now - expected.place) / interval
        age = expected.age + interval if good else expected.age
        hidden = np.where(seen, 0.0, expected.hidden)
        usual = expected.usual or expected.size * (age > _PROVEN)
        return HandTrack(expected.size, now, velocity, hidden, weak, age, usual)

    def _misplaced_on_back(self, k: int, place: np.ndarray, seen: np.ndarray, size: float) -> list[int]:
        """Return the markers on the back of the hand with the most impossible distances to the others there."""
        wrong: dict[int, int] = dict.fromkeys(_BACK, 0)
        for one, other in ((_BACK[a], _BACK[b]) for a, b in SIDES):
            if seen[one] and seen[other]:
                usual = np.linalg.norm(self._templates[k][one] - self._templates[k][other]) * size
                if abs(np.linalg.norm(place[one] - place[other]) - usual) > 2 * _STIFFNESS:
                    wrong[one] += 1
                    wrong[other] += 1
        most = max(wrong.values())
        return [marker for marker, count in wrong.items() if most and count == most]

    def _search(
        self, doubtful: set[int], searched: set[int], points: np.ndarray, labels: np.ndarray, hands: list[HandTrack]
    ) -> None:
        """Label hands in `searched` by their shape alone, the most certain first, in place in `labels` and `hands`.

        Hands in `doubtful` are always labelled anew. Others keep their labels unless another reading of their points
        is better.
        """
        free = np.flatnonzero((labels < 0) | np.isin(labels // _COUNT, list(searched)))
        held = {k: self._held_reading(k, points, labels, hands[k]) for k in searched if hands[k].size}
        readings = [*held.values(), *(found for k in searched for found in self._find_readings(k, points, free, hands))]
        while readings and (sure := most_certain(readings, _MARGIN)) is not None:
            k, seen = sure.hand, sure.chosen >= 0
            before = held.pop(k, None)
            is_corrected = k not in doubtful and (before is None or not sure.same_as(before))
            if k in doubtful or is_corrected:
                known = hands[k]
                for other in list(held):
                    if len(np.intersect1d(held[other].points, sure.points)) > 2:
                        hands[other] = _not_followed(hands[other].usual)
                        labels[_of_hand(labels, other)] = -1
                        del held[other]
                labels[_of_hand(labels, k)] = -1
                labels[sure.points] = k * _COUNT + np.flatnonzero(seen)
                place = np.where(seen[:, None], (points * self._flips[k])[sure.chosen], sure.flat)
                hidden = np.where(seen, 0.0, 1.0)
                velocity = np.zeros((_COUNT, 3)) if is_corrected else _UNKNOWN
                hands[k] = HandTrack(sure.size, place, velocity, hidden, 0.0, known.age, known.usual)
            readings = [one for one in readings if one.hand != k and not len(np.intersect1d(one.points, sure.points))]

    def _held_reading(self, k: int, points: np.ndarray, labels: np.ndarray, hand: HandTrack) -> HandReading:
        """Return a followed hand as a reading, from its labels."""
        chosen, mine = np.full(_COUNT, -1), np.flatnonzero(_of_hand(labels, k))
        chosen[labels[mine] - k * _COUNT] = mine
        cost = cost_of(self._range_distances(k, points, hand), chosen)
        cost -= _KEPT * (hand.weak == 0 and hand.age > _PROVEN)
        return HandReading(k, cost, chosen, hand.size, hand.place)

    def _find_readings(self, k: int, points: np.ndarray, free: np.ndarray, hands: list[HandTrack]) -> list[HandReading]:
        """Return readings of the free points among points (N, 3) m, at the size of the hands if it is known."""
        known = [hand.usual for hand in hands if hand.usual] or [hand.size for hand in hands if hand.size]
        sizes, fewest = _SIZES, _FEWEST
        if known:
            size = float(np.mean(known))
            sizes, fewest = (size * (1 - _SAME_SIZE), size * (1 + _SAME_SIZE)), _AGAIN
        found = find_hands(
            k,
            points[free] * self._flips[k],
            self._templates[k],
            self._ranges[k],
            self._allowed,
            _STIFFNESS,
            sizes,
            fewest,
            _WORST,
            bool(known),
        )
        return [one._replace(chosen=np.where(one.chosen >= 0, free[one.chosen], -1)) for one in found]


def _with_velocity(hand: HandTrack, before: HandTrack, interval: float) -> HandTrack:
    """Return a found hand with the velocity of a rigid motion from its last position; 0 if that is unknown."""
    if not before.size or not interval:
        return hand._replace(velocity=np.zeros((_COUNT, 3)))
    seen = hand.hidden <= 0
    return hand._replace(velocity=(hand.place - _move_rigidly(hand.place, before.place, seen)) / interval)


def _predict(hand: HandTrack, interval: float) -> HandTrack:
    """Predict a hand's markers `interval` s later: seen ones keep their velocity, others move with the hand."""
    if not hand.size or not interval:
        return hand
    seen = hand.hidden <= 0
    ahead = hand.place + hand.velocity * interval
    place = np.where(seen[:, None], ahead, _move_rigidly(hand.place, ahead, seen))
    return hand._replace(place=place, hidden=hand.hidden + interval)


def _move_rigidly(before: np.ndarray, now: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Move all markers (9, 3) rigidly with the seen ones, mainly those on the back of the hand."""
    rows = _BACK * _FIRMNESS + list(range(_COUNT))
    return to_world(before[None], *register(before[rows], now[None, rows], seen[None, rows]))[0]


def _of_hand(labels: np.ndarray, k: int) -> np.ndarray:
    """Return (N,) whether points are labelled as markers of a hand."""
    return (labels >= k * _COUNT) & (labels < (k + 1) * _COUNT)


def _not_followed(usual: float = 0.0) -> HandTrack:
    zeros = np.zeros((_COUNT, 3))
    return HandTrack(0.0, zeros, zeros, np.full(_COUNT, np.inf), 0.0, 0.0, usual)
