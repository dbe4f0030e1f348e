"""Values and rotations over time: smoothing, fading and continuous signs. The first axis is time."""

from __future__ import annotations

import numpy as np

from bodysense.geometry.rotation import smooth_step


def smoothed(values: np.ndarray, frames: float) -> np.ndarray:
    """Smooth values (T, ...) by a Gaussian with a standard deviation in frames; first and last values are extended."""
    reach = int(np.ceil(3 * frames - 1e-6))  # equal for rates that differ by rounding
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / frames) ** 2)
    padded = np.concatenate([values[:1].repeat(reach, axis=0), values, values[-1:].repeat(reach, axis=0)])
    parts = (share * padded[k : k + len(values)] for k, share in enumerate((weight / weight.sum()).tolist()))
    return sum(parts, start=np.zeros(values.shape))


def fade_out(frames: int) -> np.ndarray:
    """Return weights (frames,) that fall smoothly between 1, the frame before the first, and 0, that after the last."""
    return 1 - smooth_step(np.arange(1, frames + 1) / (frames + 1))


def continuous(rotation: np.ndarray) -> np.ndarray:
    """Return equal rotations (T, ..., 4) with signs chosen so that each quaternion is close to the one before."""
    flips = np.where((rotation[1:] * rotation[:-1]).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    return np.concatenate([rotation[:1], rotation[1:] * np.cumprod(flips, axis=0)])
