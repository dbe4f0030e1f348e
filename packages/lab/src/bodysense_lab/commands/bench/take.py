"""`bodysense bench take`: completing a long recording with its past and future."""

from __future__ import annotations

import time

import numpy as np

from bodysense_lab.commands.bench.timing import report
from bodysense_lab.core.options import Json

RATE = 30.0  # Hz


def take(minutes: float = 10.0, device: str = "three_point", json: Json = None) -> None:
    """Time the completion of a long recording of a known body, with past and future, and causally as in live tracking.

    Args:
        minutes: length of the recording, which repeats the packaged performance forward and backward.
        device: simulated device.
    """
    from dataclasses import replace

    import bodysense as bs
    from bodysense.demo import packaged_performance
    from bodysense.io.resample import resample

    clip = resample(packaged_performance(), RATE)
    there_and_back = np.concatenate([np.arange(len(clip)), np.arange(len(clip) - 2, 0, -1)])
    clip = replace(clip, pose=clip.pose[np.resize(there_and_back, round(60 * minutes * RATE))])
    recording, person = bs.simulate(clip, device), bs.Person(clip.pose.skeleton)
    numbers = {}
    for prefix, causal in (("", False), ("causal_", True)):
        begun, worked = time.perf_counter(), time.process_time()
        bs.track(recording, person=person, causal=causal)
        seconds, processor = time.perf_counter() - begun, time.process_time() - worked
        numbers |= {
            f"{prefix}frames_per_second": len(clip) / seconds,
            f"{prefix}frames_per_processor_second": len(clip) / processor,
        }
    report("take", numbers, json, "two threads, one if causal")
