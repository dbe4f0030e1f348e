"""What completes the bodies of sessions: whatever their signals have, many at a time."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.estimators.adaptive import PROFILES, Adaptive, AdaptiveState, step_many
from bodysense.estimators.ik_tracker import IkTracked, IkTracker
from bodysense.estimators.learned import Learned, Model, load_model
from bodysense.observation import HEADSET_ACCURACY, Observation

__all__ = ["PROFILES", "Adaptive", "AdaptiveState", "adaptive", "load", "step_many"]

@lru_cache(maxsize=1)
def _shared_model() -> Model:
    """The packaged network of a headset's cameras, loaded once."""
    return load_model()

def adaptive(skeleton: Skeleton) -> Adaptive:
    """What completes the body of one session, a headset's cameras' view included."""
    return Adaptive(skeleton, camera=IkTracked(IkTracker(Learned(_shared_model(), skeleton))))

def load() -> None:
    """Load what completes bodies from head and hands, so that nobody's first frame waits for it."""
    estimator = adaptive(default_skeleton())
    frame = Observation(
        points=("head",),
        position=np.zeros((1, 1, 3)),
        rotation=np.array([[[1.0, 0, 0, 0]]]),
        has_position=np.ones((1, 1), dtype=bool),
        has_rotation=np.ones((1, 1), dtype=bool),
        accuracy=np.full((1, 1), HEADSET_ACCURACY),
        time=np.zeros(1),
    )
    for wearers in (1, 2):  # one alone and many have sessions of their own in the runtime
        step_many([(estimator, frame, estimator.start())] * wearers)
