"""Speed of the training of the completion network, in float32 and in bfloat16."""

from __future__ import annotations

import itertools
import time

import numpy as np
import torch

from bodysense.io.clip import Clip
from bodysense_lab.completion.data.corpus import Corpus, corpus_of
from bodysense_lab.completion.networks.network import CompletionNetwork
from bodysense_lab.completion.training.task import CompletionTask, CompletionTaskConfig
from bodysense_lab.core.fit import launch_fabric, take_step
from bodysense_lab.core.options import Schedule
from bodysense_lab.core.precision import layer_precision


def training_pace(
    clip: Clip, steps: int, threads: int, config: CompletionTaskConfig = CompletionTaskConfig()
) -> dict[str, float]:
    """Return training steps per second on sequences of a clip, and processor seconds per step, by flat keys.

    The time includes drawing the sequences. `steps_per_second` and `processor_seconds_per_step` are for the precision
    of `train completion` on this machine. Other load hardly changes the latter. Emulated bfloat16 is timed on a single
    step.
    """
    fabric, corpus = launch_fabric(), corpus_of([clip])
    torch.set_num_threads(threads)
    own = layer_precision(fabric.device)
    found: dict[str, float] = {}
    for name, precision in (("float32", torch.float32), ("bf16", torch.bfloat16)):
        count = steps if precision in (torch.float32, own) else 1
        pace, busy = _pace(corpus, config, count, precision)
        found[f"{name}_steps_per_second"] = pace
        if precision == own:
            found |= {"steps_per_second": pace, "processor_seconds_per_step": busy}
    return found


def _pace(corpus: Corpus, config: CompletionTaskConfig, steps: int, precision: torch.dtype) -> tuple[float, float]:
    """Return steps per second and processor seconds per step, after one step to warm up."""
    fabric = launch_fabric()
    torch.manual_seed(0)
    network = CompletionNetwork(config.network).to(fabric.device)
    task = CompletionTask(network, config, Schedule(), corpus, {}, precision=precision)
    optimizer, memory, begun, busy = task.optimizer(), None, 0.0, 0.0
    for step, batch in enumerate(itertools.islice(task.batches(np.random.default_rng(0)), steps + 1)):
        if step == 1:
            begun, busy = time.perf_counter(), time.process_time()
        terms, memory = take_step(task, optimizer, batch, memory, fabric)
        float(terms["loss"].detach())  # wait for the device
    return steps / (time.perf_counter() - begun), (time.process_time() - busy) / steps
