"""The second baseline of UNOC's Table 2: a hidden point keeps its last known velocity."""

from __future__ import annotations

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.takes.last_known import last_known

LONGEST = 0.5  # s for which a velocity is kept; later the point stays where it is


def constant_velocity(observation: Observation, skeleton: Skeleton) -> np.ndarray:
    """Return positions (T, P, 3) m in the world: hidden points move on from the last known ones.

    Fingers keep their velocity relative to the wrist.
    """
    wrist = np.where(skeleton.wrist_of >= 0, skeleton.wrist_of, -1)
    fingers = np.flatnonzero(wrist >= 0)
    held, (_, _, seen, _) = last_known(observation, skeleton)["world"].copy(), observed_points(observation, skeleton)
    seen = seen.copy()
    seen[:, fingers] &= seen[:, wrist[fingers]]
    held[:, fingers] -= held[:, wrist[fingers]]
    extrapolated = held.copy()
    velocity, hidden_for = np.zeros(held.shape[1:]), np.zeros(held.shape[1])
    for t in range(1, len(held)):
        interval = observation.time[t] - observation.time[t - 1]
        step = np.where((seen[t] & seen[t - 1])[:, None], (held[t] - held[t - 1]) / interval, 0.0)
        velocity = np.where(seen[t][:, None], step, velocity)
        hidden_for = np.where(seen[t], 0.0, hidden_for + interval)
        extrapolated[t] = held[t] + velocity * np.minimum(hidden_for, LONGEST)[:, None]
    extrapolated[:, fingers] += extrapolated[:, wrist[fingers]]
    return extrapolated
