"""The file of a trained network: round the weights, calibrate the expected errors, write both with a model card."""

from __future__ import annotations

import copy
import itertools
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bodysense.tracking.model import load_completion
from bodysense_lab.completion.data.corpus_cache import read_corpus
from bodysense_lab.completion.networks.error_map import (
    ErrorMap,
    disagreement_map,
    identity_map,
)
from bodysense_lab.completion.networks.error_samples import ErrorSamples, sample_errors, sampled_scenes
from bodysense_lab.completion.networks.fingers import FingerNetwork
from bodysense_lab.completion.networks.network import CompletionNetwork
from bodysense_lab.completion.networks.rounding import round_weights, sample_moments
from bodysense_lab.completion.networks.weights_file import TrainedNetworks, write_weights
from bodysense_lab.completion.training.task import CompletionTask, CompletionTaskConfig
from bodysense_lab.core.options import Schedule

QUANTILE = 0.9
_BATCH, _RATE = 2048, 5e-3  # samples of a step of the fit, and learning rate
_PULL = 1e-4  # weight of the pull toward the identity map
_FIT_STEPS, _TRIAL_STEPS = 3000, 100  # optimiser steps of an error map; the second for trials


def fit_error_map(
    samples: ErrorSamples, quantile: float | None = None, steps: int = _FIT_STEPS, seed: int = 6
) -> ErrorMap:
    """Fit the mean error, or a quantile of it, to samples, in `steps` optimiser steps.

    The core multiplies bounds by the samples' `rarity`, so a quantile is that of the errors divided by it.
    Many samples are of training people, whose errors are smaller. The fit therefore reads `in_training` as one more
    input. It learns the distribution of errors from all people and their size from validation people. The returned map
    lacks this input: it assumes an unseen person.
    """
    inputs = torch.from_numpy(np.column_stack([samples.inputs, samples.in_training]).astype(np.float32))
    factor = np.ones(len(samples.error)) if quantile is None else samples.rarity
    error = torch.from_numpy((samples.error / factor[:, None]).astype(np.float32)).clamp(min=1e-4)
    untracked = torch.from_numpy(samples.untracked.astype(np.float32))
    until = torch.from_numpy(np.cumsum(samples.weight))
    generator = torch.Generator().manual_seed(seed)
    start = identity_map()
    parts = [torch.tensor(getattr(start, name), dtype=torch.float32) for name in vars(start)]
    parts[:2] = [torch.cat([part, torch.zeros(1, part.shape[1])]) for part in parts[:2]]  # `in_training`
    parts[1] = torch.randn(parts[1].shape, generator=generator) * 0.1
    weight, inward, inward_offset, outward, offset = parts = [part.requires_grad_() for part in parts]
    optimizer = torch.optim.AdamW(parts, lr=_RATE, weight_decay=0.0)
    identity = torch.eye(*weight.shape)
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = _RATE * (1 - step / steps)
        drawn = torch.rand(_BATCH, generator=generator, dtype=torch.float64) * until[-1]
        rows = torch.searchsorted(until, drawn).clamp(max=len(inputs) - 1)
        x, counted = inputs[rows], untracked[rows]
        expected = x @ weight + torch.tanh(x @ inward + inward_offset) @ outward + offset
        missed = torch.log(error[rows]) - expected
        if quantile is None:
            loss = error[rows] * torch.exp(-expected) + expected
        else:
            loss = torch.maximum(quantile * missed, (quantile - 1) * missed)
        total = (loss * counted).sum() / counted.sum()
        pull = (weight - identity).square().sum() + inward.square().sum() + outward.square().sum()
        optimizer.zero_grad()
        (total + _PULL * pull).backward()
        optimizer.step()
    tables = [part.detach().numpy().copy() for part in parts]
    return ErrorMap(tables[0][:-1], tables[1][:-1], *tables[2:])


_STREAMS, _BATCHES, _ROUNDING_SEED = 96, 24, 8  # parallel sequences and batches for rounding, and their seed


def round_network(
    body: CompletionNetwork, data: Path, limit: int | None = None, backward: bool = False
) -> CompletionNetwork:
    """Return a copy of the network whose weights are rounded so that it changes least on training sequences.

    Args:
        body: the trained network.
        data: folder of motion or store; its train split is used.
        limit: number of clips to read, for a trial; None: all.
        backward: whether the network is for time that runs backward.
    """
    body = copy.deepcopy(body)
    corpus = read_corpus(data, "train", limit)
    config = CompletionTaskConfig(body.config, streams=_STREAMS, backward=backward)
    task = CompletionTask(body, config, Schedule(), corpus, {})
    batches = task.batches(np.random.default_rng(_ROUNDING_SEED))
    round_weights(body, sample_moments(body.eval(), itertools.islice(batches, _BATCHES if limit is None else 1)))
    return body


def publish(
    body: CompletionNetwork,
    fingers: FingerNetwork,
    data: Path,
    out: Path,
    card: dict[str, Any],
    limit: int | None = None,
    backward: bool = False,
) -> None:
    """Calibrate the expected errors of rounded networks, and write both as one file.

    `card` has the training data and the licence. For `limit` and `backward` see `round_network`.
    """
    full_card = {"network": asdict(body.config), "fingers": asdict(fingers.config)} | card
    start, disagreement = identity_map(), disagreement_map()
    beside = out.with_name(f"{out.stem}.uncalibrated.safetensors")
    try:
        write_weights(TrainedNetworks(body, fingers, start, disagreement), beside, full_card)
        samples = sample_errors(sampled_scenes(data, limit, backward), load_completion(beside, backward))
    finally:
        beside.unlink(missing_ok=True)
    steps = _FIT_STEPS if limit is None else _TRIAL_STEPS
    mean, bound = fit_error_map(samples, steps=steps), fit_error_map(samples, QUANTILE, steps)
    write_weights(TrainedNetworks(body, fingers, mean, bound), out, full_card)
