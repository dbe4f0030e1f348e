"""Markers of gloves on synthesised hands, some of them hidden, for benchmarks of gloves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bodysense.body.hands.glove import default_glove, glove_points, marker_positions, side_of
from bodysense.body.hands.hand import hand_skeleton, mirrored_vectors
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.observing.observation import EXACT_ACCURACY, Observation, accuracy_like
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import RATE

_CHANGE_INTERVAL = 30  # frames after which other markers are hidden


def glove_stream(hands: Sequence[str], frames: int, hidden: int) -> tuple[dict[str, Skeleton], Observation]:
    """Return the skeletons of hands, and their markers at 60 Hz with `hidden` markers of each hand hidden."""
    rng, hand = np.random.default_rng(0), hand_skeleton(default_skeleton(), "left")
    rows = []
    for name in hands:
        pose = synthesize_hand(hand, (frames + 1) / RATE, rng).pose[:frames]
        markers = np.array(marker_positions(default_glove(), pose))
        for start in range(0, frames, _CHANGE_INTERVAL):
            markers[start : start + _CHANGE_INTERVAL, rng.permutation(markers.shape[1])[:hidden]] = np.nan
        rows.append(mirrored_vectors(markers, side_of(name)))
    points = tuple(point for name in hands for point in glove_points(name))
    return dict.fromkeys(hands, hand), observed_markers(points, np.concatenate(rows, axis=1))


def observed_markers(points: tuple[str, ...], position: np.ndarray) -> Observation:
    """Return an observation of exact markers (T, P, 3) m at 60 Hz; hidden markers are NaN."""
    seen = ~np.isnan(position[..., 0])
    return Observation(
        points=points,
        position=position,
        rotation=np.full((*seen.shape, 4), np.nan),
        has_position=seen,
        has_rotation=np.zeros_like(seen),
        accuracy=accuracy_like(seen, EXACT_ACCURACY),
        time=np.arange(1, len(position) + 1) / RATE,
    )
