"""Labels for passive markers: which of the cameras' points is which marker of which glove.

Points have no names, come in any order, and some belong to no glove. While a hand is followed, every marker is expected
where its motion and its hand carry it, within the range of the hand's shape; points are assigned at the least total
cost. An assignment that has long fitted a hand better replaces the current one. A hand that is not followed is
searched: three points that form the triangle on the back of a hand propose it, and the one with matching other
markers is taken. This starts a recording, and repairs it after occlusion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bodysense.body.glove import ALIGNMENT, MARKERS, default_glove, glove_points, side_of, template
from bodysense.body.hand import mirrored_vectors
from bodysense.body.hand_shapes import marker_ranges
from bodysense.body.registration import brought_back, moved, register
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.assignment import assigned_or_none, cost_of
from bodysense.devices.gloves.hand_search import SIDES, FoundHand, find_hands, surest, unlikeness
from bodysense.io.markers.raw_markers import points_alone
from bodysense.observation import Observation, check_order

_COUNT = len(MARKERS)
_BACK = list(ALIGNMENT)
_UNKNOWN = np.full((_COUNT, 3), np.nan)  # velocities of a hand that was just found
_FIRMNESS = 8  # weight of a marker on the back of the hand in its registration, compared with one of a finger
_NEAR = 0.015  # m, largest distance of a marker from its expected position
_ACCELERATION = 40.0  # m/s² of a hand: growth of that distance in a frame
_DRIFT = 0.3  # m/s, growth of that distance while a marker is hidden
_FARTHEST = 0.05  # m, upper bound of that distance
_SHAPE = 0.035  # m, largest distance of a finger's marker from the range of the hand's shape
_BACK_LIMIT = 0.02  # m, the same limit for one on the back of the hand or at the middle of the thumb
_SHAPE_SHARE = 0.3  # weight of that distance compared with the one from the expected position
_NO_HAND = 0.4  # mean of these distances, squared and as a share of the limits, above which it is not a hand
_BETTER = 0.8  # of the cost of the current labels: below this another assignment is better
_PATIENCE = 0.1  # s for which it must be better, and for which a hand with few markers is still followed
_FEWEST = 6  # markers needed to find a hand
_AGAIN = 5  # markers needed if the size of the hands is known
_FOLLOWED = 3  # markers needed to follow a hand
_STIFFNESS = 0.008  # m, largest difference between sides of the triangle on the back and the template's
_SIZES = (0.8, 1.25)  # of the given hand: range of searched sizes
_SAME_SIZE = 0.05  # share: range of searched sizes once one hand is known
_PROVEN = 0.2  # s of following after which the size of a hand is known
_MARGIN = 0.5  # markers that another hand must cost more: points that fit two hands equally are neither
_WORST = 0.12  # largest mean of the distances, squared and as a share of the limits, of a found hand
_KEPT = 1.0  # in markers: by this much another hand must cost less than a followed one
_CHECK = 0.1  # s between comparisons of followed hands with others
_HALF_LIFE = 0.008  # s in which the velocity of a marker adapts by half


class HandTrack(NamedTuple):
    """One hand at its last sighting, in its own mirrored world."""

    size: float  # as a factor of the given hand; 0 while the hand is not followed
    place: np.ndarray  # (9, 3) m, seen or predicted positions of markers
    velocity: np.ndarray  # (9, 3) m/s
    hidden: np.ndarray  # (9,) s for which each was hidden
    weak: float  # s with too few or badly fitting markers
    age: float = 0.0  # s for which it has been followed
    usual: float = 0.0  # its size after long following; 0 if never


class LabelState(NamedTuple):
    """State for the next frame."""

    time: float | None
    hands: tuple[HandTrack, ...]
    doubt: float  # s for which another assignment has fitted better
    checked: float  # s, time of the last comparison of followed hands with others


@dataclass(frozen=True, eq=False)
class Labeller:
    """Finder of gloves' markers among unnamed points. `hands` gives every hand's skeleton as a left hand.

    State is an argument, as for estimators: `step` takes the next frames.
    """

    hands: Mapping[str, Skeleton]

    @cached_property
    def points(self) -> tuple[str, ...]:
        """Names of all markers."""
        return tuple(name for hand in self.hands for name in glove_points(hand))

    @cached_property
    def _ranges(self) -> list[np.ndarray]:
        """(9, K, 3) m for every hand: possible positions of markers."""
        return [marker_ranges(hand) for hand in self.hands.values()]

    @cached_property
    def _templates(self) -> list[np.ndarray]:
        """(9, 3) m for every hand."""
        return [template(default_glove(), hand) for hand in self.hands.values()]

    @cached_property
    def _flips(self) -> np.ndarray:
        """(H, 3)."""
        return np.stack([mirrored_vectors(np.ones(3), side_of(hand)) for hand in self.hands])

    def start(self) -> LabelState:
        """Return the state without any followed hand."""
        return LabelState(None, tuple(_nowhere() for _ in self.hands), 0.0, -np.inf)

    def step(self, observation: Observation, state: LabelState) -> tuple[Observation, LabelState]:
        """Label T frames of points, ignoring their names: return the markers of all gloves, by name.

        Raises BodysenseError when time does not increase.
        """
        placed = np.full((len(observation), len(self.points), 3), np.nan)
        for t, now in enumerate(np.asarray(observation.time, dtype=float).tolist()):
            points = observation.position[t, np.flatnonzero(observation.has_position[t])]
            labels, state = self.label(points, now, state)
            placed[t, labels[labels >= 0]] = points[labels >= 0]
        return points_alone(self.points, placed, observation.time), state

    def label(self, points: np.ndarray, now: float, state: LabelState) -> tuple[np.ndarray, LabelState]:
        """Return labels (N,) of the points (N, 3) m of one frame: indices in `points`, −1 for other points."""
        check_order(now, state.time, "labelling")
        interval = 0.0 if state.time is None else now - state.time
        expected = [_carried_on(hand, interval) for hand in state.hands]
        labels, doubt = self._followed(points, expected, interval, state.doubt)
        hands = [self._taken(k, points, labels, hand, interval) for k, hand in enumerate(expected)]
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
        self._look_for(doubtful, set(range(len(hands))) if check else doubtful, points, labels, hands)
        after = [
            _with_velocity(hand, before, interval) if hand.velocity is _UNKNOWN else hand
            for hand, before in zip(hands, state.hands, strict=True)
        ]
        return labels, LabelState(now, tuple(after), doubt, now if check else state.checked)

    def _followed(
        self, points: np.ndarray, expected: list[HandTrack], interval: float, doubt: float
    ) -> tuple[np.ndarray, float]:
        """Return labels (N,) of points as markers of the followed hands, and for how long they have been doubtful."""
        labels = np.full(len(points), -1)
        rows = [k for k, hand in enumerate(expected) if hand.size]
        if not rows or not len(points):
            return labels, 0.0
        names = np.concatenate([k * _COUNT + np.arange(_COUNT) for k in rows])
        shape = np.minimum(np.concatenate([self._unlike(k, points, expected[k]) for k in rows]), 1.0)
        place = np.concatenate([expected[k].place * self._flips[k] for k in rows])
        hidden = np.concatenate([expected[k].hidden for k in rows])
        near = _NEAR + _ACCELERATION * interval**2 / 2
        near = np.minimum(near + _DRIFT * np.maximum(hidden - interval, 0), _FARTHEST)
        apart = ((place[:, None] - points) ** 2).sum(axis=-1) / near[:, None] ** 2
        # A marker is expected within some distance; a farther point costs more than leaving it unassigned. A hidden
        # marker must also fit the hand's shape to be found again.
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

    def _unlike(self, k: int, points: np.ndarray, hand: HandTrack) -> np.ndarray:
        """Return (9, N) distances of points from possible positions of each marker: squared, 1 is the limit."""
        known = np.ones((1, len(_BACK)), dtype=bool)
        at = register(hand.size * self._templates[k][_BACK], hand.place[None, _BACK], known)
        local = brought_back((points * self._flips[k])[None], *at)[0] / hand.size
        return unlikeness(local, self._ranges[k], self._allowed)

    @cached_property
    def _allowed(self) -> np.ndarray:
        """(9, 1) m²: largest distance, squared, of markers from their possible positions."""
        allowed = np.full((_COUNT, 1), _SHAPE**2)
        allowed[[*_BACK, MARKERS.index("thumb_middle")]] = _BACK_LIMIT**2
        return allowed

    def _taken(self, k: int, points: np.ndarray, labels: np.ndarray, expected: HandTrack, interval: float) -> HandTrack:
        """Return a hand after labelling its points; labels of impossible points are removed."""
        if not expected.size:
            return expected
        place, seen = self._seen(k, points, labels)
        for marker in self._stray(k, place, seen, expected.size):
            seen[marker] = False
            labels[labels == k * _COUNT + marker] = -1
        enough = seen.sum() >= _FOLLOWED
        now = np.where(seen[:, None], place, expected.place)
        if enough and not seen.all():  # hidden markers follow the seen ones
            now = np.where(seen[:, None], place, _moved_along(expected.place, now, seen))
        hand = expected._replace(place=now)
        own = np.diagonal(self._unlike(k, now * self._flips[k], hand))
        good = enough and np.minimum(own[seen], 1.0).mean() < _NO_HAND
        weak = 0.0 if good else expected.weak + interval
        if weak > _PATIENCE:
            return _nowhere(expected.usual)
        velocity = expected.velocity
        if interval:
            share = 1 - 0.5 ** (interval / _HALF_LIFE)
            velocity = velocity + share * (now - expected.place) / interval
        age = expected.age + interval if good else expected.age
        hidden = np.where(seen, 0.0, expected.hidden)
        usual = expected.usual or expected.size * (age > _PROVEN)
        return HandTrack(expected.size, now, velocity, hidden, weak, age, usual)

    def _seen(self, k: int, points: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return markers (9, 3) of a hand, in its mirrored world, and which are seen."""
        place, mine = np.full((_COUNT, 3), np.nan), _of_hand(labels, k)
        place[labels[mine] - k * _COUNT] = points[mine] * self._flips[k]
        return place, np.asarray(np.isfinite(place[:, 0]))

    def _stray(self, k: int, place: np.ndarray, seen: np.ndarray, size: float) -> list[int]:
        """Return markers on the back of the hand in impossible positions: those with the most wrong distances."""
        wrong: dict[int, int] = dict.fromkeys(_BACK, 0)
        for one, other in ((_BACK[a], _BACK[b]) for a, b in SIDES):
            if seen[one] and seen[other]:
                usual = np.linalg.norm(self._templates[k][one] - self._templates[k][other]) * size
                if abs(np.linalg.norm(place[one] - place[other]) - usual) > 2 * _STIFFNESS:
                    wrong[one] += 1
                    wrong[other] += 1
        most = max(wrong.values())
        return [marker for marker, count in wrong.items() if most and count == most]

    def _look_for(
        self, doubtful: set[int], asked: set[int], points: np.ndarray, labels: np.ndarray, hands: list[HandTrack]
    ) -> None:
        """Label hands in `asked` by their shape alone, the surest first, if that changes the labels.

        A followed hand is one reading of its points among others, and is replaced by a better one. `labels`
        and `hands` are filled in place.
        """
        free = np.flatnonzero((labels < 0) | np.isin(labels // _COUNT, list(asked)))
        held = {k: self._held(k, points, labels, hands[k]) for k in asked if hands[k].size}
        readings = [*held.values(), *(found for k in asked for found in self._found(k, points, free, hands))]
        while readings and (sure := surest(readings, _MARGIN)) is not None:
            k, seen = sure.hand, sure.chosen >= 0
            before = held.pop(k, None)
            mended = k not in doubtful and (before is None or not sure.same_as(before))
            if k in doubtful or mended:
                known = hands[k]
                for other in list(held):
                    if len(np.intersect1d(held[other].points, sure.points)) > 2:
                        hands[other] = _nowhere(hands[other].usual)
                        labels[_of_hand(labels, other)] = -1
                        del held[other]
                labels[_of_hand(labels, k)] = -1
                labels[sure.points] = k * _COUNT + np.flatnonzero(seen)
                place = np.where(seen[:, None], (points * self._flips[k])[sure.chosen], sure.flat)
                hidden = np.where(seen, 0.0, 1.0)
                velocity = np.zeros((_COUNT, 3)) if mended else _UNKNOWN  # its motion is unknown
                hands[k] = HandTrack(sure.size, place, velocity, hidden, 0.0, known.age, known.usual)
            readings = [one for one in readings if one.hand != k and not len(np.intersect1d(one.points, sure.points))]

    def _held(self, k: int, points: np.ndarray, labels: np.ndarray, hand: HandTrack) -> FoundHand:
        """Return a followed hand as a reading, from its labels."""
        chosen, mine = np.full(_COUNT, -1), np.flatnonzero(_of_hand(labels, k))
        chosen[labels[mine] - k * _COUNT] = mine
        cost = cost_of(self._unlike(k, points, hand), chosen)
        cost -= _KEPT * (hand.weak == 0 and hand.age > _PROVEN)
        return FoundHand(k, cost, chosen, hand.size, hand.place)

    def _found(self, k: int, points: np.ndarray, free: np.ndarray, hands: list[HandTrack]) -> list[FoundHand]:
        """Return readings of the free points among points (N, 3) m, at the known size of the hands if any."""
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
    """Return a found hand that has moved rigidly from its last position, or is at rest if that is unknown."""
    if not before.size or not interval:
        return hand._replace(velocity=np.zeros((_COUNT, 3)))
    seen = hand.hidden <= 0
    return hand._replace(velocity=(hand.place - _moved_along(hand.place, before.place, seen)) / interval)


def _carried_on(hand: HandTrack, interval: float) -> HandTrack:
    """Predict a hand's markers for this frame: seen ones keep their velocity, others move with the hand."""
    if not hand.size or not interval:
        return hand
    seen = hand.hidden <= 0
    ahead = hand.place + hand.velocity * interval
    place = np.where(seen[:, None], ahead, _moved_along(hand.place, ahead, seen))
    return hand._replace(place=place, hidden=hand.hidden + interval)


def _moved_along(before: np.ndarray, now: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Move all markers (9, 3) rigidly with the seen ones, mainly those on the back of the hand."""
    rows = _BACK * _FIRMNESS + list(range(_COUNT))
    return moved(before[None], *register(before[rows], now[None, rows], seen[None, rows]))[0]


def _of_hand(labels: np.ndarray, k: int) -> np.ndarray:
    """Return (N,) whether points are labelled as markers of a hand."""
    return (labels >= k * _COUNT) & (labels < (k + 1) * _COUNT)


def _nowhere(usual: float = 0.0) -> HandTrack:
    zeros = np.zeros((_COUNT, 3))
    return HandTrack(0.0, zeros, zeros, np.full(_COUNT, np.inf), 0.0, 0.0, usual)
