"""What the three-point estimator is told of itself, and what it remembers of one wearer."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.estimators.foot_lock import FootLockSettings, FootLockState
from bodysense.estimators.three_point_answers import Memory


@dataclass(frozen=True)
class ThreePointSettings:
    """What is done about the network's answer."""

    hand_half_life: float = 0.06  # s in which half of the way to a lost or found hand's new place is made
    longest_gap: float = 1.0  # s without frames after which everything starts afresh
    # None leaves feet where the network has them, also under the floor.
    feet: FootLockSettings | None = field(default_factory=FootLockSettings)

    def __post_init__(self) -> None:
        for name in ("hand_half_life", "longest_gap"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"three-point settings: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True, eq=False)
class ThreePointState:
    """What the network remembers, and what was shown."""

    memories: tuple[Memory, ...]  # of the network, oldest first; none before the first frame
    time: float | None  # s, of the last frame
    head: tuple[np.ndarray, np.ndarray]  # (3,) m, (4,) wxyz: the last known
    headset: float | None  # s, when its position was last known
    measured: np.ndarray  # (2, 2) bool: position and rotation of left and right hand in the last frame
    hand: np.ndarray  # (2, 3) m, from the head: where hands were shown
    hand_rotation: np.ndarray  # (2, 4) wxyz, world
    jump: np.ndarray  # (2, 2, 3): what is left of the last one, in m and in rad (rotation vectors in the world)
    closing: np.ndarray  # (2, 2, 3) how fast that changes, per s
    feet: FootLockState
