"""Decaying offsets that hide jumps of the prediction when a sensor comes or goes.

A critically damped spring per joint: x(t) = (x₀ + (v₀ + k x₀) t) e^(-k t).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import exp
from typing import TYPE_CHECKING

import numpy as np

from .points import BODY, HEAD, HIPS, PELVIS, at
from .tracked import Tracked
from .vectors import turn_between, turned_by

if TYPE_CHECKING:
    from .network import Prediction
    from .state import PoseState

DECISIVE = [HEAD, PELVIS, *(at(f"{side}_{end}") for end in ("wrist", "ankle") for side in ("left", "right"))]
HALF_LIFE = 0.1  # s in which an offset at rest halves
STIFFNESS = 1.678 / HALF_LIFE  # 1/s: (1 + x) e^-x is a half at x = 1.678
TRUSTED = 0.7  # share of a joint's spin that remains after each frame with a change of sensors
CARRIED = 0.5  # share of the change of a joint's spin that is made gradual


@dataclass
class OffsetDecay:
    """Decaying offset that hides a jump of the predicted rotation of one joint."""

    off: np.ndarray = field(default_factory=lambda: np.zeros(3))  # rad, world
    speed: np.ndarray = field(default_factory=lambda: np.zeros(3))  # rad/s
    predicted: np.ndarray = field(default_factory=lambda: np.eye(3))  # world ← joint, in the frame before
    spin: np.ndarray = field(default_factory=lambda: np.zeros(3))  # rad/s, world

    def fade(self, interval: float) -> None:
        """Advance the spring by `interval` seconds."""
        pace, remaining = self.speed + STIFFNESS * self.off, exp(-STIFFNESS * interval)
        self.off = (self.off + interval * pace) * remaining
        self.speed = (self.speed - STIFFNESS * interval * pace) * remaining


def decay_offsets(seen: Tracked, predicted: Prediction, state: PoseState) -> None:
    """Continue the motion of predicted joints when one of the decisive points comes or goes."""
    changed = state.begun and (
        bool((seen.has_position[DECISIVE] != state.had_position[DECISIVE]).any())
        or seen.has_position[list(HIPS)].all() != state.had_position[list(HIPS)].all()
    )
    for j in range(BODY):
        joint, rotation = state.offset_decay[j], predicted.rotation[j].copy()
        if state.begun:
            joint.fade(seen.interval)
        if changed:
            joint.off = joint.off + turn_between(rotation, turned_by(joint.predicted, joint.spin * seen.interval))
            joint.spin = TRUSTED * joint.spin
        elif state.begun:
            spin = turn_between(joint.predicted, rotation) / seen.interval
            if state.sensors_changed:
                carried = CARRIED * (joint.spin - spin)
                joint.off, joint.speed = joint.off + seen.interval * carried, joint.speed + carried
            joint.spin = spin
        if seen.at_once:
            joint.off, joint.speed = np.zeros(3), np.zeros(3)
        joint.predicted = rotation
        predicted.rotation[j] = turned_by(rotation, joint.off)
    state.sensors_changed = changed
