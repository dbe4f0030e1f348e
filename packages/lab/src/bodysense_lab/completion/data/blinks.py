"""Simulated losses of sensors: hands that cameras lose, and a finger that is tracked on and off.

The durations of losses were measured on headsets that track hands: 1,518 gaps in 129 recordings, the two hands
independent of each other. The rate of losses is an assumption.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from bodysense.body.skeleton import FINGERS
from bodysense.devices.simulated.noise import hide
from bodysense.observing.observation import Observation

# Cumulative distribution of the durations of gaps: `_SHARE` of them last at most `_SECONDS`.
_SHARE = np.array([0.0, 0.10, 0.50, 0.61, 0.89, 0.90, 0.99, 1.0])
_SECONDS = np.array([0.02, 0.03, 0.10, 0.20, 1.00, 1.10, 6.70, 17.0])
SHORTEST_BETWEEN, MEAN_BETWEEN = 1.0, 2.0  # s between gaps: minimum, and mean of the exponential time beyond it
BLINKING = ("head", "three_point", "six_point", "headset_camera")  # sensor sets that are scored with a blinking finger
FINGER, EVERY = "left_index1", 3  # the joint that blinks, and frames between changes of its mask


def clip_rng(name: str) -> np.random.Generator:
    """Return the random generator for a clip's losses, seeded by the clip's name."""
    return np.random.default_rng(int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big"))


def gap_seconds(count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw durations of losses of a hand (count,), s."""
    return np.exp(np.interp(rng.uniform(size=count), _SHARE, np.log(_SECONDS)))


def lose_hands(observation: Observation, rng: np.random.Generator) -> Observation:
    """Hide each hand, wrist and fingers together, for durations of the measured distribution."""
    hidden = np.zeros(observation.has_position.shape, dtype=bool)
    time = observation.time
    for side in ("left", "right"):
        parts = tuple(f"{side}_{part}" for part in ("wrist", *FINGERS))
        hand = [place for place, name in enumerate(observation.points) if name.startswith(parts)]
        begin = time[0] + SHORTEST_BETWEEN + rng.exponential(MEAN_BETWEEN)
        while begin < time[-1]:
            # A gap shorter than a frame hides the first frame after its begin.
            first = int(np.searchsorted(time, begin))
            end = max(begin + gap_seconds(1, rng)[0], time[first] + 1e-6)
            hidden[:, hand] |= ((time >= begin) & (time < end))[:, None]
            begin = end + SHORTEST_BETWEEN + rng.exponential(MEAN_BETWEEN)
    return hide(observation, hidden)


def with_finger(observation: Observation, position: np.ndarray, blinking: bool) -> Observation:
    """Return the observation with a finger joint whose mask changes every `EVERY` frames, or that is never tracked.

    If the observation already has this joint, frames in which it or its wrist is not tracked stay so.

    Args:
        observation: (T, P).
        position: (T, 3) m, true position of the finger joint.
        blinking: whether the joint is tracked on and off; False: never tracked.
    """
    on = (np.arange(len(observation)) // EVERY % 2 == 1) & blinking
    if FINGER in observation.points:
        place = observation.points.index(FINGER)
        wrist = observation.points.index("left_wrist")
        hidden = np.zeros(observation.has_position.shape, dtype=bool)
        hidden[:, place] = ~(on & observation.has_position[:, wrist])
        return hide(observation, hidden)

    def with_column(values: np.ndarray, column: np.ndarray) -> np.ndarray:
        return np.concatenate([values, column[:, None]], axis=1)

    return replace(
        observation,
        points=(*observation.points, FINGER),
        position=with_column(observation.position, np.where(on[:, None], position, np.nan)),
        rotation=with_column(observation.rotation, np.full((len(observation), 4), np.nan)),
        has_position=with_column(observation.has_position, on),
        has_rotation=with_column(observation.has_rotation, np.zeros(len(observation), dtype=bool)),
        accuracy=with_column(observation.accuracy, observation.accuracy[:, 0]),
    )
