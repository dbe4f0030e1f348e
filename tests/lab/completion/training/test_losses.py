"""Losses of the completion network, compared with loops in plain NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense_lab.completion.data.batches import SequenceBatch
from bodysense_lab.completion.data.points import BODY_POINTS, CONTACT, HEAD
from bodysense_lab.completion.networks.features import Before, TrackedSignal
from bodysense_lab.completion.networks.network import (
    CompletionConfig,
    CompletionNetwork,
    Prediction,
)
from bodysense_lab.completion.training.losses import SLACK, Losses, losses

BATCH, FRAMES, JOINTS, POINTS = 2, 4, len(BODY), len(BODY_POINTS)
TURN_WEIGHT = {"ankle": 0.6, "foot": 0.3, "collar": 1.5, "shoulder": 2.0, "elbow": 2.5}
PLACE_WEIGHT = {"shoulder": 1.5, "elbow": 2.0}
FEET = [BODY.index(name) for name in CONTACT]
WHOLE = default_skeleton()
ABOVE = {name: WHOLE.points[WHOLE.parents[WHOLE.index(name)]] for name in BODY_POINTS[1:]}
PARENT = [-1, *(BODY_POINTS.index(ABOVE[name]) for name in BODY_POINTS[1:])]


def of_part(weights: dict[str, float], name: str) -> float:
    return weights.get(name.rpartition("_")[2], 1.0)


def random_case(seed: int) -> tuple[Prediction, SequenceBatch]:
    """Return random numbers: no rotation is tracked, the head in some frames, one frame is padding."""
    rng = np.random.default_rng(seed)

    def number(*shape: int, scale: float = 1.0) -> torch.Tensor:
        return torch.from_numpy(rng.normal(scale=scale, size=(BATCH, *shape))).float()

    def turned(*shape: int) -> torch.Tensor:
        count = BATCH * int(np.prod(shape))
        return torch.from_numpy(Rotation.random(count, rng).as_matrix().reshape(BATCH, *shape, 3, 3)).float()

    def some(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.random((BATCH, *shape)) < 0.5)

    angles = rng.uniform(-np.pi, np.pi, BATCH * FRAMES)
    turn = Rotation.from_rotvec(angles[:, None] * [0.0, 1.0, 0.0]).as_matrix().reshape(BATCH, FRAMES, 3, 3)
    valid = np.ones((BATCH, FRAMES), dtype=bool)
    valid[1, -1] = False
    signal = TrackedSignal(
        position=number(FRAMES, 27, 3),
        rotation=turned(FRAMES, JOINTS),
        has_position=some(FRAMES, 27),
        has_rotation=torch.zeros(BATCH, FRAMES, JOINTS, dtype=torch.bool),
        accuracy=number(FRAMES, 27).abs(),
        interval=0.02 + 0.02 * number(FRAMES).abs(),
        turn=torch.from_numpy(turn).float(),
        origin=number(FRAMES, 3),
        before=Before(number(FRAMES, 27, 3), some(FRAMES, 27), turned(FRAMES, 3), some(FRAMES, 3)),
        rest_offset=number(POINTS, 3, scale=0.2),
        certainty=number(POINTS).abs(),
        size=1 + 0.1 * number(),
        acceleration=number(FRAMES, 12, 3),
        has_acceleration=some(FRAMES, 12),
    )
    batch = SequenceBatch(
        signal=signal,
        true_position=number(FRAMES, POINTS, 3),
        true_rotation=turned(FRAMES, JOINTS),
        contact=some(FRAMES, 4).float(),
        valid=torch.from_numpy(valid),
        begins=torch.ones(BATCH, dtype=torch.bool),
    )
    axes = turned(FRAMES, JOINTS)[..., :2]  # orthonormal columns, which define the rotation without Gram-Schmidt
    return Prediction(axes, number(FRAMES, 3), number(FRAMES, 4), 0.01 + number(FRAMES, POINTS).abs()), batch


def direct_losses(prediction: Prediction, batch: SequenceBatch, weights: Losses) -> dict[str, float]:
    """Compute the terms frame by frame and joint by joint."""
    signal = batch.signal

    def n(values: torch.Tensor) -> Any:
        return values.double().numpy() if values.is_floating_point() else values.numpy()

    sums = dict.fromkeys(
        ("rotation", "local", "position", "head", "velocity", "haste", "skate", "contact", "error"), 0.0
    )
    frames = pairs = standing = 0.0
    for b in range(BATCH):
        size, before = float(signal.size[b]), None
        for t in range(FRAMES):
            turn, valid = n(signal.turn)[b, t], bool(batch.valid[b, t])
            first, second = n(prediction.axes)[b, t, :, :, 0], n(prediction.axes)[b, t, :, :, 1]
            predicted = np.stack([first, second, np.cross(first, second)], axis=-1)
            true_rotation = np.stack([turn.T @ matrix for matrix in n(batch.true_rotation)[b, t]])
            place = np.zeros((POINTS, 3))
            for k in range(1, POINTS):
                place[k] = place[PARENT[k]] + predicted[PARENT[k]] @ (n(signal.rest_offset)[b, k] / size)
            place = place - place[HEAD]
            true = n(batch.true_position)[b, t]
            error = place - (true - true[HEAD]) @ turn / size
            world = error @ turn.T
            if valid:
                frames += 1
                for j, name in enumerate(BODY):
                    weight = of_part(TURN_WEIGHT, name)
                    sums["rotation"] += weight * np.abs(predicted[j] - true_rotation[j]).mean() / JOINTS
                    if j:
                        bent = predicted[PARENT[j]].T @ predicted[j] - true_rotation[PARENT[j]].T @ true_rotation[j]
                        sums["local"] += weight * np.abs(bent).mean() / JOINTS
                for k, name in enumerate(BODY_POINTS):
                    sums["position"] += of_part(PLACE_WEIGHT, name) * np.abs(error[k]).mean() / POINTS
                    far, expected = np.linalg.norm(error[k]), n(prediction.error)[b, t, k]
                    sums["error"] += (far / expected + np.log(expected)) / POINTS
                if not signal.has_position[b, t, HEAD]:
                    there = (true[HEAD] - n(signal.origin)[b, t]) @ turn / size
                    sums["head"] += np.abs(n(prediction.head)[b, t] - there).mean()
                for contact, logit in zip(n(batch.contact)[b, t], n(prediction.contact_logit)[b, t], strict=True):
                    sums["contact"] += np.log1p(np.exp(-logit if contact else logit)) / 4
            if before is not None and valid and batch.valid[b, t - 1]:
                pairs += 1
                velocity_error = (world - before) / float(signal.interval[b, t])
                sums["velocity"] += np.abs(velocity_error).mean()
                step = (true - n(batch.true_position)[b, t - 1]) / float(signal.interval[b, t]) / size
                excess_speed = (
                    np.linalg.norm(step + velocity_error, axis=-1) - np.linalg.norm(step, axis=-1) - SLACK / size
                )
                sums["haste"] += np.maximum(excess_speed, 0.0).mean()
                for k, foot in enumerate(FEET):
                    if batch.contact[b, t, k] and batch.contact[b, t - 1, k]:
                        standing += 1
                        sums["skate"] += float(np.linalg.norm(velocity_error[foot]))
            before = world
    shares = {name: frames for name in sums} | {"velocity": pairs, "haste": pairs, "skate": standing}
    factors = vars(weights) | {"head": 0.3 * weights.position}
    return {name: factors[name] * sums[name] / shares[name] for name in sums}


def test_every_term_equals_a_direct_computation() -> None:
    torch.manual_seed(0)
    network = CompletionNetwork(CompletionConfig(hidden=8, branch=8, judge_branch=8))
    weights = Losses(rotation=1.1, local=0.7, position=3.0, velocity=0.5, haste=0.6, skate=0.2, contact=0.3, error=0.4)
    for seed in range(3):
        prediction, batch = random_case(seed)
        terms = losses(network, prediction, batch, weights)
        expected = direct_losses(prediction, batch, weights)
        expected["loss"] = sum(expected.values())
        assert terms.keys() == expected.keys()
        for name, value in expected.items():
            np.testing.assert_allclose(float(terms[name]), value, rtol=2e-4, err_msg=name)
