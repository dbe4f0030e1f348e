"""Expected errors made true: a small map from what the network expects and what is tracked to the errors that remain.

The network judges its own prediction; measured ends, bent limbs and held feet come after it. Here the exported step
runs on validation people, on bodies that no one trains on, with named and random sensor sets and with all, some or
nothing told, and for every point a line is fitted: log error = a · log expected + b · (what is tracked) + c, with the
likelihood of an exponential, whose optimum is the mean error. A second one is fitted to the 90 % quantile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from rich.progress import track as progress
from torch import Tensor

from bodysense.body.skeleton import BODY
from bodysense.lab.completion.error_map import MASKS, ErrorMap
from bodysense.lab.completion.points import BODY_POINTS, body_places
from bodysense.lab.completion.scenes import BODIES, TRUTH_OF, Body, Scene, Truth, person_of, stacked
from bodysense.lab.completion.tracking import TrackBatch
from bodysense.occlusion.sensors import SENSOR_SETS, TABLE_SETS, SensorSet, random_edges

QUANTILE = 0.9
_STRIDE = 4  # frames: neighbours tell little more
_PULL = 1e-3  # toward a slope of 1 and no offsets
_STEPS = 600
_MOST = 40_000  # frames


@dataclass(frozen=True, eq=False)
class ErrorSamples:
    """What was expected, what was tracked and what came of it, N frames."""

    expected: np.ndarray  # (N, 25) m, as the network judges
    masks: np.ndarray  # (N, 47) bool
    error: np.ndarray  # (N, 25) m
    counts: np.ndarray  # (N, 25) bool: the point was not tracked


def sample_errors(scenes: Mapping[Truth, Sequence[Sequence[Scene]]], run: TrackBatch, seed: int = 5) -> ErrorSamples:
    """Run a step whose expected errors are the network's own over batches of scenes, 'own' and 'stranger'."""
    rng = np.random.default_rng(seed)
    draws: list[tuple[SensorSet, Body]] = [(SENSOR_SETS[name], body) for name in TABLE_SETS for body in BODIES]
    for edge in random_edges(12, rng):
        draws.append((edge.more, BODIES[int(rng.integers(len(BODIES)))]))
    jobs: list[tuple[SensorSet, Body, Sequence[Scene]]] = []
    for sensors, body in draws:
        for batch in scenes[TRUTH_OF[body]]:
            jobs.append((sensors, body, batch))
    parts = [_sampled(*job, run) for job in progress(jobs, "expected and true errors")]
    return ErrorSamples(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _sampled(
    sensors: SensorSet, body: Body, batch: Sequence[Scene], run: TrackBatch
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    seen = [scene.observe(sensors) for scene in batch]
    tracked = run([person_of(body, scene.skeleton) for scene in batch], stacked(seen))
    places = body_places()
    rows = []
    for index, (scene, observation) in enumerate(zip(batch, seen, strict=True)):
        frames = slice(None, len(scene), _STRIDE)
        truth, position = (
            scene.placed[0][frames][:, places],
            tracked.position[index, : len(scene)][::_STRIDE][:, places],
        )
        # The head is where it is measured: what is missed from it is missed in the world.
        position = position + (truth - position)[:, [BODY.index("head")]]
        has = np.zeros((len(truth), MASKS), dtype=bool)
        for k, name in enumerate(observation.points):
            if name in BODY_POINTS:
                has[:, BODY_POINTS.index(name)] = observation.has_position[frames, k]
            if name in BODY:
                has[:, len(BODY_POINTS) + BODY.index(name)] = observation.has_rotation[frames, k]
        error = np.linalg.norm(position - truth, axis=-1)
        expected = tracked.confidence[index, : len(scene)][::_STRIDE][:, places]
        rows.append((expected, has, error, ~has[:, : len(BODY_POINTS)]))
    whole = [np.concatenate(columns) for columns in zip(*rows, strict=True)]
    return whole[0], whole[1], whole[2], whole[3]


def fit_error_map(samples: ErrorSamples, quantile: float | None = None) -> ErrorMap:
    """Fit the mean error, or a quantile of it, to samples, or to so many of them that are spread evenly."""
    every = max(1, len(samples.error) // _MOST)
    samples = ErrorSamples(*(values[::every] for values in vars(samples).values()))
    log = torch.tensor(np.log(np.maximum(samples.expected, 1e-4)), dtype=torch.float32)
    masks = torch.tensor(samples.masks, dtype=torch.float32)
    error = torch.tensor(samples.error, dtype=torch.float32).clamp(min=1e-4)
    counts = torch.tensor(samples.counts, dtype=torch.float32)
    points = log.shape[1]
    slope = torch.ones(points, requires_grad=True)
    weight = torch.zeros(MASKS, points, requires_grad=True)
    offset = torch.zeros(points, requires_grad=True)
    optimizer = torch.optim.Adam([slope, weight, offset], lr=0.02)
    for step in range(_STEPS):
        for group in optimizer.param_groups:
            group["lr"] = 0.02 * (1 - step / _STEPS)
        expected = slope * log + masks @ weight + offset
        loss = _likelihood(expected, error) if quantile is None else _pinball(expected, error, quantile)
        total = (loss * counts).sum() / counts.sum()
        total = total + _PULL * ((slope - 1).square().mean() + weight.square().mean())
        optimizer.zero_grad()
        total.backward()
        optimizer.step()
    return ErrorMap(*(part.detach().numpy().copy() for part in (slope, weight, offset)))


def _likelihood(log_expected: Tensor, error: Tensor) -> Tensor:
    return error * torch.exp(-log_expected) + log_expected


def _pinball(log_bound: Tensor, error: Tensor, quantile: float) -> Tensor:
    missed = torch.log(error) - log_bound
    return torch.maximum(quantile * missed, (quantile - 1) * missed)
