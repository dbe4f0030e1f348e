"""Completion of a recording by an estimator, in chunks of frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from bodysense.body.pose import Pose
from bodysense.io.clip import Clip
from bodysense.io.resample import at_constant_rate
from bodysense.observing.observation import Observation
from bodysense.sources.signals import Signal

_FRAMES = 60  # frames in one call
_USUAL_RATE = 30.0  # Hz, of a recording of one frame

Step = Callable[[Observation, Any], tuple[Pose, Any]]


def tracked_clip(signal: Signal, step: Step, state: Any) -> Clip:
    """Return the poses that `step` gives for a signal, at a constant rate."""
    seen, poses = signal.observation, list[Pose]()
    for first in range(0, len(seen), _FRAMES):
        pose, state = step(seen[first : first + _FRAMES], state)
        poses.append(pose)
    root = np.concatenate([np.asarray(pose.root_position) for pose in poses])
    rotation = np.concatenate([np.asarray(pose.rotation) for pose in poses])
    rate = 1 / float(np.median(np.diff(seen.time))) if len(seen) > 1 else _USUAL_RATE
    return at_constant_rate(Clip(signal.name, Pose(poses[0].skeleton, root, rotation), rate), seen.time)
