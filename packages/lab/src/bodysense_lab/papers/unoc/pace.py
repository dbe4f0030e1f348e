"""Training speed of UNOC's network: on windows, as in the paper, and on whole sequences with carried state."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace

import numpy as np
import torch

from bodysense.body.skeleton import default_skeleton
from bodysense.io.clip import Clip
from bodysense_lab.papers.unoc.network.network import PAPER, BodyNetwork
from bodysense_lab.papers.unoc.sequences.body_sequences import Augmentation, make_body_sequence
from bodysense_lab.papers.unoc.task import BodySchedule, BodyTask


def throughput(clip: Clip, steps: int, threads: int) -> dict[str, float]:
    """Measure trained windows and frames per second of the paper's GRU, on windows and on sequences, and their ratio.

    Both train the same layers with the losses of the paper, in the precision and batch sizes that training uses.
    """
    torch.set_num_threads(threads)
    schedule = BodySchedule(epochs=10**6, epoch_batches=(1024,) * 10**3)
    found: dict[str, float] = {}
    for form, config in (("window", PAPER), ("sequence", replace(PAPER, window=None))):
        model = BodyNetwork(config, default_skeleton())
        sequence = make_body_sequence(clip, model, Augmentation(), np.random.default_rng(0))
        sequences = [sequence] * 4  # more windows than a batch holds
        task = BodyTask(model, schedule, sequences, [])
        optimizer, memory, rng = task.optimizer(), None, np.random.default_rng(0)
        frames, begun = 0, 0.0
        for step, batch in enumerate(itertools.islice(task.batches(rng), steps + 1)):
            if step == 1:
                frames, begun = 0, time.perf_counter()
            terms, memory = task.loss(batch, memory)
            optimizer.zero_grad()
            terms["loss"].backward()
            optimizer.step()
            frames += int(batch.valid.sum()) if config.window is None else len(batch.valid)
        found[f"{form}_frames_per_second"] = frames / (time.perf_counter() - begun)
    found["windows_per_second"] = found["window_frames_per_second"]
    found["ratio"] = found["sequence_frames_per_second"] / found["window_frames_per_second"]
    return found
