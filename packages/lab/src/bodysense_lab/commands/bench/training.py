"""`bodysense bench training`: speed of drawing sequences and of training steps."""

from __future__ import annotations

import itertools
import time

import numpy as np

from bodysense.ranges import Count, Processes
from bodysense_lab.commands.bench.timing import report
from bodysense_lab.core.options import Json


def training(steps: Count = 6, threads: Processes = 1, json: Json = None) -> None:
    """Time the drawing of sequences for `train completion`, and its steps, in frames per second.

    Args:
        steps: optimiser steps, after one to warm up.
        threads: PyTorch threads.
    """
    import torch

    from bodysense.demo import packaged_performance
    from bodysense_lab.completion.data.corpus import corpus_of
    from bodysense_lab.completion.networks.network import CompletionNetwork
    from bodysense_lab.completion.training.task import CompletionTask, CompletionTaskConfig
    from bodysense_lab.core.fit import launch_fabric, take_step
    from bodysense_lab.core.options import Schedule

    torch.set_num_threads(threads)
    fabric, configuration = launch_fabric(), CompletionTaskConfig()
    network = CompletionNetwork(configuration.network).to(fabric.device)
    task = CompletionTask(network, configuration, Schedule(), corpus_of([packaged_performance()]), {})
    source = task.batches(np.random.default_rng(0))
    begun = time.perf_counter()
    batches = list(itertools.islice(source, steps + 1))
    draw_seconds = time.perf_counter() - begun
    optimizer, memory = task.optimizer(), None
    for step, batch in enumerate(batches):
        if step == 1:  # after one to warm up
            begun = time.perf_counter()
        terms, memory = take_step(task, optimizer, batch, memory, fabric)
        float(terms["loss"].detach())  # wait for the device
    frames = configuration.streams * configuration.chunk
    numbers = {
        "draw_frames_per_second": frames * len(batches) / draw_seconds,
        "step_frames_per_second": frames * steps / (time.perf_counter() - begun),
    }
    report("training", numbers, json)
