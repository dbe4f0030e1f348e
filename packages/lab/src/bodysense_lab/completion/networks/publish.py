"""The file of a trained network: round the weights, calibrate the expected errors, write both with a model card."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.progress import track as progress

from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split
from bodysense.tracking.model import CompletionModel, load_completion
from bodysense.tracking.tracker import Tracker
from bodysense_lab.completion.data.corpus_cache import read_corpus
from bodysense_lab.completion.data.points import body_indices
from bodysense_lab.completion.data.postures.posture_clips import posture_clips
from bodysense_lab.completion.data.signal_kinds import observed_set
from bodysense_lab.completion.kinds.lattice import random_edges
from bodysense_lab.completion.networks.error_map import (
    CERTAINTY_SCALE,
    LOG_TRACKED_DISAGREEMENT,
    LOG_TRACKED_ERROR,
    ErrorMap,
    disagreement_map,
    identity_map,
)
from bodysense_lab.completion.networks.fingers import FingerNetwork
from bodysense_lab.completion.networks.network import CompletionNetwork
from bodysense_lab.completion.networks.rounding import round_weights, sample_moments
from bodysense_lab.completion.networks.weights_file import TrainedNetworks, write_weights
from bodysense_lab.completion.score.scenes import (
    TRUTH_OF,
    TrackedScene,
    Truth,
    batches,
    person_of,
    scene_of,
    stack_observations,
)
from bodysense_lab.completion.training.options import BODIES, TABLE_SETS, Body
from bodysense_lab.completion.training.task import HEADSET_CATEGORIES, CompletionTask, CompletionTaskConfig
from bodysense_lab.core.options import Schedule
from bodysense_lab.data.clips import training_clips

QUANTILE = 0.9
_STRIDE = 4  # frames between samples; neighbouring frames are alike
_BATCH, _RATE = 2048, 5e-3  # samples of a step of the fit, and learning rate
_PULL = 1e-4  # weight of the pull toward the identity map


@dataclass(frozen=True, eq=False)
class ErrorSamples:
    """Inputs of the error map and measured errors, N frames."""

    inputs: np.ndarray  # (N, 119) float32: see `error_map.INPUTS`
    error: np.ndarray  # (N, 25) float32 m
    untracked: np.ndarray  # (N, 25) bool: the point was not tracked
    in_training: np.ndarray  # (N,) bool: the person is in the training data
    group: np.ndarray  # (N,) index of the pair of sensors and body


Scenes = Mapping[Truth, Sequence[Sequence[TrackedScene]]]


def sample_errors(
    training_scenes: Scenes, validation_scenes: Scenes, model: CompletionModel, seed: int = 5
) -> ErrorSamples:
    """Run the tracker over batches of scenes of training and of validation people, and sample its errors.

    `model` must return the network's own expected errors (`identity_map`) and, instead of their bounds, the distance
    between the network's two answers (`disagreement_map`).
    """
    rng = np.random.default_rng(seed)
    draws: list[tuple[SensorSet, Body]] = [(SENSOR_SETS[name], body) for name in TABLE_SETS for body in BODIES]
    for edge in random_edges(12, rng):
        draws.append((observed_set(edge.more), BODIES[int(rng.integers(len(BODIES)))]))
    jobs: list[tuple[SensorSet, Body, Sequence[TrackedScene], bool, int]] = []
    for group, (sensors, body) in enumerate(draws):
        for in_training, scenes in ((True, training_scenes), (False, validation_scenes)):
            for batch in scenes[TRUTH_OF[body]]:
                jobs.append((sensors, body, batch, in_training, group))
    parts = []
    for sensors, body, batch, in_training, group in progress(jobs, "expected and true errors"):
        columns = _sample_batch(sensors, body, batch, model)
        rows = len(columns[0])
        parts.append((*columns, np.full(rows, in_training), np.full(rows, group)))
    return ErrorSamples(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _sample_batch(
    sensors: SensorSet, body: Body, batch: Sequence[TrackedScene], model: CompletionModel
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    seen = [scene.observe(sensors) for scene in batch]
    tracker = Tracker([person_of(body, scene.skeleton) for scene in batch], model)
    whole, places, state = stack_observations(seen), body_indices(), tracker.start()
    parts = []
    for t in range(len(whole.time)):
        estimate, state = tracker.step(whole[t : t + 1], state)
        if t % _STRIDE == 0:
            outputs = (estimate.points, estimate.confidence, estimate.bound, estimate.measured)
            deviations = np.array([state.person(k).bone_deviation[places] for k in range(len(batch))])
            parts.append((*(each[:, 0, places] for each in outputs), deviations))
    sampled = [np.stack(part) for part in zip(*parts, strict=True)]  # (F, B, 25, ...)
    rows = []
    for index, (scene, observation) in enumerate(zip(batch, seen, strict=True)):
        frames = np.arange(0, len(scene), _STRIDE)
        position, expected, disagreement, measured, deviation = (part[: len(frames), index] for part in sampled)
        truth = scene.world_pose[0][frames][:, places]
        # Errors are relative to the measured head.
        position = position + (truth - position)[:, [BODY.index("head")]]
        turned = np.zeros((len(frames), len(BODY)), dtype=bool)
        for k, name in enumerate(observation.points):
            if name in BODY:
                turned[:, BODY.index(name)] = observation.has_rotation[frames, k]
        log = np.where(measured, LOG_TRACKED_ERROR, np.log(expected))
        log_disagreement = np.where(measured, LOG_TRACKED_DISAGREEMENT, np.log(disagreement))[:, : len(BODY)]
        inputs = np.concatenate([log, measured, turned, CERTAINTY_SCALE * deviation, log_disagreement], axis=1)
        error = np.linalg.norm(position - truth, axis=-1)
        rows.append((inputs.astype(np.float32), error.astype(np.float32), ~measured))
    inputs, error, untracked = (np.concatenate(column) for column in zip(*rows, strict=True))
    return inputs, error, untracked


_FIT_STEPS, _TRIAL_STEPS = 3000, 100  # optimiser steps of an error map; the second for trials


def fit_error_map(
    samples: ErrorSamples, quantile: float | None = None, steps: int = _FIT_STEPS, seed: int = 6
) -> ErrorMap:
    """Fit the mean error, or a quantile of it, to samples, in `steps` optimiser steps.

    Most samples are of training people, whose errors are smaller. The fit therefore reads `in_training` as one more
    input. It learns the distribution of errors from all people and their size from validation people. The returned map
    lacks this input: it assumes an unseen person.
    """
    inputs = torch.from_numpy(np.column_stack([samples.inputs, samples.in_training]).astype(np.float32))
    error = torch.from_numpy(samples.error.astype(np.float32)).clamp(min=1e-4)
    untracked = torch.from_numpy(samples.untracked.astype(np.float32))
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
        rows = torch.randint(len(inputs), (_BATCH,), generator=generator)
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
_LONGEST, _CLIPS = 9.0, 2  # s of a clip, and clips of each training person, for error samples


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
        training_scenes, validation_scenes = (_scenes(data, split, limit, backward) for split in ("train", "val"))
        samples = sample_errors(training_scenes, validation_scenes, load_completion(beside, backward))
    finally:
        beside.unlink(missing_ok=True)
    steps = _FIT_STEPS if limit is None else _TRIAL_STEPS
    mean, bound = fit_error_map(samples, steps=steps), fit_error_map(samples, QUANTILE, steps)
    write_weights(TrainedNetworks(body, fingers, mean, bound), out, full_card)


def _scenes(data: Path, split: Split, limit: int | None, backward: bool) -> dict[Truth, list[list[TrackedScene]]]:
    """Return batches of scenes of motions of headset wearers, on their own bodies and on unseen ones.

    All clips of validation people are used, and a few of each training person: the distribution of errors needs many
    people, and validation people are few. Clips of standing people are added in other postures. `backward` reverses
    time.
    """
    truths: tuple[Truth, ...] = ("own", "stranger")
    scenes: dict[Truth, list[list[TrackedScene]]] = {truth: [] for truth in truths}
    clips = [_middle_part(clip) for clip in training_clips(data, split, limit) if clip.category in HEADSET_CATEGORIES]
    if split == "train":
        clips = _few_of_each_person(clips)
    clips += list(posture_clips(clips))
    for batch in batches(clips):
        for truth in truths:
            found = [scene_of(clip, truth, split) for clip in batch]
            if backward:
                found = [replace(scene, pose=scene.pose[::-1]) for scene in found]
            scenes[truth].append(found)
    return scenes


def _middle_part(clip: Clip) -> Clip:
    """Return the middle `_LONGEST` seconds of a clip."""
    frames = int(np.ceil(_LONGEST * clip.frame_rate))
    first = max(0, (len(clip) - frames) // 2)
    return replace(clip, pose=clip.pose[first : first + frames])


def _few_of_each_person(clips: list[Clip]) -> list[Clip]:
    by_person: dict[str, list[Clip]] = {}
    for clip in clips:
        by_person.setdefault(clip.person, []).append(clip)
    return [clip for own in by_person.values() for clip in own[:: max(1, len(own) // _CLIPS)][:_CLIPS]]
