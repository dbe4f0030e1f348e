"""Losses of the body's and the fingers' networks: weighted terms, each a mean over frames and joints or points."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from bodysense.body.skeleton import BODY
from bodysense_lab.completion.data.batches import HandBatch, SequenceBatch
from bodysense_lab.completion.data.points import BODY_POINTS, CONTACT, HEAD, JOINTS
from bodysense_lab.completion.networks.fingers import finger_positions, with_measured
from bodysense_lab.completion.networks.network import CompletionNetwork, Prediction, orthonormal

_FEET = [BODY.index(name) for name in CONTACT]
# Weights of a joint's rotation and position, relative to other joints. Recorded rotations of feet are unreliable.
# Wearers see their own elbows and shoulders, and few tracked points determine these.
_TURN_WEIGHT = {"ankle": 0.6, "foot": 0.3, "collar": 1.5, "shoulder": 2.0, "elbow": 2.5}
_PLACE_WEIGHT = {"shoulder": 1.5, "elbow": 2.0}
SLACK = 0.6  # m/s; a joint may be faster than the true one by this at no cost


@dataclass(frozen=True)
class Losses:
    """Weights of the terms of the body's loss, at the reference stature."""

    rotation: float = 1.3  # mean absolute difference of rotation matrices in the frame under the head
    local: float = 0.5  # mean absolute difference of rotation matrices relative to the parent joint
    position: float = 8.0  # per metre, mean absolute difference of positions relative to the head
    velocity: float = 0.4  # per m/s, mean absolute difference of velocities
    haste: float = 16.0  # per m/s by which a joint is faster than the true one, beyond `SLACK`
    skate: float = 0.1  # per m/s, of feet that truly stand
    contact: float = 0.03  # cross-entropy
    error: float = 0.01  # `laplace_loss` of the expected error


@dataclass(frozen=True)
class FingerLosses:
    """Weights of the terms of the loss of both hands."""

    rotation: float = 1.0  # mean absolute difference of matrices wrist ← joint
    position: float = 24.0  # per metre, mean absolute difference of positions relative to the wrist
    velocity: float = 0.4  # per m/s, mean absolute difference of velocities
    error: float = 0.01  # `laplace_loss` of the expected error


def losses(
    network: CompletionNetwork, prediction: Prediction, batch: SequenceBatch, weights: Losses
) -> dict[str, Tensor]:
    """Return the weighted terms of the body's loss and their sum, 'loss'."""
    signal, valid = batch.signal, batch.valid
    size = signal.size[:, None, None, None]
    error, rotation, true_rotation = prediction_errors(network, prediction, batch)
    both = valid[:, 1:] & valid[:, :-1]
    turn_weight = size.new_tensor([_TURN_WEIGHT.get(name.rpartition("_")[2], 1.0) for name in BODY])
    place_weight = size.new_tensor([_PLACE_WEIGHT.get(name.rpartition("_")[2], 1.0) for name in BODY_POINTS])
    angle = (rotation - true_rotation).abs().mean(dim=(-2, -1)) * turn_weight
    parents = network.bone_parents[: JOINTS - 1]
    local, true_local = (turned[..., parents, :, :].mT @ turned[..., 1:, :, :] for turned in (rotation, true_rotation))
    local_error = (local - true_local).abs().mean(dim=(-2, -1)) * turn_weight[1:]
    terms = {
        "rotation": mean_over(valid, angle) * weights.rotation,
        "local": mean_over(valid, local_error.sum(dim=-1, keepdim=True) / JOINTS) * weights.local,
        "position": mean_over(valid, error.abs().mean(dim=-1) * place_weight) * weights.position,
    }
    # The network predicts the position of a head that is not tracked.
    place = (batch.true_position[..., HEAD : HEAD + 1, :] - signal.origin[..., None, :]) @ signal.turn / size
    lost = ~signal.has_position[..., HEAD, None]
    terms["head"] = mean_over(valid, (prediction.head - place[..., 0, :]).abs() * lost) * weights.position * 0.3

    world = error @ signal.turn.mT
    velocity_error = (world[:, 1:] - world[:, :-1]) / signal.interval[:, 1:, None, None]
    terms["velocity"] = mean_over(both, velocity_error.abs()) * weights.velocity
    true_step = (batch.true_position[:, 1:] - batch.true_position[:, :-1]) / size
    output_step, interval = true_step + world[:, 1:] - world[:, :-1], signal.interval[:, 1:, None]
    excess_speed = (length(output_step) - length(true_step)) / interval - SLACK / size[..., 0]
    terms["haste"] = mean_over(both, excess_speed.clamp_min(0.0)) * weights.haste
    standing = (batch.contact[:, 1:] * batch.contact[:, :-1]) * both[..., None]
    skate = (length(velocity_error[..., _FEET, :]) * standing).sum() / standing.sum().clamp(min=1)
    terms["skate"] = skate * weights.skate
    contact = binary_cross_entropy_with_logits(prediction.contact_logit, batch.contact, reduction="none")
    terms["contact"] = mean_over(valid, contact) * weights.contact
    terms["error"] = mean_over(valid, laplace_loss(error, prediction.error)) * weights.error
    return with_sum(terms)


def prediction_errors(
    network: CompletionNetwork, prediction: Prediction, batch: SequenceBatch
) -> tuple[Tensor, Tensor, Tensor]:
    """Return position errors (B, T, 25, 3) and rotations (B, T, 22, 3, 3), predicted and true.

    Positions are relative to the head, at the reference stature. Everything is in the frame under the head. Measured
    rotations replace predicted ones.
    """
    signal = batch.signal
    measured, true_rotation = (
        signal.turn.mT[..., None, :, :] @ turned for turned in (signal.rotation, batch.true_rotation)
    )
    rotation = torch.where(signal.has_rotation[..., None, None], measured, orthonormal(prediction.axes))
    position = network.places(rotation, signal.rest_offset / signal.size[:, None, None])
    truth = batch.true_position - batch.true_position[..., HEAD : HEAD + 1, :]
    return position - truth @ signal.turn / signal.size[:, None, None, None], rotation, true_rotation


def finger_losses(rotation: Tensor, expected: Tensor, hands: HandBatch, weights: FingerLosses) -> dict[str, Tensor]:
    """Return the weighted terms and their sum, 'loss'.

    Args:
        rotation: (B, T, 2, 15, 3, 3) predicted rotations, wrist ← joint.
        expected: (B, T, 2, 20) predicted errors, m.
        hands: tracked points and the truth.
        weights: weights of the terms.
    """
    signal, valid = hands.signal, hands.valid
    rotation = with_measured(rotation, signal)
    error = finger_positions(rotation, signal.rest_offset) - hands.true_position
    velocity_error = (error[:, 1:] - error[:, :-1]) / signal.interval[:, 1:, None, None, None]
    terms = {
        "rotation": mean_over(valid, (rotation - hands.true_rotation).abs()) * weights.rotation,
        "position": mean_over(valid, error.abs()) * weights.position,
        "velocity": mean_over(valid[:, 1:] & valid[:, :-1], velocity_error.abs()) * weights.velocity,
        "error": mean_over(valid, laplace_loss(error, expected)) * weights.error,
    }
    return with_sum(terms)


def mean_over(frames: Tensor, values: Tensor) -> Tensor:
    """Return the mean of values (B, T, ...) over the frames with a true mask (B, T)."""
    return (values.flatten(2).mean(dim=-1) * frames).sum() / frames.sum().clamp(min=1)


def laplace_loss(error: Tensor, expected: Tensor) -> Tensor:
    """Return the negative log-likelihood (...) of errors (..., 3) under a Laplace law with expected distances (...).

    The best expected distance is the mean distance. No gradient reaches the positions.
    """
    return length(error.detach()) / expected + torch.log(expected)


def with_sum(terms: dict[str, Tensor]) -> dict[str, Tensor]:
    """Return the terms and their sum, 'loss'."""
    return {"loss": torch.stack(list(terms.values())).sum(), **terms}


def length(vector: Tensor) -> Tensor:
    """Return the length (...) of vectors (..., K), with a finite gradient at 0."""
    return torch.sqrt((vector * vector).sum(dim=-1) + 1e-10)
