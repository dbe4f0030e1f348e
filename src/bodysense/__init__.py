"""bodysense completes a human body, hands included, from partial and occluded tracking, in real time.

import bodysense as bs

bs.track("walk.bvh", device="headset_camera").save("out.bvh")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bodysense.body.person import Person
    from bodysense.body.pose import Pose
    from bodysense.body.skeleton import Skeleton
    from bodysense.conversion import convert
    from bodysense.io.clip import Clip
    from bodysense.observation import Estimate, Observation, observe
    from bodysense.reading import read, write
    from bodysense.take import Take, track
    from bodysense.tracker import Tracker

__version__ = "0.1.0"
__all__ = [
    "Clip",
    "Estimate",
    "Observation",
    "Person",
    "Pose",
    "Skeleton",
    "Take",
    "Tracker",
    "convert",
    "observe",
    "read",
    "track",
    "write",
]

# Where each name lives; its module is imported when the name is first used.
_HOMES = {
    "Clip": "io.clip",
    "Estimate": "observation",
    "Observation": "observation",
    "Person": "body.person",
    "Pose": "body.pose",
    "Skeleton": "body.skeleton",
    "Take": "take",
    "Tracker": "tracker",
    "convert": "conversion",
    "observe": "observation",
    "read": "reading",
    "track": "take",
    "write": "reading",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"bodysense.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
