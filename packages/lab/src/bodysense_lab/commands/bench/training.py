"""`bodysense bench training`: speed of drawing sequences and of training steps."""

from __future__ import annotations

import itertools
import tempfile
import time
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from bodysense.ranges import Count, Processes, within
from bodysense_lab.commands.bench.timing import report
from bodysense_lab.core.options import Json


def training(
    steps: Count = 6,
    threads: Processes = 1,
    processes: Annotated[int, within(int, 0, 1024)] = 2,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    json: Json = None,
) -> None:
    """Time the drawing of sequences for `train completion`, and its steps, in frames per second.

    Args:
        steps: optimiser steps, after one to warm up.
        threads: PyTorch threads.
        processes: processes that draw sequences; 0: this one.
        device: device of the steps; an accelerator if there is one, if omitted.
    """
    import torch

    from bodysense_lab.completion.networks.network import CompletionNetwork
    from bodysense_lab.completion.training.drawing import Drawing
    from bodysense_lab.completion.training.packaged import packaged_corpus, packaged_sampler
    from bodysense_lab.completion.training.task import CompletionTask, CompletionTaskConfig
    from bodysense_lab.core.fit import launch_fabric, take_step
    from bodysense_lab.core.options import Schedule

    torch.set_num_threads(threads)
    fabric, configuration = launch_fabric(device=device), CompletionTaskConfig()
    frames = configuration.streams * configuration.chunk
    network = CompletionNetwork(configuration.network).to(fabric.device)
    draw = packaged_sampler(np.random.default_rng(0))
    with tempfile.TemporaryDirectory() as folder:
        drawn = (draw() for _ in itertools.count())
        if processes:
            drawn = Drawing(packaged_sampler, Path(folder) / "ring", processes, block=8).sequences(0)
        next(drawn)  # the processes have started
        begun, count = time.perf_counter(), 0
        while count < frames * (steps + 1):
            count += len(next(drawn))
        draw_rate = count / (time.perf_counter() - begun)
        drawn.close()
    task = CompletionTask(network, configuration, Schedule(), packaged_corpus(), {})
    batches = list(itertools.islice(task.batches(np.random.default_rng(0)), steps + 1))
    optimizer, memory = task.optimizer(), None
    for step, batch in enumerate(batches):
        if step == 1:  # after one to warm up
            begun = time.perf_counter()
        terms, memory = take_step(task, optimizer, batch, memory, fabric)
        float(terms["loss"].detach())  # wait for the device
    numbers = {
        "draw_frames_per_second": draw_rate,
        "step_frames_per_second": frames * steps / (time.perf_counter() - begun),
    }
    report("training", numbers, json)
