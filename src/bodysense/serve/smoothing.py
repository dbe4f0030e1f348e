"""A pose that follows another one, critically damped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.products import CONJUGATE, exp, log, multiply
from bodysense.body.spring import spring_step


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A pose in motion."""

    time: float  # s
    root: np.ndarray  # (3,) m
    rotation: np.ndarray  # (J, 4) wxyz, parent ← joint
    velocity: np.ndarray  # (3,) m/s
    spin: np.ndarray  # (J, 3) rad/s


def at_rest(time: float, root: np.ndarray, rotation: np.ndarray) -> Smoothed:
    """A pose that does not move."""
    return Smoothed(time, root, rotation, np.zeros(3), np.zeros((len(rotation), 3)))


def followed(before: Smoothed, time: float, root: np.ndarray, rotation: np.ndarray, half_life: float) -> Smoothed:
    """The pose at `time` s on its way to another one: half a jump is closed after `half_life` s, at any rate."""
    turn = log(multiply(before.rotation, rotation * CONJUGATE))
    offset = np.concatenate([turn, [before.root - root]])
    velocity = np.concatenate([before.spin, [before.velocity]])
    offset, velocity = spring_step(offset, velocity, half_life, time - before.time)
    turned = multiply(exp(offset[:-1]), rotation)
    turned *= np.copysign(1.0, turned[:, :1])
    return Smoothed(time, root + offset[-1], turned, velocity[-1], velocity[:-1])
