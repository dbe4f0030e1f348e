"""From trained weights to the packaged file: expected errors made true, then one .onnx with its card."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.progress import track as progress
from torch import Tensor

from bodysense.body.skeleton import BODY
from bodysense.completion.model import CompletionModel, load_completion
from bodysense.devices.simulated.sensors import SENSOR_SETS, TABLE_SETS, SensorSet, random_edges
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split
from bodysense.lab.completion.error_map import CERTAINTY_SCALE, LOG_TRACKED, ErrorMap, unchanged_errors
from bodysense.lab.completion.export import write_completion
from bodysense.lab.completion.fingers import FingerNetwork
from bodysense.lab.completion.graph import CompletionStep
from bodysense.lab.completion.network import CompletionNetwork
from bodysense.lab.completion.options import BODIES, Body
from bodysense.lab.completion.points import body_places
from bodysense.lab.completion.rounding import round_weights, sample_moments
from bodysense.lab.completion.scenes import TRUTH_OF, TrackedScene, Truth, batches, person_of, scene_of, stacked
from bodysense.lab.completion.task import WORN
from bodysense.lab.datasets import learned_clips
from bodysense.tracker import Tracker

QUANTILE = 0.9
_STRIDE = 4  # frames: neighbours tell little more
_BATCH, _RATE = 2048, 5e-3  # of the fit
_PULL = 1e-4  # toward errors as expected


@dataclass(frozen=True, eq=False)
class ErrorSamples:
    """What was known, and what came of it, N frames."""

    known: np.ndarray  # (N, 97) float32: log of errors expected by the network (25), what is tracked, certainty
    error: np.ndarray  # (N, 25) float32 m
    counts: np.ndarray  # (N, 25) bool: the point was not tracked


def sample_errors(
    scenes: Mapping[Truth, Sequence[Sequence[TrackedScene]]], model: CompletionModel, seed: int = 5
) -> ErrorSamples:
    """Run a step whose expected errors are the network's own over batches of scenes, 'own' and 'stranger'."""
    rng = np.random.default_rng(seed)
    draws: list[tuple[SensorSet, Body]] = [(SENSOR_SETS[name], body) for name in TABLE_SETS for body in BODIES]
    for edge in random_edges(12, rng):
        draws.append((edge.more, BODIES[int(rng.integers(len(BODIES)))]))
    jobs: list[tuple[SensorSet, Body, Sequence[TrackedScene]]] = []
    for sensors, body in draws:
        for batch in scenes[TRUTH_OF[body]]:
            jobs.append((sensors, body, batch))
    parts = [_sampled(*job, model) for job in progress(jobs, "expected and true errors")]
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
        alike = (estimate.points[:, 0, places], estimate.confidence[:, 0, places], estimate.measured[:, 0, places])
        if t % _STRIDE == 0:
            parts.append((t, *alike, state.proportions.deviation[:, places]))
    rows = []
    for index, (scene, observation) in enumerate(zip(batch, seen, strict=True)):
        own = [part for part in parts if part[0] < len(scene)]
        frames = [part[0] for part in own]
        position, expected, measured, deviation = (np.stack([part[k][index] for part in own]) for k in range(1, 5))
        truth = scene.placed[0][frames][:, places]
        # The head is where it is measured: what is missed from it is missed in the world.
        position = position + (truth - position)[:, [BODY.index("head")]]
        turned = np.zeros((len(frames), len(BODY)), dtype=bool)
        for k, name in enumerate(observation.points):
            if name in BODY:
                turned[:, BODY.index(name)] = observation.has_rotation[frames, k]
        log = np.where(measured, LOG_TRACKED, np.log(expected))
        known = np.concatenate([log, measured, turned, CERTAINTY_SCALE * deviation], axis=1)
        error = np.linalg.norm(position - truth, axis=-1)
        rows.append((known.astype(np.float32), error.astype(np.float32), ~measured))
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)]
    return columns[0], columns[1], columns[2]


_FIT_STEPS, _TRIAL_STEPS = 3000, 100  # optimiser steps of an error map, and of one in a trial


def fit_error_map(
    samples: ErrorSamples, quantile: float | None = None, steps: int = _FIT_STEPS, seed: int = 6
) -> ErrorMap:
    """Fit the mean error, or a quantile of it, to samples, in so many steps of an optimiser."""
    known = torch.from_numpy(samples.known.astype(np.float32))
    error = torch.from_numpy(samples.error.astype(np.float32)).clamp(min=1e-4)
    counts = torch.from_numpy(samples.counts.astype(np.float32))
    generator = torch.Generator().manual_seed(seed)
    start = unchanged_errors()
    parts = [torch.tensor(getattr(start, name), dtype=torch.float32) for name in vars(start)]
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
        loss = _likelihood(expected, error[rows]) if quantile is None else _pinball(expected, error[rows], quantile)
        total = (loss * counted).sum() / counted.sum()
        pull = (weight - identity).square().sum() + inward.square().sum() + outward.square().sum()
        optimizer.zero_grad()
        (total + _PULL * pull).backward()
        optimizer.step()
    return ErrorMap(*(part.detach().numpy().copy() for part in parts))


def _likelihood(log_expected: Tensor, error: Tensor) -> Tensor:
    return error * torch.exp(-log_expected) + log_expected


def _pinball(log_bound: Tensor, error: Tensor, quantile: float) -> Tensor:
    missed = torch.log(error) - log_bound
    return torch.maximum(quantile * missed, (quantile - 1) * missed)


_LONGEST, _CLIPS = 9.0, 2  # s of a clip, and clips of a person who was learned from, that errors are judged by


def publish(
    body: CompletionNetwork,
    fingers: FingerNetwork,
    data: Path,
    out: Path,
    card: dict[str, Any],
    limit: int | None = None,
) -> None:
    """Write the whole step, its weights rounded, with true errors; `card`: what it was trained on, and its licence.

    `limit` clips of each split suffice for a trial.
    """
    body = copy.deepcopy(body)
    start = unchanged_errors()
    beside = out.with_name(f"{out.stem}.uncalibrated.onnx")
    try:
        _write(body, fingers, start, start, beside, {})
        step = CompletionStep(body, fingers, start, start).eval()
        round_weights(body, sample_moments(step, _scenes(data, ("train",), limit), load_completion(beside)))
        _write(body, fingers, start, start, beside, {})
        samples = sample_errors(_scenes(data, ("train", "val"), limit), load_completion(beside))
    finally:
        beside.unlink(missing_ok=True)
    steps = _FIT_STEPS if limit is None else _TRIAL_STEPS
    mean, bound = fit_error_map(samples, steps=steps), fit_error_map(samples, QUANTILE, steps)
    _write(body, fingers, mean, bound, out, card)


def _write(
    body: CompletionNetwork,
    fingers: FingerNetwork,
    mean: ErrorMap,
    bound: ErrorMap,
    out: Path,
    card: dict[str, Any],
) -> None:
    configured = {"network": asdict(body.config), "fingers": asdict(fingers.config)}
    write_completion(CompletionStep(body, fingers, mean, bound), out, {**configured, **card})


def _scenes(data: Path, splits: tuple[Split, ...], limit: int | None) -> dict[Truth, list[list[TrackedScene]]]:
    """Batches of scenes of what wearers do, on their own bodies and on strangers'.

    Of people that were watched all clips, and of people that were learned from a few each: the former are few, and how
    far errors spread shows in many people only.
    """
    truths: tuple[Truth, ...] = ("own", "stranger")
    scenes: dict[Truth, list[list[TrackedScene]]] = {truth: [] for truth in truths}
    for split in splits:
        clips = [_piece(clip) for clip in learned_clips(data, split, limit) if clip.category in WORN]
        if split == "train":
            clips = _few_of_each_person(clips)
        for batch in batches(clips):
            for truth in truths:
                scenes[truth].append([scene_of(clip, truth, split) for clip in batch])
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
