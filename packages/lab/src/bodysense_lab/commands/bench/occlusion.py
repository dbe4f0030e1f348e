"""`bodysense bench occlusion`: the simulation of a headset's cameras."""

from __future__ import annotations

import time

import numpy as np

from bodysense.ranges import Count
from bodysense_lab.commands.bench.timing import report
from bodysense_lab.core.options import Json


def occlusion(frames: Count = 30_000, json: Json = None) -> None:
    """Time the simulation of a headset's cameras: the median of five passes after one to warm up.

    Args:
        frames: number of frames.
    """
    from bodysense.demo import packaged_performance
    from bodysense.devices.simulated.headset_camera import see

    clip = packaged_performance()
    many = clip.pose[np.arange(frames) % len(clip)]
    passes = []
    for _ in range(6):
        begun = time.perf_counter()
        see(many)
        passes.append(frames / (time.perf_counter() - begun))
    report("occlusion", {"frames_per_second": float(np.median(passes[1:]))}, json)
