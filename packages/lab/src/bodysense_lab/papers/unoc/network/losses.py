"""The losses of UNOC, section 4.2: position, kinematics, occlusion; and the expected error that IK weighs by."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from bodysense_lab.papers.unoc.network.network import BodyNetwork, BodyPrediction
from bodysense_lab.papers.unoc.sequences.body_sequences import BodyBatch


@dataclass(frozen=True)
class LossWeights:
    """Weights of the paper's losses (section 4.2). Terms are means over points, in metres at the reference height."""

    body: float = 10.0
    finger: float = 100.0
    parent: float = 3.0
    body_bone: float = 7.0
    finger_bone: float = 10.0
    occluded: float = 1.2  # factor on the position terms of hidden points
    occlusion: float = 0.025
    expected_error: float = 0.01
    sums: bool = False  # bones and occlusion are sums over points, as the paper prints L_kin and L_occ


def body_loss(model: BodyNetwork, answer: BodyPrediction, truth: BodyBatch, weights: LossWeights) -> dict[str, Tensor]:
    """The weighted terms and their sum, 'loss'. Distances are Euclidean; terms that a clip cannot teach are masked."""
    points, device = len(model.skeleton.points), truth.offset.device
    is_finger = torch.zeros(points, dtype=torch.bool, device=device)
    is_finger[model.finger] = True
    counted = torch.ones(points, dtype=torch.bool, device=device)
    counted[model.head] = False
    mask = truth.valid[..., None] & counted & (~is_finger | truth.fingers[:, None, None])
    count = mask.sum().clamp(min=1)
    # Sums over points are averaged over frames.
    frames = truth.valid.sum().clamp(min=1) if weights.sums else count

    emphasis = 1 + (weights.occluded - 1) * (~truth.visible).float()
    distance = length_of(answer.offset - truth.offset)
    position_weight = torch.where(is_finger, weights.finger, weights.body)
    position = (distance * position_weight * emphasis * mask).sum() / count

    bone, true_bone = (bones(model, offset) for offset in (answer.offset, truth.offset))
    parent = (length_of(bone - true_bone) * emphasis * mask).sum() / frames * weights.parent
    bone_weight = torch.where(is_finger, weights.finger_bone, weights.body_bone)
    length = ((length_of(bone) - length_of(true_bone)).abs() * bone_weight * mask).sum() / frames

    cross_entropy = torch.nn.functional.binary_cross_entropy_with_logits(
        answer.hidden_logit, (~truth.visible).float(), reduction="none"
    )
    occlusion = (cross_entropy * mask).sum() / frames * weights.occlusion
    expected = (unlikelihood(distance, answer.error) * mask).sum() / count * weights.expected_error
    terms = {"position": position, "parent": parent, "bone": length, "occlusion": occlusion, "expected": expected}
    return {"loss": torch.stack(list(terms.values())).sum(), **terms}


def bones(model: BodyNetwork, offset: Tensor) -> Tensor:
    """Vectors from every point's parent to the point, in the network's frame: (B, T, P, 3)."""
    parents = [max(parent, 0) for parent in model.skeleton.parents]
    at_wrist = [parent == model.origin[point] and point in model.finger for point, parent in enumerate(parents)]
    from_parent = offset - offset[..., parents, :]
    return torch.where(torch.tensor(at_wrist, device=offset.device)[:, None], offset, from_parent)


def length_of(vector: Tensor) -> Tensor:
    """Lengths of vectors (..., 3), with a slope at zero."""
    return torch.sqrt((vector * vector).sum(dim=-1) + 1e-12)


def unlikelihood(distance: Tensor, expected: Tensor) -> Tensor:
    """By Laplace's distribution: its optimum is the mean absolute error. The error itself is not pulled by it."""
    return (distance.detach() + 1e-4) / expected + torch.log(expected)
