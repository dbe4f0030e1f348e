"""Samples of true and expected errors of the tracker: recorded people, random signals, scripted scenes.

Bounds must hold for people, signals and scenes that were not in training. Each source therefore has a share of the
samples, however many frames it has.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.progress import track as progress

from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split
from bodysense.tracking.model import CompletionModel
from bodysense.tracking.tracker import Tracker
from bodysense_lab.completion.data.points import body_indices
from bodysense_lab.completion.data.postures.posture_clips import posture_clips
from bodysense_lab.completion.data.signal_kinds import TRAINING_SIGNALS, draw_signal, observed_set
from bodysense_lab.completion.kinds.lattice import random_edges
from bodysense_lab.completion.networks.error_map import (
    CERTAINTY_SCALE,
    LOG_TRACKED_DISAGREEMENT,
    LOG_TRACKED_ERROR,
)
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
from bodysense_lab.completion.training.task import HEADSET_CATEGORIES
from bodysense_lab.core.scoring import RATE
from bodysense_lab.data.clips import training_clips
from bodysense_lab.synthesis.scenes import KINDS, sequence

# Shares of the samples: usual sensors and random signals on recorded people, and both on scripted scenes. Half of usual
# sensors: bounds of random signals hold for 76 % of their joints instead of 80 %. `positions` are sets without any
# rotation: as a twentieth of the signals alone, their expected errors are 0.4 of the true ones.
SHARES = {"usual": 0.35, "signals": 0.35, "positions": 0.1, "scenes": 0.2}
# Random sets besides the usual ones: from the lattice of sensors, and of any kind, each on a few scenes. With 60 sets
# on 32 scenes each, the map underrates errors of sets that it has not read by two fifths.
_EDGES, _SIGNALS, _POSITIONS, _FEW = 100, 300, 60, 6
_SCENES, _SECONDS = 3, 9.0  # scripted scenes of each kind, and their duration, s
_STRIDE = 4  # frames between samples; neighbouring frames are alike
_LONGEST, _CLIPS = 9.0, 2  # s of a clip, and clips of each training person


@dataclass(frozen=True, eq=False)
class ErrorSamples:
    """Inputs of the error map and measured errors, N frames."""

    inputs: np.ndarray  # (N, 119) float32: see `error_map.INPUTS`
    error: np.ndarray  # (N, 25) float32 m
    untracked: np.ndarray  # (N, 25) bool: the point was not tracked
    rarity: np.ndarray  # (N,) factor of the core's bounds: more than 1 in rare poses
    in_training: np.ndarray  # (N,) bool: the motion is in the training data
    weight: np.ndarray  # (N,) how often a sample is read; all weights add up to 1


@dataclass(frozen=True, eq=False)
class SampledScenes:
    """Batches of scenes whose errors are sampled."""

    recorded: dict[tuple[Truth, bool], list[list[TrackedScene]]]  # by body, and whether the people are in training
    scripted: list[list[TrackedScene]]


@dataclass(frozen=True, eq=False)
class _Job:
    """A batch of scenes to track."""

    source: str  # of `SHARES`
    sensors: SensorSet
    body: Body
    batch: Sequence[TrackedScene]
    in_training: bool


def sample_errors(scenes: SampledScenes, model: CompletionModel, seed: int = 5) -> ErrorSamples:
    """Run the tracker over batches of scenes, and sample its errors.

    `model` must return the network's own expected errors (`identity_map`) and, instead of their bounds, the distance
    between the network's two answers (`disagreement_map`).
    """
    jobs = list(_jobs(scenes, np.random.default_rng(seed)))
    parts = []
    for job in progress(jobs, "expected and true errors"):
        columns = _sample_batch(job.sensors, job.body, job.batch, model)
        parts.append((*columns, np.full(len(columns[0]), job.in_training)))
    counts = dict.fromkeys(SHARES, 0)
    for job, part in zip(jobs, parts, strict=True):
        counts[job.source] += len(part[0])
    present = sum(SHARES[name] for name, count in counts.items() if count)
    weight = [
        np.full(len(part[0]), SHARES[job.source] / present / counts[job.source])
        for job, part in zip(jobs, parts, strict=True)
    ]
    inputs, error, untracked, rarity, in_training = (np.concatenate(column) for column in zip(*parts, strict=True))
    return ErrorSamples(inputs, error, untracked, rarity, in_training, np.concatenate(weight))


def _jobs(scenes: SampledScenes, rng: np.random.Generator) -> Iterator[_Job]:
    """Yield scenes to track: a batch of each source for each of the usual sensors and bodies, a few for each signal."""

    def drawn(batches: list[list[TrackedScene]], count: int | None = None) -> list[TrackedScene]:
        batch = batches[int(rng.integers(len(batches)))]
        few = rng.permutation(len(batch))[:count]
        return [batch[index] for index in sorted(few)]

    usual: list[tuple[SensorSet, Body]] = [(SENSOR_SETS[name], body) for name in TABLE_SETS for body in BODIES]
    edges = [edge.more for edge in random_edges(_EDGES, rng)]
    signals = [*edges, *(draw_signal(rng, TRAINING_SIGNALS) for _ in range(_SIGNALS))]
    positions = [
        *(replace(SENSOR_SETS[name], rotation=()) for name in TABLE_SETS if SENSOR_SETS[name].position),
        *(draw_signal(rng, replace(TRAINING_SIGNALS, shares={"positions": 1.0})) for _ in range(_POSITIONS)),
    ]

    def observed(sets: list[SensorSet]) -> list[tuple[SensorSet, Body]]:
        return [(observed_set(each), BODIES[int(rng.integers(len(BODIES)))]) for each in sets]

    kinds: list[tuple[str, list[tuple[SensorSet, Body]], int | None]] = [
        ("usual", usual, None),
        ("signals", observed(signals), _FEW),
        ("positions", observed(positions), _FEW),
    ]
    for source, pairs, count in kinds:
        for sensors, body in pairs:
            for (truth, in_training), found in scenes.recorded.items():
                if truth == TRUTH_OF[body]:
                    yield _Job(source, sensors, body, drawn(found, count), in_training)
            yield _Job("scenes", sensors, body, drawn(scenes.scripted, count), in_training=False)


def _sample_batch(
    sensors: SensorSet, body: Body, batch: Sequence[TrackedScene], model: CompletionModel
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
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
        rarity = np.where(measured, 1.0, disagreement)[:, len(BODY) :].max(axis=1)  # see `disagreement_map`
        disagreement = disagreement[:, : len(BODY)] / rarity[:, None]
        log_disagreement = np.where(measured[:, : len(BODY)], LOG_TRACKED_DISAGREEMENT, np.log(disagreement))
        inputs = np.concatenate([log, measured, turned, CERTAINTY_SCALE * deviation, log_disagreement], axis=1)
        error = np.linalg.norm(position - truth, axis=-1)
        rows.append((inputs.astype(np.float32), error.astype(np.float32), ~measured, rarity))
    inputs, error, untracked, rarity = (np.concatenate(column) for column in zip(*rows, strict=True))
    return inputs, error, untracked, rarity


def sampled_scenes(data: Path, limit: int | None, backward: bool, seed: int = 9) -> SampledScenes:
    """Return scenes of motions of headset wearers, on their own bodies and on unseen ones, and scripted ones.

    All clips of validation people are used, and a few of each training person: the distribution of errors needs many
    people, and validation people are few. Clips of standing people are added in other postures. Scripted scenes have
    the ranges of training and another seed. `limit` is a number of clips of each split, for a trial; `backward`
    reverses time.
    """
    truths: tuple[Truth, ...] = ("own", "stranger")
    splits: tuple[Split, ...] = ("train", "val")
    recorded: dict[tuple[Truth, bool], list[list[TrackedScene]]] = {}
    for split in splits:
        wearers = (clip for clip in training_clips(data, split, limit) if clip.category in HEADSET_CATEGORIES)
        clips: list[Clip] = []
        for clip in wearers:
            frames = int(np.ceil(_LONGEST * clip.frame_rate))
            first = max(0, (len(clip) - frames) // 2)  # the middle of a longer clip
            clips.append(replace(clip, pose=clip.pose[first : first + frames]))
        if split == "train":  # few of each person
            by_person: dict[str, list[Clip]] = {}
            for clip in clips:
                by_person.setdefault(clip.person, []).append(clip)
            clips = [clip for of in by_person.values() for clip in of[:: max(1, len(of) // _CLIPS)][:_CLIPS]]
        clips += list(posture_clips(clips))
        for truth in truths:
            found = [[scene_of(clip, truth, split) for clip in batch] for batch in batches(clips)]
            recorded[truth, split == "train"] = [_reversed(batch) if backward else batch for batch in found]
    rng = np.random.default_rng(seed)
    scripted = []
    for _ in range(_SCENES if limit is None else 1):
        drawn = (sequence(rng, round(_SECONDS * RATE), RATE, kind=kind) for kind in KINDS)
        batch = [TrackedScene(kind, "main", one.pose) for kind, one in zip(KINDS, drawn, strict=True)]
        scripted.append(_reversed(batch) if backward else batch)
    return SampledScenes(recorded, scripted)


def _reversed(batch: Sequence[TrackedScene]) -> list[TrackedScene]:
    return [replace(scene, pose=scene.pose[::-1]) for scene in batch]
