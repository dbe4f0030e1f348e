"""`bodysense bench training`: speed of training steps."""

from __future__ import annotations

from bodysense.ranges import Count, Processes
from bodysense_lab.commands.bench.timing import report
from bodysense_lab.core.options import Json


def training(steps: Count = 6, threads: Processes = 1, json: Json = None) -> None:
    """Time steps of `train completion`, and of UNOC's training on windows and on whole sequences with carried state.

    A window trains its last frame only; a sequence trains every frame.

    Args:
        steps: optimiser steps of each, after one to warm up.
        threads: PyTorch threads.
    """
    from bodysense.demo import packaged_performance
    from bodysense_lab.completion.pace import training_pace
    from bodysense_lab.papers.unoc.pace import throughput

    clip = packaged_performance()
    report("training", training_pace(clip, steps, threads) | throughput(clip, steps, threads), json)
