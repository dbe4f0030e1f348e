"""Coordination of joints: a prediction of missing joints in a gap from known joints.

An arm swings with the opposite leg, and the chest leans against the hips. So if known joints deviate from their
interpolation over a gap (`gaps.interpolate`), missing joints deviate from theirs, too. The deviations of all joints
have one normal distribution for each length of gap. The prediction for missing joints is the conditional mean, given
the known joints. Deviations and their speeds are zero at the sides of a gap.

The covariances were measured on training people (docs/credits.md, "Assets").
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.geometry import gaps
from bodysense.geometry.rotation import (
    quaternion_conjugate,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
)

FILE = "coordination.npz"  # in this package
ROOT = len(BODY)  # index of the root's position, after the joints
NOISE = 1e-5  # rad² (m²) added to the variances of known joints, so that small differences do not count


@dataclass(frozen=True, eq=False)
class Coordination:
    """Covariances of deviations: of joints in `BODY`, rad in their axes, and of the root's position, m in its axes."""

    seconds: np.ndarray  # (L,) lengths of gaps, increasing
    covariance: np.ndarray  # (L, 3 (J + 1), 3 (J + 1))

    def expected(self, known: np.ndarray, is_known: np.ndarray, seconds: float) -> np.ndarray:
        """Return deviations (N, J + 1, 3) of a gap, with missing ones replaced by their conditional mean.

        Args:
            known: (N, J + 1, 3) rad, the last in m; arbitrary if missing.
            is_known: (J + 1,) bool.
            seconds: length of the gap. Covariances are interpolated between measured lengths.
        """
        frames, result = len(known), np.array(known)
        result[:, ~is_known] = 0
        if is_known.all() or not is_known.any():
            return result
        # Interpolate the covariance over the logarithm of the gap's length.
        place = np.interp(np.log(seconds), np.log(self.seconds), np.arange(len(self.seconds)))
        low = min(int(place), len(self.seconds) - 2)
        covariance = (low + 1 - place) * self.covariance[low] + (place - low) * self.covariance[low + 1]
        given = np.repeat(is_known, 3)
        own = covariance[np.ix_(given, given)] + NOISE * np.eye(given.sum())
        share = np.linalg.solve(own, covariance[np.ix_(given, ~given)])
        result[:, ~is_known] = (known[:, is_known].reshape(frames, -1) @ share).reshape(frames, -1, 3)
        return result


def deviations(
    rotation: gaps.Rotations, root: np.ndarray, first: int, end: int, seconds: float, part: slice = slice(None)
) -> np.ndarray:
    """Return the deviations (N, J + 1, 3) of joints and root from their interpolation over a gap between known frames.

    Args:
        rotation: (T, J, 4) local rotations of the joints in `BODY`.
        root: (T, 3) m, position of the root.
        first: first frame of the gap, > 0.
        end: frame after its last, < T.
        seconds: time between frames.
        part: frames of the gap that are returned, counted from its first.
    """
    fading, frames = gaps.COASTING / seconds, range(first, end)[part]
    here = slice(frames.start, frames.stop)
    inside = gaps.interpolate(rotation, first, end, fading, part=part)
    turned = quaternion_log(quaternion_multiply(quaternion_conjugate(inside), rotation[here]))
    off = root[here] - gaps.interpolate_positions(root, first, end, fading, part)
    moved = quaternion_rotate(quaternion_conjugate(inside[:, 0]), off)
    return np.concatenate([np.asarray(turned), np.asarray(moved)[:, None]], axis=1)


@lru_cache(maxsize=1)
def coordination() -> Coordination:
    """Return the packaged covariances."""
    with (files("bodysense.body") / FILE).open("rb") as file, np.load(file, allow_pickle=False) as stored:
        seconds, upper = stored["seconds"], stored["upper"]
    size = 3 * (ROOT + 1)
    covariance = np.zeros((len(seconds), size, size))
    rows, columns = np.triu_indices(size)
    covariance[:, rows, columns] = upper
    covariance[:, columns, rows] = upper
    return Coordination(seconds.astype(float), covariance)
