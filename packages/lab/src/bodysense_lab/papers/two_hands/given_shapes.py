"""Shapes of hands as networks read them in training: exact, with an error, or unknown."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import default_glove, template
from bodysense.body.hands.hand import HAND_JOINTS, hand_skeleton
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense_lab.papers.two_hands.frames import GloveFrames

EXACT, UNKNOWN = 0.3, 0.15  # shares of exact and of unknown shapes; the rest have an error
_OFF = 0.006  # m, largest standard deviation of the error of a resting offset, and of a marker
_TURNED = 0.12  # rad, the same of a joint's axes
_SIZED = 0.03  # log, the same of the size, also of a hand with unknown shape
_CHAIN = [HAND_JOINTS.index(f"middle{k}") for k in (1, 2, 3)]


class GivenShapes(NamedTuple):
    """Shapes of n hands as the network reads them, normalised by size; the true hands are `scale` times as large."""

    rest: np.ndarray  # (n, 21, 3) m
    axes: np.ndarray  # (n, 15, 4)
    template: np.ndarray  # (n, 9, 3) m
    shape: np.ndarray  # (n, 87) float32, input of the networks: zeros if unknown
    scale: np.ndarray  # (n, 1, 1)


def draw_shapes(frames: GloveFrames, of: np.ndarray, rng: np.random.Generator) -> GivenShapes:
    """Draw the shapes of the hands of motions `of` (n,)."""
    count, kind = len(of), rng.random(len(of))
    error = np.where(kind < EXACT, 0.0, rng.random(count))[:, None, None]
    rest, flat = frames.rest[of].astype(float), frames.template[of].astype(float)
    displacement = error * _OFF * rng.standard_normal(rest.shape)
    displacement[:, 0] = 0.0
    rest = rest + displacement
    flat = flat + error * _OFF * rng.standard_normal(flat.shape)
    axes = quaternion_multiply(quaternion_exp(error * _TURNED * rng.standard_normal((count, 15, 3))), frames.axes[of])
    unknown = (kind > 1 - UNKNOWN)[:, None, None]
    typical, markers = _default()
    rest, flat = np.where(unknown, typical, rest), np.where(unknown, markers, flat)
    axes = np.where(unknown, np.array([1.0, 0.0, 0.0, 0.0]), axes)
    size = np.linalg.norm(rest[:, _CHAIN].sum(axis=1) + rest[:, -3], axis=-1)[:, None, None] / default_glove().size
    shape = np.concatenate([rest[:, 1:].reshape(count, -1), flat.reshape(count, -1)], axis=1) / size[:, 0]
    shape = np.where(unknown[:, 0], 0.0, shape).astype(np.float32)
    scale = np.exp(error * _SIZED * rng.standard_normal((count, 1, 1))) / size
    return GivenShapes(rest / size, np.asarray(axes), flat / size, shape, scale)


@lru_cache(maxsize=1)
def _default() -> tuple[np.ndarray, np.ndarray]:
    """Return the resting offsets and the flat markers of the default hand, in place of unknown ones."""
    hand = hand_skeleton(default_skeleton(), "left")
    return hand.rest_offset, template(default_glove(), hand)
