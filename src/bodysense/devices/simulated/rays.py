"""Rays from one camera that capsules and boxes block: a quick test of all pairs, then an exact test of the rest.

All positions are relative to the camera, in metres. A ray is the segment from the camera to its target. In the exact
tests components are the first axis of vectors, (3, ...), so that every operation runs along long rows.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.capsules import PosedPrimitives
from bodysense.geometry.segments import nearest_shares

_SLACK = 1e-4  # m: the quick test runs in single precision and lets near misses pass
_TINY = 1e-30  # keeps divisions by zero finite


def blocked(target: np.ndarray, solids: PosedPrimitives, active: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """Return the mask (F, R) of rays that a primitive blocks.

    Args:
        target: (F, R, 3) m, ends of the rays.
        solids: primitives of F frames, also relative to the camera.
        active: (F, R) bool: rays to test; the others count as free.
        blocks: (R, N) bool: primitive n can block ray r.
    """
    frames, rays = active.shape
    count, capsules = blocks.shape[1], solids.start.shape[1]
    possible = _toward(target, solids)
    possible &= blocks
    possible &= active[..., None]
    pair = np.flatnonzero(possible)
    ray, primitive = np.divmod(pair, count)
    frame = ray // rays
    targets = _components(target)
    hit = np.zeros(frames * rays, dtype=bool)

    is_box = primitive >= capsules
    r, n = ray[~is_box], primitive[~is_box]
    place = frame[~is_box] * capsules + n
    start, along = _components(solids.start), _components(solids.end - solids.start)
    radius = solids.primitives.radius.astype(target.dtype)[n]
    met = segment_meets_capsule(targets.take(r, axis=1), start.take(place, axis=1), along.take(place, axis=1), radius)
    hit[r[met]] = True

    f, r, n = frame[is_box], ray[is_box], primitive[is_box] - capsules
    axes = np.moveaxis(solids.axes[f, n], 0, -1)
    met = segment_meets_box(targets.take(r, axis=1), solids.center[f, n].T, axes, solids.primitives.half_size[n].T)
    hit[r[met]] = True
    return hit.reshape(frames, rays)


def _toward(target: np.ndarray, solids: PosedPrimitives) -> np.ndarray:
    """Return the mask (F, R, N) of rays in the cone from the camera about the primitive's bounding sphere."""
    direction = target / np.maximum(np.sqrt(np.einsum("frc,frc->fr", target, target)), _TINY)[..., None]
    middle = solids.middle
    # A unit vector is in the cone if its share along the middle is at least the length of the sphere's tangent.
    beyond = np.einsum("fnc,fnc->fn", middle, middle) - (solids.primitives.bounding_radius + _SLACK) ** 2
    tangent = np.where(beyond > 0, np.sqrt(np.maximum(beyond, 0)) - _SLACK, -np.inf).astype(np.float32)
    columns = np.ascontiguousarray(middle.swapaxes(1, 2), dtype=np.float32)
    return np.matmul(direction.astype(np.float32), columns) >= tangent[:, None]


def _components(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) as a contiguous (3, K)."""
    return np.ascontiguousarray(vectors.reshape(-1, 3).T)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the inner product over the first axis."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def segment_meets_capsule(target: np.ndarray, start: np.ndarray, along: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return whether segments from the origin to `target` meet capsules about the segments from `start` on `along`.

    Vectors are (3, ...), `radius` and the result (...).
    """
    return segment_distance_squared(np.zeros_like(target), target, start, along) <= radius * radius


def segment_distance_squared(
    start: np.ndarray, along: np.ndarray, other: np.ndarray, other_along: np.ndarray
) -> np.ndarray:
    """Return squared distances (...) of segments (3, ...) from `start` on `along` and `other` on `other_along`."""
    between = start - other
    uu, vv, uv = _dot(along, along), _dot(other_along, other_along), _dot(along, other_along)
    uw, vw = _dot(along, between), _dot(other_along, between)
    s, t = nearest_shares(uu, vv, uv, uw, vw)
    gap = between + s * along - t * other_along
    return _dot(gap, gap)


def segment_meets_box(target: np.ndarray, center: np.ndarray, axes: np.ndarray, half_size: np.ndarray) -> np.ndarray:
    """Return whether segments from the origin to `target` meet boxes (slab test, Kay and Kajiya 1986).

    Vectors are (3, ...), `axes` (3, 3, ...) world ← box, the result (...).
    """
    start = -np.einsum("ij...,i...->j...", axes, center)
    along = np.einsum("ij...,i...->j...", axes, target)
    # A ray parallel to a slab is inside it along its whole length or nowhere; a tiny divisor gives this result.
    along = np.where(np.abs(along) < _TINY, _TINY, along)
    low, high = (-half_size - start) / along, (half_size - start) / along
    enter, leave = np.minimum(low, high).max(axis=0), np.maximum(low, high).min(axis=0)
    return np.maximum(enter, 0) <= np.minimum(leave, 1)
