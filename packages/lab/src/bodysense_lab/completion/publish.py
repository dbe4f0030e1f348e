"""From trained weights to the packaged file: expected errors made true, then one file of weights with its card."""

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
from bodysense.completion.model import CompletionModel, load_completion
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split
from bodysense.tracker import Tracker
from bodysense_lab.clips import training_clips
from bodysense_lab.completion.corpus import read_corpus
from bodysense_lab.completion.error_map import (
    CERTAINTY_SCALE,
    LOG_ALIKE,
    LOG_TRACKED,
    ErrorMap,
    shown_apart,
    unchanged_errors,
)
from bodysense_lab.completion.fingers import FingerNetwork
from bodysense_lab.completion.lattice import random_edges
from bodysense_lab.completion.network import CompletionNetwork
from bodysense_lab.completion.options import BODIES, TABLE_SETS, Body
from bodysense_lab.completion.points import body_places
from bodysense_lab.completion.rounding import round_weights, sample_moments
from bodysense_lab.completion.scenes import TRUTH_OF, TrackedScene, Truth, batches, person_of, scene_of, stacked
from bodysense_lab.completion.settled_clips import settled_clips
from bodysense_lab.completion.task import WORN, CompletionTask, CompletionTaskConfig
from bodysense_lab.completion.weights_file import TrainedNetworks, write_weights
from bodysense_lab.options import Schedule

QUANTILE = 0.9
_STRIDE = 4  # frames: neighbours tell little more
_BATCH, _RATE = 2048, 5e-3  # of the fit
_PULL = 1e-4  # toward errors as expected


@dataclass(frozen=True, eq=False)
class ErrorSamples:
    """Inputs of the error map and the errors that were measured, N frames."""

    known: np.ndarray  # (N, 119) float32: see `error_map.KNOWN`
    error: np.ndarray  # (N, 25) float32 m
    counts: np.ndarray  # (N, 25) bool: the point was not tracked
    learned: np.ndarray  # (N,) bool: person in the training data
    group: np.ndarray  # (N,) index of the draw of sensors and body


Scenes = Mapping[Truth, Sequence[Sequence[TrackedScene]]]


def sample_errors(learned: Scenes, watched: Scenes, model: CompletionModel, seed: int = 5) -> ErrorSamples:
    """Run the tracker over batches of scenes, 'own' and 'stranger', of people in the training data, and of others.

    The model gives the network's own expected errors and, in place of their bounds, the distance between the network's
    two answers (`unchanged_errors`, `shown_apart`).
    """
    rng = np.random.default_rng(seed)
    draws: list[tuple[SensorSet, Body]] = [(SENSOR_SETS[name], body) for name in TABLE_SETS for body in BODIES]
    for edge in random_edges(12, rng):
        draws.append((edge.more, BODIES[int(rng.integers(len(BODIES)))]))
    jobs: list[tuple[SensorSet, Body, Sequence[TrackedScene], bool, int]] = []
    for group, (sensors, body) in enumerate(draws):
        for known, scenes in ((True, learned), (False, watched)):
            for batch in scenes[TRUTH_OF[body]]:
                jobs.append((sensors, body, batch, known, group))
    parts = []
    for sensors, body, batch, known, group in progress(jobs, "expected and true errors"):
        columns = _sampled(sensors, body, batch, model)
        rows = len(columns[0])
        parts.append((*columns, np.full(rows, known), np.full(rows, group)))
    return ErrorSamples(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _sampled(
    sensors: SensorSet, body: Body, batch: Sequence[TrackedScene], model: CompletionModel
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    seen = [scene.observe(sensors) for scene in batch]
    tracker = Tracker([person_of(body, scene.skeleton) for scene in batch], model)
    whole, places, state = stacked(seen), body_places(), tracker.start()
    parts = []
    for t in range(len(whole.time)):
        estimate, state = tracker.step(whole[t : t + 1], state)
        if t % _STRIDE == 0:
            known = (estimate.points, estimate.confidence, estimate.bound, estimate.measured)
            deviations = np.array([state.person(k).bone_deviation[places] for k in range(len(batch))])
            parts.append((*(each[:, 0, places] for each in known), deviations))
    sampled = [np.stack(part) for part in zip(*parts, strict=True)]  # (F, B, 25, ...)
    rows = []
    for index, (scene, observation) in enumerate(zip(batch, seen, strict=True)):
        frames = np.arange(0, len(scene), _STRIDE)
        position, expected, apart, measured, deviation = (part[: len(frames), index] for part in sampled)
        truth = scene.placed[0][frames][:, places]
        # The head is where it is measured: what is missed from it is missed in the world.
        position = position + (truth - position)[:, [BODY.index("head")]]
        turned = np.zeros((len(frames), len(BODY)), dtype=bool)
        for k, name in enumerate(observation.points):
            if name in BODY:
                turned[:, BODY.index(name)] = observation.has_rotation[frames, k]
        log = np.where(measured, LOG_TRACKED, np.log(expected))
        alike = np.where(measured, LOG_ALIKE, np.log(apart))[:, : len(BODY)]
        known = np.concatenate([log, measured, turned, CERTAINTY_SCALE * deviation, alike], axis=1)
        error = np.linalg.norm(position - truth, axis=-1)
        rows.append((known.astype(np.float32), error.astype(np.float32), ~measured))
    known, error, counts = (np.concatenate(column) for column in zip(*rows, strict=True))
    return known, error, counts


_FIT_STEPS, _TRIAL_STEPS = 3000, 100  # optimiser steps of an error map, and of one in a trial


def fit_error_map(
    samples: ErrorSamples, quantile: float | None = None, steps: int = _FIT_STEPS, seed: int = 6
) -> ErrorMap:
    """Fit the mean error, or a quantile of it, to samples, in `steps` optimiser steps.

    Most people were in the training data, and their errors are smaller. The fit learns how errors spread from
    everybody, and how large they are from the other people. For that it reads who was in the training data as one more
    input, which the fitted map does not have: the map assumes unseen people.
    """
    known = torch.from_numpy(np.column_stack([samples.known, samples.learned]).astype(np.float32))
    error = torch.from_numpy(samples.error.astype(np.float32)).clamp(min=1e-4)
    counts = torch.from_numpy(samples.counts.astype(np.float32))
    generator = torch.Generator().manual_seed(seed)
    start = unchanged_errors()
    parts = [torch.tensor(getattr(start, name), dtype=torch.float32) for name in vars(start)]
    parts[:2] = [torch.cat([part, torch.zeros(1, part.shape[1])]) for part in parts[:2]]  # `learned`
    parts[1] = torch.randn(parts[1].shape, generator=generator) * 0.1
    weight, inward, inward_offset, outward, offset = parts = [part.requires_grad_() for part in parts]
    optimizer = torch.optim.AdamW(parts, lr=_RATE, weight_decay=0.0)
    identity = torch.eye(*weight.shape)
    for step in range(steps):
        for group in optimizer.param_groups:
            group["lr"] = _RATE * (1 - step / steps)
        rows = torch.randint(len(known), (_BATCH,), generator=generator)
        x, counted = known[rows], counts[rows]
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


_STREAMS, _BATCHES, _ROUNDING_SEED = 96, 24, 8  # sequences side by side, and batches, that weights are rounded by
_LONGEST, _CLIPS = 9.0, 2  # s of a clip, and clips of a person who was learned from, that errors are judged by


def rounded(body: CompletionNetwork, data: Path, limit: int | None = None, backward: bool = False) -> CompletionNetwork:
    """Return the network with rounded weights, which are true to sequences as in training.

    `limit` clips of the train split suffice for a trial. `backward`: the network is for time that runs backward.
    """
    body = copy.deepcopy(body)
    corpus = read_corpus(data, "train", limit)
    config = CompletionTaskConfig(body.config, streams=_STREAMS, backward=backward)
    task = CompletionTask(body, config, Schedule(), corpus, {})
    drawn = task.batches(np.random.default_rng(_ROUNDING_SEED))
    round_weights(body, sample_moments(body.eval(), itertools.islice(drawn, _BATCHES if limit is None else 1)))
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
    """Write both networks, of which the weights are rounded, with true errors.

    `card` is what they were trained on, and their licence; `limit` and `backward` are those of `rounded`.
    """
    configured = {"network": asdict(body.config), "fingers": asdict(fingers.config)} | card
    start, apart = unchanged_errors(), shown_apart()
    beside = out.with_name(f"{out.stem}.uncalibrated.safetensors")
    try:
        write_weights(TrainedNetworks(body, fingers, start, apart), beside, configured)
        learned, watched = (_scenes(data, split, limit, backward) for split in ("train", "val"))
        samples = sample_errors(learned, watched, load_completion(beside))
    finally:
        beside.unlink(missing_ok=True)
    steps = _FIT_STEPS if limit is None else _TRIAL_STEPS
    mean, bound = fit_error_map(samples, steps=steps), fit_error_map(samples, QUANTILE, steps)
    write_weights(TrainedNetworks(body, fingers, mean, bound), out, configured)


def _scenes(data: Path, split: Split, limit: int | None, backward: bool) -> dict[Truth, list[list[TrackedScene]]]:
    """Return batches of scenes of what wearers do, on their own bodies and on unseen ones.

    Validation people give all their clips; training people give a few each. The former are few, and how far errors
    spread is visible over many people only. Clips of standing people are added in other postures. `backward` puts the
    frames in the opposite order.
    """
    truths: tuple[Truth, ...] = ("own", "stranger")
    scenes: dict[Truth, list[list[TrackedScene]]] = {truth: [] for truth in truths}
    clips = [_piece(clip) for clip in training_clips(data, split, limit) if clip.category in WORN]
    if split == "train":
        clips = _few_of_each_person(clips)
    clips += list(settled_clips(clips))
    for batch in batches(clips):
        for truth in truths:
            found = [scene_of(clip, truth, split) for clip in batch]
            if backward:
                found = [replace(scene, pose=scene.pose[::-1]) for scene in found]
            scenes[truth].append(found)
    return scenes


def _piece(clip: Clip) -> Clip:
    """The middle of a clip."""
    frames = int(np.ceil(_LONGEST * clip.frame_rate))
    first = max(0, (len(clip) - frames) // 2)
    return replace(clip, pose=clip.pose[first : first + frames])


def _few_of_each_person(clips: list[Clip]) -> list[Clip]:
    by_person: dict[str, list[Clip]] = {}
    for clip in clips:
        by_person.setdefault(clip.person, []).append(clip)
    return [clip for own in by_person.values() for clip in own[:: max(1, len(own) // _CLIPS)][:_CLIPS]]
