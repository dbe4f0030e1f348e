"""Gaps of optical markers, filled from the body that wears them.

A marker moves with its segment. On each side of a gap, its segment is the markers and joints around it, weighted by how
rigidly they moved with it while it was seen; their rigid motion into the gap carries the marker. Both sides are
blended, so that positions are continuous at both edges. The velocity relative to the segment fades out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.geometry.gaps import coasting_weight, runs
from bodysense.geometry.rotation import smooth_step

COASTING = 0.3  # s in which a marker's velocity relative to its segment fades out in a gap
ALIKE = 0.06  # m; a marker that the body carries with a larger error is not worn on it
_AHEAD = 0.5  # s over which the carrying error is measured
_TRIALS = 40  # frames in which it is measured
_SAMPLES = 300  # frames from which the rigidity between points is estimated
_MARKER, _JOINT = 0.003, 0.02  # m: least errors of a marker and of an estimated joint, including skin motion
_ARM = 0.1  # m from a joint to the points that represent its rotation


@dataclass(frozen=True, eq=False)
class FilledMarkers:
    """Markers whose gaps are filled."""

    position: np.ndarray  # (T, M, 3) m, world; NaN where a marker is still missing
    filled: np.ndarray  # (T, M) bool


def fill_markers(
    position: np.ndarray, joint: np.ndarray, rotation: np.ndarray, error: np.ndarray, rate: float
) -> FilledMarkers:
    """Fill the gaps of markers.

    Args:
        position: (T, M, 3) m, world; NaN where a marker is missing.
        joint: (T, J, 3) m, world: joints of the completed body.
        rotation: (T, J, 3, 3) of these joints, world ← joint.
        error: (T, J) m, expected of the joints' positions.
        rate: Hz.
    """
    seen = np.asarray(np.isfinite(position).all(axis=-1))
    whole, filled = position.copy(), np.zeros_like(seen)
    error = np.maximum(error, _JOINT)
    beside = joint[:, :, None] + _ARM * np.swapaxes(rotation, -1, -2)
    points = _Points(
        np.concatenate([position, joint, beside.reshape(len(joint), -1, 3)], axis=1),
        np.concatenate([np.full(seen.shape, _MARKER), error, np.repeat(error, 3, axis=1)], axis=1),
    )
    for marker in np.flatnonzero(~seen.all(axis=0)).tolist():
        known = np.flatnonzero(seen[:, marker])
        if not known.size:
            continue
        spread = _spread(points.place, marker, known)
        if not _is_on_body(points, spread, marker, known, rate):
            continue
        for first, end in runs(~seen[:, marker]):
            whole[first:end, marker] = _bridged(points, spread, marker, first, end, rate)
            filled[first:end, marker] = True
    return FilledMarkers(whole, filled)


@dataclass(frozen=True, eq=False)
class _Points:
    """Points that may carry a marker: markers, joints, and three points around every joint that turn with it."""

    place: np.ndarray  # (T, N, 3) m, N = M + 4 J; NaN where missing
    error: np.ndarray  # (T, N) m


def _spread(place: np.ndarray, marker: int, known: np.ndarray) -> np.ndarray:
    """Return how much the distance between each point and a marker varies, (N,) m; infinite if never seen together.

    Frames are those in which the marker is known.
    """
    some = known[np.unique(np.linspace(0, len(known) - 1, min(len(known), _SAMPLES)).astype(int))]
    apart = np.linalg.norm(place[some] - place[some, marker][:, None], axis=-1)
    there = np.isfinite(apart)
    count = np.maximum(there.sum(axis=0), 1)
    mean = np.where(there, apart, 0).sum(axis=0) / count
    spread = np.sqrt((np.where(there, apart - mean, 0) ** 2).sum(axis=0) / count)
    spread[there.sum(axis=0) < min(len(some), 3)] = np.inf
    spread[marker] = np.inf
    return spread


def _is_on_body(points: _Points, spread: np.ndarray, marker: int, known: np.ndarray, rate: float) -> bool:
    """Whether the body carries a marker from one frame to another in which it is seen."""
    ahead = max(1, round(_AHEAD * rate))
    after = known[np.isin(known + ahead, known)]
    if not after.size:
        return True  # seen too briefly to decide
    some = after[np.unique(np.linspace(0, len(after) - 1, min(len(after), _TRIALS)).astype(int))]
    far = [
        np.linalg.norm(_carried(points, spread, marker, t, np.array([t + ahead]))[0] - points.place[t + ahead, marker])
        for t in some.tolist()
    ]
    return bool(np.median(far) <= ALIKE)


def _bridged(points: _Points, spread: np.ndarray, marker: int, first: int, end: int, rate: float) -> np.ndarray:
    """Return a marker in a gap (N, 3) m, carried there from both sides, or from the only one."""
    frames, gap = len(points.place), np.arange(first, end)
    sides = []
    if first > 0:
        sides.append((first - 1, -1, (end - gap) / (end - first + 1)))
    if end < frames:
        sides.append((end, 1, (gap - first + 1) / (end - first + 1)))
    total, share = np.zeros((len(gap), 3)), np.zeros((len(gap), 1))
    for edge, outward, near in sides:
        way = _carried(points, spread, marker, edge, gap)
        beyond = edge + outward
        if 0 <= beyond < frames and np.isfinite(points.place[beyond, marker]).all():
            # The marker's velocity relative to its segment at the edge of the gap.
            own = points.place[edge, marker] - _carried(points, spread, marker, beyond, np.array([edge]))[0]
            steps = np.abs(gap - edge)[:, None]
            way = way + own * steps * coasting_weight(steps / (COASTING * rate))
        smooth = smooth_step(near)[:, None] if len(sides) == 2 else np.ones((len(gap), 1))
        total, share = total + smooth * way, share + smooth
    return total / share


def _carried(points: _Points, spread: np.ndarray, marker: int, start: int, frames: np.ndarray) -> np.ndarray:
    """Return (N, 3) m: a marker moved from frame `start` to others with the points around it."""
    place, error = points.place, np.maximum(points.error[frames], points.error[start])
    there = np.isfinite(place[frames]).all(axis=-1) & np.isfinite(place[start]).all(axis=-1)
    heavy = np.where(there, 1 / (spread**2 + error**2) ** 2, 0.0)
    heavy = heavy / heavy.sum(axis=1, keepdims=True)
    source, target = np.nan_to_num(place[start]), np.nan_to_num(place[frames])
    middle, aim = heavy @ source, np.einsum("nk,nkc->nc", heavy, target)
    turned = np.einsum("nk,nka,nkb->nab", heavy, source - middle[:, None], target - aim[:, None])
    u, _, vt = np.linalg.svd(turned)
    sign = np.linalg.det(u) * np.linalg.det(vt)
    vt[:, 2] *= sign[:, None]
    turn = np.swapaxes(u @ vt, -1, -2)
    return aim + np.einsum("nab,nb->na", turn, place[start, marker] - middle)
