"""Losses of the body's and of the fingers' network: weighted terms, each a mean over frames and joints or points."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from bodysense.body.skeleton import BODY
from bodysense_lab.completion.batches import HandBatch, SequenceBatch
from bodysense_lab.completion.fingers import finger_positions, with_measured
from bodysense_lab.completion.network import CompletionNetwork, Prediction, orthonormal
from bodysense_lab.completion.points import BODY_POINTS, CONTACT, HEAD, JOINTS

_FEET = [BODY.index(name) for name in CONTACT]
# Weight of a joint's rotation relative to other joints, and of its position. Recorded rotations of feet are unreliable.
# Wearers see their own elbows and shoulders, and few tracked points determine them.
_TURN_WEIGHT = {"ankle": 0.6, "foot": 0.3, "collar": 1.5, "shoulder": 2.0, "elbow": 2.5}
_PLACE_WEIGHT = {"shoulder": 1.5, "elbow": 2.0}
SLACK = 0.6  # m/s


@dataclass(frozen=True)
class Losses:
    """Weights of the terms of the body, at the reference stature."""

    rotation: float = 1.3  # mean absolute difference of matrices, of rotations from the frame under the head
    local: float = 0.5  # the same of rotations from the parent joint
    position: float = 8.0  # per metre, mean absolute difference from the head
    velocity: float = 0.4  # per m/s
    haste: float = 16.0  # per m/s by which a joint is faster than the true one, beyond `SLACK`
    skate: float = 0.1  # per m/s, of feet that truly stand
    contact: float = 0.03  # cross-entropy
    error: float = 0.01  # likelihood of the expected error


@dataclass(frozen=True)
class FingerLosses:
    """Weights of the terms of both hands."""

    rotation: float = 1.0  # mean absolute difference of matrices wrist ← joint
    position: float = 24.0  # per metre, mean absolute difference from the wrist
    velocity: float = 0.4  # per m/s
    error: float = 0.01  # likelihood of the expected error


def losses(
    network: CompletionNetwork, prediction: Prediction, batch: SequenceBatch, weights: Losses
) -> dict[str, Tensor]:
    """The sum, 'loss', and its weighted terms."""
    signal, valid = batch.signal, batch.valid
    size = signal.size[:, None, None, None]
    missed, rotation, wanted = missed_by(network, prediction, batch)
    both = valid[:, 1:] & valid[:, :-1]
    turn_weight = torch.tensor([_TURN_WEIGHT.get(name.rpartition("_")[2], 1.0) for name in BODY])
    place_weight = torch.tensor([_PLACE_WEIGHT.get(name.rpartition("_")[2], 1.0) for name in BODY_POINTS])
    angle = (rotation - wanted).abs().mean(dim=(-2, -1)) * turn_weight
    parents = network.bone_parents[: JOINTS - 1]
    local, true_local = (turned[..., parents, :, :].mT @ turned[..., 1:, :, :] for turned in (rotation, wanted))
    bent = (local - true_local).abs().mean(dim=(-2, -1)) * turn_weight[1:]
    terms = {
        "rotation": mean_over(valid, angle) * weights.rotation,
        "local": mean_over(valid, bent.sum(dim=-1, keepdim=True) / JOINTS) * weights.local,
        "position": mean_over(valid, missed.abs().mean(dim=-1) * place_weight) * weights.position,
    }
    # Where the head is not tracked, the network says where it is.
    place = (batch.true_position[..., HEAD : HEAD + 1, :] - signal.origin[..., None, :]) @ signal.turn / size
    lost = ~signal.has_position[..., HEAD, None]
    terms["head"] = mean_over(valid, (prediction.head - place[..., 0, :]).abs() * lost) * weights.position * 0.3

    world = missed @ signal.turn.mT
    too_fast = (world[:, 1:] - world[:, :-1]) / signal.interval[:, 1:, None, None]
    terms["velocity"] = mean_over(both, too_fast.abs()) * weights.velocity
    true_step = (batch.true_position[:, 1:] - batch.true_position[:, :-1]) / size
    shown_step, interval = true_step + world[:, 1:] - world[:, :-1], signal.interval[:, 1:, None]
    faster = (length(shown_step) - length(true_step)) / interval - SLACK / size[..., 0]
    terms["haste"] = mean_over(both, faster.clamp_min(0.0)) * weights.haste
    standing = (batch.contact[:, 1:] * batch.contact[:, :-1]) * both[..., None]
    skating = (length(too_fast[..., _FEET, :]) * standing).sum() / standing.sum().clamp(min=1)
    terms["skate"] = skating * weights.skate
    contact = binary_cross_entropy_with_logits(prediction.contact_logit, batch.contact, reduction="none")
    terms["contact"] = mean_over(valid, contact) * weights.contact
    terms["error"] = mean_over(valid, unlikelihood(missed, prediction.error)) * weights.error
    return with_sum(terms)


def missed_by(
    network: CompletionNetwork, prediction: Prediction, batch: SequenceBatch
) -> tuple[Tensor, Tensor, Tensor]:
    """Errors of positions from the head (B, T, 25, 3), and rotations in the frame under it, predicted and true.

    Measured rotations take the place of predicted ones.
    """
    signal = batch.signal
    measured, wanted = (signal.turn.mT[..., None, :, :] @ turned for turned in (signal.rotation, batch.true_rotation))
    rotation = torch.where(signal.has_rotation[..., None, None], measured, orthonormal(prediction.axes))
    position = network.places(rotation, signal.rest_offset / signal.size[:, None, None])
    truth = batch.true_position - batch.true_position[..., HEAD : HEAD + 1, :]
    return position - truth @ signal.turn / signal.size[:, None, None, None], rotation, wanted


def finger_losses(rotation: Tensor, error: Tensor, hands: HandBatch, weights: FingerLosses) -> dict[str, Tensor]:
    """The sum, 'loss', and its weighted terms.

    Args:
        rotation: (B, T, 2, 15, 3, 3) wrist ← joint, as predicted.
        error: (B, T, 2, 20) m, as expected.
        hands: what was tracked, and the truth.
        weights: of the terms.
    """
    signal, valid = hands.signal, hands.valid
    rotation = with_measured(rotation, signal)
    missed = finger_positions(rotation, signal.rest_offset) - hands.true_position
    too_fast = (missed[:, 1:] - missed[:, :-1]) / signal.interval[:, 1:, None, None, None]
    terms = {
        "rotation": mean_over(valid, (rotation - hands.true_rotation).abs()) * weights.rotation,
        "position": mean_over(valid, missed.abs()) * weights.position,
        "velocity": mean_over(valid[:, 1:] & valid[:, :-1], too_fast.abs()) * weights.velocity,
        "error": mean_over(valid, unlikelihood(missed, error)) * weights.error,
    }
    return with_sum(terms)


def mean_over(frames: Tensor, values: Tensor) -> Tensor:
    """Return the mean of values (B, T, ...) over the frames (B, T) that count."""
    return (values.flatten(2).mean(dim=-1) * frames).sum() / frames.sum().clamp(min=1)


def unlikelihood(missed: Tensor, expected: Tensor) -> Tensor:
    """Return the negative logarithm of a Laplace likelihood (...) of misses (..., 3), given expected distances.

    Its optimum is the mean distance. The positions are not pulled by it.
    """
    return length(missed.detach()) / expected + torch.log(expected)


def with_sum(terms: dict[str, Tensor]) -> dict[str, Tensor]:
    """Return the sum of weighted terms, 'loss', and the terms."""
    return {"loss": torch.stack(list(terms.values())).sum(), **terms}


def length(vector: Tensor) -> Tensor:
    """Length (...) of vectors (..., K), whose gradient is finite where it is 0."""
    return torch.sqrt((vector * vector).sum(dim=-1) + 1e-10)
