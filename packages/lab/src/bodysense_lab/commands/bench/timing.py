"""Shared parts of benchmarks: durations of calls, memory, and the printed line."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.observing.observation import Observation


def percentiles(one: Callable[[int], None], frames: int) -> dict[str, float]:
    """Run `one(frame)` for every frame and return latency percentiles in ms."""
    for frame in range(100):
        one(frame)
    durations = np.zeros(frames)
    for frame in range(frames):
        start = time.perf_counter()
        one(frame + 100)
        durations[frame] = time.perf_counter() - start
    return {f"p{q}_ms": float(1000 * np.percentile(durations, q)) for q in (50, 95, 99)}


def frame_stepper(method: Any, observation: Observation) -> Callable[[int], None]:
    """Return a function that steps a tracker, an estimator or hands by the n-th frame of a repeated observation."""
    state = method.start()
    single = [observation[place : place + 1] for place in range(len(observation))]

    def one(frame: int) -> None:
        nonlocal state
        place = frame % len(single)
        state = method.step(single[place], method.start() if place == 0 else state)[-1]

    return one


def resident_memory() -> float:
    """Return the peak resident memory of this process, MB."""
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)


def report(name: str, numbers: dict[str, float], json: Path | None, threads: str = "one thread") -> None:
    """Print a line that names the threads of the work, and write the numbers."""
    from bodysense.cli.show import processor, write_numbers

    figures = ", ".join(f"{key} {value:,.3g}" for key, value in numbers.items())
    print(f"{name}: {figures}  ({processor()}, {threads})")
    write_numbers(json, numbers)
