"""bodysense completes a human body, hands included, from partial and occluded tracking, in real time.

import bodysense as bs

bs.track("walk.bvh", device="headset_camera").save("out.bvh")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bodysense import demo
    from bodysense.body.person import Person
    from bodysense.body.pose import Pose, forward_kinematics
    from bodysense.body.skeleton import Skeleton, default_skeleton
    from bodysense.devices.gloves.device import glove_device
    from bodysense.devices.simulated.device import Device, simulate
    from bodysense.errors import BodysenseError
    from bodysense.io.clip import Clip
    from bodysense.io.formats.recording import Recording
    from bodysense.io.reading_options import ReadingOptions
    from bodysense.observing.observation import Observation, observe
    from bodysense.quality import metrics
    from bodysense.sources.conversion import convert
    from bodysense.sources.reading import read, write
    from bodysense.takes.repair import repair
    from bodysense.takes.take import Take
    from bodysense.takes.track import track
    from bodysense.tracking.estimate import Estimate
    from bodysense.tracking.tracker import Tracker, TrackerSettings, step_together

__version__ = "0.1.0"
__all__ = [
    "BodysenseError",
    "Clip",
    "Device",
    "Estimate",
    "Observation",
    "Person",
    "Pose",
    "ReadingOptions",
    "Recording",
    "Skeleton",
    "Take",
    "Tracker",
    "TrackerSettings",
    "convert",
    "default_skeleton",
    "demo",
    "forward_kinematics",
    "glove_device",
    "metrics",
    "observe",
    "read",
    "repair",
    "simulate",
    "step_together",
    "track",
    "write",
]

# Where each name lives; its module is imported when the name is first used.
_HOMES = {
    "BodysenseError": "errors",
    "Clip": "io.clip",
    "Device": "devices.simulated.device",
    "Estimate": "tracking.estimate",
    "Observation": "observing.observation",
    "Person": "body.person",
    "Pose": "body.pose",
    "ReadingOptions": "io.reading_options",
    "Recording": "io.formats.recording",
    "Skeleton": "body.skeleton",
    "Take": "takes.take",
    "Tracker": "tracking.tracker",
    "TrackerSettings": "tracking.tracker",
    "convert": "sources.conversion",
    "default_skeleton": "body.skeleton",
    "forward_kinematics": "body.pose",
    "glove_device": "devices.gloves.device",
    "observe": "observing.observation",
    "read": "sources.reading",
    "repair": "takes.repair",
    "simulate": "devices.simulated.device",
    "step_together": "tracking.tracker",
    "track": "takes.track",
    "write": "sources.reading",
}
_MODULES = {"demo": "demo", "metrics": "quality.metrics"}  # public as modules


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"bodysense.{_MODULES[name]}")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"bodysense.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
