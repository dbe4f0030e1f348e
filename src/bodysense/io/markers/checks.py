"""Plausibility of glove markers before tracking: unit, handedness and identifiers."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import NoReturn

import numpy as np

from bodysense.body.hands.glove import ALIGNMENT, MARKERS, default_glove, glove_points, side_of, template
from bodysense.body.hands.hand import glove_hands, hand_skeleton, mirrored_vectors
from bodysense.body.hands.hand_shapes import hand_shapes, marker_ranges, shape_distance
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.registration import register
from bodysense.io.markers.raw_markers import METRES, Unit
from bodysense.observing.observation import Observation
from bodysense.quality.plausible import mirror_fix

FRAMES = 40  # at most, spread over the recording, that are checked
FEWEST = 7  # markers in a frame, the three on the back of the hand among them
SPANS = (0.06, 0.5)  # m between the two markers of a hand that are farthest apart
SIZES = (0.6, 1.6)  # of our hand's size: range of a person's
MIRRORED = 0.7  # a hand is mirrored if its mirror image has less than this share of its error
SWAPPED = 0.97  # two markers are swapped if exchanging them leaves less than this share of the error

_FAR = 0.03  # m; beyond it a marker does not count for the size


@dataclass(frozen=True)
class GloveCheck:
    """The result of checking a recording's gloves."""

    sizes: dict[str, float]  # of each hand, as a factor of ours
    remarks: tuple[str, ...]  # one sentence for each doubt


def check_gloves(observation: Observation, place: str, unit: Unit = "m", *, left_handed: bool = False) -> GloveCheck:
    """Check every glove of a recording (T frames), which was read as being in `unit`s, with left-handed axes or not.

    A hand that is never seen well enough (`FEWEST`) is skipped with a remark. Raises BodysenseError, with the fix,
    for a hand of impossible size and for a hand that is mirrored.
    """
    sizes, remarks, mirrored = {}, [], []
    for hand in glove_hands(observation.points):
        if not any(point in observation.points for point in glove_points(hand)):
            _check_span(observation, hand, place, unit)
            continue
        seen = _good_frames(observation, hand)
        if not len(seen):
            remarks.append(
                f"the {hand} glove never shows {FEWEST} markers and the back of the hand at once: not checked"
            )
            continue
        _check_size(seen, hand, place, unit)
        # Handedness and names depend on shape alone, so scale the hand to ours by the markers on its back.
        markers = seen * (_side(_shapes()[0, list(ALIGNMENT)]) / _side(seen[:, list(ALIGNMENT)]))
        like = _likeness(markers)
        if _likeness(markers * [-1, 1, 1]) < MIRRORED * like:
            mirrored.append(hand)
            continue
        remarks += _swapped(markers, hand, like)
        sizes[hand] = _size(seen)
    if mirrored:
        raise BodysenseError(
            f"{place}: the {' and the '.join(mirrored)} glove looks like a hand only in a mirror: "
            f"{mirror_fix(left_handed)} (--names)"
        )
    return GloveCheck(sizes, tuple(remarks))


def _good_frames(observation: Observation, hand: str) -> np.ndarray:
    """Return frames (N, 9, 3) m that show enough of a glove, as a left hand's; NaN where missing."""
    names = glove_points(hand)
    markers = np.full((len(observation), len(MARKERS), 3), np.nan)
    for k, name in enumerate(names):
        if name in observation.points:
            point = observation.points.index(name)
            markers[:, k] = np.where(observation.has_position[:, point, None], observation.position[:, point], np.nan)
    known = np.asarray(np.isfinite(markers).all(axis=-1))
    good = np.flatnonzero(known[:, list(ALIGNMENT)].all(axis=1) & (known.sum(axis=1) >= FEWEST))
    some = good[np.unique(np.linspace(0, len(good) - 1, min(len(good), FRAMES)).astype(int))]
    return mirrored_vectors(markers[some], side_of(hand))


def _shapes() -> np.ndarray:
    return hand_shapes(hand_skeleton(default_skeleton(), "left"))


def _side(triangle: np.ndarray) -> float:
    """Return the mean side of triangles (..., 3, 3): the median of all."""
    return float(np.median(np.linalg.norm(triangle - np.roll(triangle, 1, axis=-2), axis=-1).mean(axis=-1)))


def _check_size(markers: np.ndarray, hand: str, place: str, declared: Unit) -> None:
    """Refuse a hand of impossible size."""
    apart, ours = _side(markers[:, list(ALIGNMENT)]), _side(_shapes()[0, list(ALIGNMENT)])
    if SIZES[0] <= apart / ours <= SIZES[1]:
        return
    text = (
        f"{place}: the three markers on the back of the {hand} hand are {apart:.3g} m apart; "
        f"on a hand it is about {ours:.2f} m"
    )
    _refuse_size(text, "see that the names are right (--names)", apart / ours, SIZES, declared)


def _check_span(observation: Observation, hand: str, place: str, declared: Unit) -> None:
    """Refuse a glove of another marker set with an impossible span."""
    here = [k for k, name in enumerate(observation.points) if name.startswith(f"{hand}_glove_")]
    frames = np.unique(np.linspace(0, len(observation) - 1, min(len(observation), FRAMES)).astype(int))
    seen = observation.position[frames][:, here]
    apart = np.linalg.norm(seen[:, :, None] - seen[:, None], axis=-1)
    if np.isnan(apart).all():
        return
    span = float(np.nanmax(apart))
    if SPANS[0] <= span <= SPANS[1]:
        return
    text = f"{place}: the markers of the {hand} glove are up to {span:.3g} m apart; on a hand it is about 0.2 m"
    _refuse_size(text, "see that the labels are right (--marker-set)", span, SPANS, declared)


def _refuse_size(text: str, names: str, size: float, limits: tuple[float, float], declared: Unit) -> NoReturn:
    """Raise BodysenseError for an impossible size; name the unit that would make it possible."""
    for unit, metres in METRES.items():
        if limits[0] <= size * metres / METRES[declared] <= limits[1]:
            raise BodysenseError(f"{text}: the numbers are {unit}, not {declared}; give --unit {unit}")
    raise BodysenseError(f"{text}: {names} and the unit (--unit)")


def _size(markers: np.ndarray) -> float:
    """Return a hand's size as a factor of ours: the size at which its markers are closest to a hand's."""
    hand = hand_skeleton(default_skeleton(), "left")
    ranges, back = marker_ranges(hand), list(ALIGNMENT)
    flat, known = template(default_glove(), hand)[back], np.ones((len(markers), len(back)), dtype=bool)
    sizes = np.arange(SIZES[0], SIZES[1], 0.02)
    far = []
    for size in sizes:
        rotation, translation = register(size * flat, markers[:, back], known)[:2]
        local = (markers - translation[:, None]) @ rotation / size
        squared = size**2 * ((local[:, :, None] - ranges) ** 2).sum(axis=-1).min(axis=-1)
        far.append(np.nanmean(np.minimum(squared, _FAR**2)))
    return float(sizes[int(np.argmin(far))])


def _likeness(markers: np.ndarray) -> float:
    """Return the error (m) between nine markers and a hand's, median of the frames."""
    return float(np.median(shape_distance(_shapes(), markers)))


def _swapped(markers: np.ndarray, hand: str, like: float) -> list[str]:
    """Return a remark on two markers whose names should be exchanged, if there are such."""
    best, pair = like * SWAPPED, None
    for a, b in combinations(range(len(MARKERS)), 2):
        order = np.arange(len(MARKERS))
        order[[a, b]] = b, a
        other = _likeness(markers[:, order])
        if other < best:
            best, pair = other, (MARKERS[a], MARKERS[b])
    if pair is None:
        return []
    return [
        f"the {hand} glove looks more like a hand with {pair[0]!r} and {pair[1]!r} exchanged "
        f"({100 * like:.1f} against {100 * best:.1f} cm): are they named right?"
    ]
