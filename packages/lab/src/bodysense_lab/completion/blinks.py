"""Sensors that blink: hands that cameras lose for measured durations, and a finger that comes and goes.

How long a hand is lost was measured on headsets that track hands: 1,518 gaps in 129 recordings, the two hands
independent of each other. How often is an assumption.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from bodysense.body.skeleton import FINGERS
from bodysense.devices.simulated.noise import hide
from bodysense.observation import Observation

# Share of the gaps that last at most `_SECONDS`.
_SHARE = np.array([0.0, 0.10, 0.50, 0.61, 0.89, 0.90, 0.99, 1.0])
_SECONDS = np.array([0.02, 0.03, 0.10, 0.20, 1.00, 1.10, 6.70, 17.0])
SHORTEST_BETWEEN, MEAN_BETWEEN = 1.0, 2.0  # s between gaps: at least, and on average beyond that
BLINKING = ("head", "three_point", "six_point", "headset_camera")  # sets that are scored with them
FINGER, EVERY = "left_index1", 3  # the joint that blinks, and after how many frames its mask changes


def clip_rng(name: str) -> np.random.Generator:
    """The generator of a clip's losses: always the same one."""
    return np.random.default_rng(int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big"))


def gap_seconds(count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw how long hands are lost (count,), s."""
    return np.exp(np.interp(rng.uniform(size=count), _SHARE, np.log(_SECONDS)))


def lose_hands(observation: Observation, rng: np.random.Generator) -> Observation:
    """Lose each hand, wrist and fingers together, by the measured law."""
    hidden = np.zeros(observation.has_position.shape, dtype=bool)
    time = observation.time
    for side in ("left", "right"):
        parts = tuple(f"{side}_{part}" for part in ("wrist", *FINGERS))
        hand = [place for place, name in enumerate(observation.points) if name.startswith(parts)]
        begin = time[0] + SHORTEST_BETWEEN + rng.exponential(MEAN_BETWEEN)
        while begin < time[-1]:
            # A gap that is shorter than a frame still hides the frame after it begins.
            first = int(np.searchsorted(time, begin))
            end = max(begin + gap_seconds(1, rng)[0], time[first] + 1e-6)
            hidden[:, hand] |= ((time >= begin) & (time < end))[:, None]
            begin = end + SHORTEST_BETWEEN + rng.exponential(MEAN_BETWEEN)
    return hide(observation, hidden)


def with_finger(observation: Observation, position: np.ndarray, blinking: bool) -> Observation:
    """The observation with a finger joint that blinks every `EVERY` frames, or that is never tracked.

    A finger that the observation has is tracked in no frame in which it was not, nor without its wrist.

    Args:
        observation: (T, P).
        position: (T, 3) m, where the finger truly is.
        blinking: whether it blinks.
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
