"""Tracking failures: spans in which a visible hand is lost."""

from __future__ import annotations

import numpy as np

from bodysense.body.skeleton import FINGERS
from bodysense.devices.simulated.noise import hide
from bodysense.observing.observation import Observation

SHORTEST, LONGEST = 0.2, 3.0  # s


def hide_hands(observation: Observation, per_minute: float, rng: np.random.Generator) -> Observation:
    """Lose each hand, wrist and fingers together, in `per_minute` spans of 0.2-3 s on average."""
    hidden = np.zeros(observation.has_position.shape, dtype=bool)
    duration = float(observation.time[-1] - observation.time[0])
    for side in ("left", "right"):
        parts = tuple(f"{side}_{part}" for part in ("wrist", *FINGERS))
        hand = [point for point, name in enumerate(observation.points) if name.startswith(parts)]
        for _ in range(rng.poisson(per_minute * duration / 60)):
            begin = observation.time[0] + rng.uniform(0, duration)
            # Short losses are more common than long ones: log-uniform.
            end = begin + np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST)))
            lost = (observation.time >= begin) & (observation.time < end)
            hidden[:, hand] |= lost[:, None]
    return hide(observation, hidden)
