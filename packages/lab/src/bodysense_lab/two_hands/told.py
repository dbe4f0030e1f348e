"""What a network is told of a hand's shape while it learns: the truth, the truth with an error, or nothing."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bodysense.body.glove import default_glove, template
from bodysense.body.hand import HAND_JOINTS, hand_skeleton
from bodysense.body.rotation import quaternion_exp, quaternion_multiply
from bodysense.body.skeleton import default_skeleton
from bodysense_lab.two_hands.frames import GloveFrames

EXACT, UNTOLD = 0.3, 0.15  # how often shapes are told exactly, and not at all; else with an error
_OFF = 0.006  # m, largest standard deviation of a resting offset that is told with an error, and of a marker
_TURNED = 0.12  # rad, likewise, of a joint's axes
_SIZED = 0.03  # log, likewise, of the size; that of a hand whose shape is not told is as far off
_CHAIN = [HAND_JOINTS.index(f"middle{k}") for k in (1, 2, 3)]


class ToldHand(NamedTuple):
    """What n hands are taken for, at one size; the true ones are `scale` times as large as that makes them."""

    rest: np.ndarray  # (n, 21, 3) m
    axes: np.ndarray  # (n, 15, 4)
    template: np.ndarray  # (n, 9, 3) m
    shape: np.ndarray  # (n, 87) float32, what networks read: zeros where nothing is told
    scale: np.ndarray  # (n, 1, 1)


def draw_told(frames: GloveFrames, of: np.ndarray, rng: np.random.Generator) -> ToldHand:
    """Of the hands `of` (n,) of motions."""
    count, kind = len(of), rng.random(len(of))
    error = np.where(kind < EXACT, 0.0, rng.random(count))[:, None, None]
    rest, flat = frames.rest[of].astype(float), frames.template[of].astype(float)
    moved = error * _OFF * rng.standard_normal(rest.shape)
    moved[:, 0] = 0.0
    rest = rest + moved
    flat = flat + error * _OFF * rng.standard_normal(flat.shape)
    axes = quaternion_multiply(quaternion_exp(error * _TURNED * rng.standard_normal((count, 15, 3))), frames.axes[of])
    untold = (kind > 1 - UNTOLD)[:, None, None]
    typical, markers = _default()
    rest, flat = np.where(untold, typical, rest), np.where(untold, markers, flat)
    axes = np.where(untold, np.array([1.0, 0.0, 0.0, 0.0]), axes)
    size = np.linalg.norm(rest[:, _CHAIN].sum(axis=1) + rest[:, -3], axis=-1)[:, None, None] / default_glove().size
    shape = np.concatenate([rest[:, 1:].reshape(count, -1), flat.reshape(count, -1)], axis=1) / size[:, 0]
    shape = np.where(untold[:, 0], 0.0, shape).astype(np.float32)
    scale = np.exp(error * _SIZED * rng.standard_normal((count, 1, 1))) / size
    return ToldHand(rest / size, np.asarray(axes), flat / size, shape, scale)


@lru_cache(maxsize=1)
def _default() -> tuple[np.ndarray, np.ndarray]:
    """What hands are taken for of which nothing is told: the default one."""
    hand = hand_skeleton(default_skeleton(), "left")
    return hand.rest_offset, template(default_glove(), hand)
