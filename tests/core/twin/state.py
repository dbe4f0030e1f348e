"""The memory of one person's pose from frame to frame."""

from dataclasses import dataclass, field

import numpy as np

from .blend import LimbState
from .ease import Ease
from .feet import FootState
from .fit import Fitting
from .limbs import LIMBS
from .offset_decay import OffsetDecay
from .points import BODY, POINTS


def _zeros() -> np.ndarray:
    return np.zeros(3)


@dataclass
class PoseState:
    """State of the pose after the frame before, as output; positions count from base."""

    begun: bool = False
    has_measured_position: bool = False  # a position was measured since motion started
    had_position: np.ndarray = field(default_factory=lambda: np.zeros(POINTS, bool))
    had_rotation: np.ndarray = field(default_factory=lambda: np.zeros(BODY, bool))
    point: np.ndarray = field(default_factory=lambda: np.zeros((POINTS, 3)))  # m
    rotation: np.ndarray = field(default_factory=lambda: np.tile(np.eye(3), (BODY, 1, 1)))  # world ← joint
    spin: np.ndarray = field(default_factory=lambda: np.zeros((BODY, 3)))  # rad/s, world
    fitting: list[Fitting] = field(default_factory=lambda: [Fitting() for _ in range(BODY)])
    offset_decay: list[OffsetDecay] = field(default_factory=lambda: [OffsetDecay() for _ in range(BODY)])
    sensors_changed: bool = False  # in the frame before, a point that decides about the whole body came or went
    turn: list[Ease] = field(default_factory=lambda: [Ease() for _ in range(BODY)])
    head: Ease = field(default_factory=Ease)
    pelvis: Ease = field(default_factory=Ease)
    head_speed: np.ndarray = field(default_factory=_zeros)  # m/s
    pelvis_bent: np.ndarray = field(default_factory=_zeros)  # m, the pelvis before legs moved it
    pelvis_speed: np.ndarray = field(default_factory=_zeros)  # m/s, of that
    pull: Ease = field(default_factory=Ease)
    pulled: np.ndarray = field(default_factory=_zeros)  # m, by how much measured legs moved the pelvis
    pulled_speed: np.ndarray = field(default_factory=_zeros)  # m/s
    pulling: tuple[tuple[bool, bool], ...] = ((False, False), (False, False))  # which measured joints of legs did
    standing_drop: float = 0.0  # m, by how much the pelvis is lowered so that feet reach the floor
    limb: dict[str, LimbState] = field(default_factory=lambda: {name: LimbState() for name in LIMBS})
    foot: list[FootState] = field(default_factory=lambda: [FootState(), FootState()])
    # Chest's heading ← wrist when its rotation was last known, and s since then; None: never.
    wrist_kept: list[np.ndarray] = field(default_factory=lambda: [np.eye(3), np.eye(3)])
    wrist_lost: list[float | None] = field(default_factory=lambda: [None, None])
