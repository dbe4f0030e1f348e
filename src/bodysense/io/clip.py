"""Clip: a recorded motion, a Pose over time with what is known of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose

Z_UP_TO_Y_UP = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])  # -90° about X: (x, y, z) becomes (x, z, -y)


@dataclass(frozen=True, eq=False)
class Clip:
    """One recording of one person."""

    name: str
    pose: Pose  # (T, …) NumPy float64, world +Y up, metres
    frame_rate: float  # Hz
    person: str = ""  # who moves; splits are by person
    category: str = ""  # what they do, where the data set says
    has_fingers: bool = True  # False where the recording has no finger motion (they are filled in, relaxed)

    def __len__(self) -> int:
        return int(self.pose.root_position.shape[0])

    @property
    def seconds(self) -> float:
        """Length of the recording."""
        return len(self) / self.frame_rate

    @property
    def time(self) -> np.ndarray:
        """(T,) s, from 0."""
        return np.arange(len(self)) / self.frame_rate
