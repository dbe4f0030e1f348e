"""Windows of key-points at a constant rate, from frames at any rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bodysense.geometry.rotation import normalize
from bodysense.geometry.series import continuous

TIME_TOLERANCE = 1e-6  # s, or frames; times that differ less are equal


@dataclass(frozen=True, eq=False)
class ArmFrame:
    """One input frame with its key-points, and the sum of the windows' predictions for it."""

    time: float  # s
    values: dict[str, np.ndarray]  # by field of `ArmKeypoints`, without the time axis
    torso: np.ndarray  # (4,) wxyz, the last torso that was found
    rotation_sum: np.ndarray | None = None  # (38, 4) weighted sum of predicted rotations


def window_of(frames: Sequence[ArmFrame], time: np.ndarray) -> dict[str, np.ndarray]:
    """Return key-points (T, …) by field at `time` (T,) s, interpolated between frames; constant before the first.

    Values found in both neighbouring frames are interpolated. Others are those of the nearer frame.
    """
    place = np.interp(time, [frame.time for frame in frames], np.arange(len(frames)))
    before = np.minimum(np.floor(place + TIME_TOLERANCE).astype(int), len(frames) - 1)
    after = np.minimum(before + 1, len(frames) - 1)
    share = np.clip(place - before, 0.0, 1.0).astype(np.float32)
    window: dict[str, np.ndarray] = {}
    for name in ("arm", "torso", "hand"):
        mask, values = (np.stack([frame.values[key] for frame in frames]) for key in (f"has_{name}", name))
        far = share >= 0.5
        window[f"has_{name}"] = np.where(_shaped(far, mask), mask[after], mask[before])
        first, second = values[before], values[after]
        if name == "torso":
            second = align_signs(second, first)
        both = mask[before] & mask[after]
        along = np.where(both, _shaped(share, mask), _shaped(far, mask))
        between = first + along.reshape(*along.shape, *(1,) * (first.ndim - along.ndim)) * (second - first)
        window[name] = (between if name == "hand" else np.asarray(normalize(between))).astype(np.float32)
    return window


def smooth_window(window: dict[str, np.ndarray], time: np.ndarray, deviation: float) -> dict[str, np.ndarray]:
    """Smooth a window over time by a Gaussian of standard deviation `deviation` s, over found values only."""
    near = np.exp(-0.5 * ((time[:, None] - time) / deviation) ** 2)
    smooth = dict(window)
    for name in ("arm", "torso", "hand"):
        values, mask = window[name], window[f"has_{name}"]
        if name == "torso":
            values = continuous(values)
        flat = np.where(_shaped_as(mask, values), values, 0.0)
        weight = np.tensordot(near, mask.astype(float), axes=1)
        mean = np.tensordot(near, flat, axes=1) / np.maximum(_shaped_as(weight, values), 1e-9)
        mean = mean if name == "hand" else np.asarray(normalize(mean))
        smooth[name] = np.where(_shaped_as(mask, values), mean, window[name]).astype(np.float32)
    return smooth


def _shaped_as(mask: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return a mask (T, …) with as many axes as its values."""
    return mask.reshape(*mask.shape, *[1] * (values.ndim - mask.ndim))


def _shaped(values: np.ndarray, like: np.ndarray) -> np.ndarray:
    """Return values (T,) with as many axes as `like`."""
    return values.reshape(-1, *(1,) * (like.ndim - 1))


def align_signs(q: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return quaternions (..., 4) with the signs that are closer to those of `other`."""
    return np.where((q * other).sum(axis=-1, keepdims=True) < 0, -q, q)
