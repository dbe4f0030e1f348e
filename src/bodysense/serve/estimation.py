"""What completes the bodies of sessions: whatever their signals have, many at a time."""

from __future__ import annotations

from functools import lru_cache

from bodysense.body.skeleton import Skeleton
from bodysense.estimators.adaptive import PROFILES, Adaptive, AdaptiveState, step_many
from bodysense.estimators.learned import Learned, Model, load_model
from bodysense.tracker import Tracked, Tracker

__all__ = ["PROFILES", "Adaptive", "AdaptiveState", "adaptive", "step_many"]


@lru_cache(maxsize=1)
def _shared_model() -> Model:
    """The packaged network of a headset's cameras, loaded once."""
    return load_model()


def adaptive(skeleton: Skeleton) -> Adaptive:
    """What completes the body of one session, a headset's cameras' view included."""
    return Adaptive(skeleton, camera=Tracked(Tracker(Learned(_shared_model(), skeleton))))
