"""A glove among unnamed points: three of them form the triangle on the back of a hand, the others are where it says."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bodysense.body.glove import ALIGNMENT
from bodysense.body.registration import register
from bodysense.capture.assignment import assigned_or_none, cost_of

SIDES = ((0, 1), (1, 2), (0, 2))  # of the triangle on the back of the hand
_BACK = list(ALIGNMENT)
_TRIED = 8  # triangles, those whose hands look best, that are looked at in full


class FoundHand(NamedTuple):
    """A hand that was found."""

    cost: float  # of its labels: squared distances as shares of what is allowed, 1 for a marker that is hidden
    chosen: np.ndarray  # (9,) the point of each marker, −1 hidden
    size: float  # as a factor of the template's
    flat: np.ndarray  # (9, 3) m, where it would have its markers if it were flat


def find_hand(
    place: np.ndarray,
    template: np.ndarray,
    ranges: np.ndarray,
    allowed: np.ndarray,
    stiffness: float,
    sizes: tuple[float, float],
    fewest: int,
) -> FoundHand | None:
    """The likeliest left hand among points (N, 3) m; None where there is none.

    Args:
        place: (N, 3) m, points.
        template: (9, 3) m, markers of a flat hand.
        ranges: (9, K, 3) m, where the hand can have its markers (`hand_shapes.marker_ranges`).
        allowed: (9, 1) m², how far, squared, markers may be from there.
        stiffness: m by which the sides of the triangle on the back of the hand may differ from the template's.
        sizes: smallest and largest factor of the template.
        fewest: markers that must be there; those on the back of the hand are always among them.
    """
    if len(place) < fewest:
        return None
    apart = np.linalg.norm(place[:, None] - place, axis=-1)
    side = [np.linalg.norm(template[_BACK[a]] - template[_BACK[b]]) for a, b in SIDES]
    sides = np.stack(np.broadcast_arrays(apart[:, :, None], apart[None], apart[:, None]))  # (3, N, N, N)
    factor = sides.sum(axis=0) / sum(side)
    off = np.abs(sides - factor * np.array(side)[:, None, None, None]).max(axis=0)
    triples = np.argwhere((off < stiffness) & (factor > sizes[0]) & (factor < sizes[1]))
    if not len(triples):
        return None
    size = factor[tuple(triples.T)]
    backs = size[:, None, None] * template[_BACK]
    rotation, translation = register(backs, place[triples], np.ones(backs.shape[:2], dtype=bool))[:2]
    local = (place - translation[:, None]) @ rotation / size[:, None, None]  # (K, N, 3)
    unlike = np.stack([((local[:, :, None] - where) ** 2).sum(axis=-1).min(axis=-1) for where in ranges], axis=1)
    unlike /= allowed  # (K, 9, N)
    best = None
    for triple in np.argsort(np.minimum(unlike.min(axis=-1), 1.0).sum(axis=-1))[:_TRIED]:
        chosen = assigned_or_none(np.where(unlike[triple] < 1, unlike[triple], np.inf))
        seen, cost = chosen >= 0, cost_of(unlike[triple], chosen)
        if seen.sum() >= fewest and seen[_BACK].all() and (best is None or cost < best.cost):
            flat = size[triple] * template @ rotation[triple].T + translation[triple]
            best = FoundHand(cost, chosen, float(size[triple]), flat)
    return best
