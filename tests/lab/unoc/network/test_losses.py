"""The losses against sums written out by hand, with the weights of UNOC, section 4.2."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from bodysense.body.skeleton import default_skeleton
from bodysense_lab.papers.unoc.network.losses import LossWeights, body_loss
from bodysense_lab.papers.unoc.network.network import BodyNetwork, BodyNetworkConfig, BodyPrediction
from bodysense_lab.papers.unoc.sequences.body_sequences import BodyBatch

SKELETON = default_skeleton()
POINTS = len(SKELETON.points)
FINGERS = ("index", "middle", "pinky", "ring", "thumb")
FINGER = np.array([any(f"_{finger}" in name for finger in FINGERS) for name in SKELETON.points])
WRIST = {side: SKELETON.index(f"{side}_wrist") for side in ("left", "right")}


@pytest.fixture(scope="module")
def network() -> BodyNetwork:
    torch.manual_seed(0)
    return BodyNetwork(BodyNetworkConfig(hidden=4, branch=(4,)), SKELETON)


def example(seed: int, frames: int = 3, batch: int = 2) -> tuple[BodyPrediction, BodyBatch]:
    generator = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    offset = random(batch, frames, POINTS, 3)
    answer = BodyPrediction(
        offset + 0.1 * random(batch, frames, POINTS, 3),
        random(batch, frames, POINTS),
        torch.rand(batch, frames, POINTS, generator=generator) + 0.01,
    )
    visible = random(batch, frames, POINTS) > 0
    nothing, every = torch.zeros(batch, frames, 0), torch.ones(batch, frames, dtype=torch.bool)
    return answer, BodyBatch(nothing, nothing, offset, visible, every, every[:, 0], every[:, 0])


def length(vector: np.ndarray) -> float:
    return float(np.linalg.norm(vector))


def by_hand(answer: BodyPrediction, truth: BodyBatch) -> dict[str, float]:
    """Point by point, with the numbers of reproduce.md 1.7 written out."""
    terms = dict.fromkeys(("position", "parent", "bone", "occlusion", "expected"), 0.0)
    count = 0
    for b, t, p in np.ndindex(*truth.visible.shape):
        name = SKELETON.points[p]
        if name == "head" or not truth.valid[b, t] or (FINGER[p] and not truth.fingers[b]):
            continue
        count += 1
        predicted, true = (part.offset[b, t].detach().numpy().astype(float) for part in (answer, truth))
        hidden = not truth.visible[b, t, p]
        more = 1.2 if hidden else 1.0
        distance = length(predicted[p] - true[p])
        terms["position"] += (100 if FINGER[p] else 10) * more * distance
        parent = max(SKELETON.parents[p], 0)
        # Fingers are offsets from the wrist, so that the wrist itself is their zero.
        base = parent not in WRIST.values() or not FINGER[p]
        bone, true_bone = ((x[p] - x[parent]) if base else x[p] for x in (predicted, true))
        terms["parent"] += 3 * more * length(bone - true_bone)
        terms["bone"] += (10 if FINGER[p] else 7) * abs(length(bone) - length(true_bone))
        share = 1 / (1 + math.exp(-float(answer.hidden_logit[b, t, p])))
        terms["occlusion"] += 0.025 * -math.log(share if hidden else 1 - share)
        error = float(answer.error[b, t, p])
        terms["expected"] += 0.01 * (distance / error + math.log(error))
    return {name: value / count for name, value in terms.items()}


def test_against_sums_by_hand(network) -> None:
    answer, truth = example(1)
    truth = truth._replace(fingers=torch.tensor([True, False]), valid=torch.tensor([[True, True, False], [True] * 3]))
    terms = body_loss(network, answer, truth, LossWeights())
    expected = by_hand(answer, truth)
    for name, value in expected.items():
        # The expected error keeps clear of zero by 0.1 mm, so it is a little higher.
        assert float(terms[name]) == pytest.approx(value, rel=1e-3 if name == "expected" else 1e-4, abs=1e-4), name
    assert float(terms["loss"]) == pytest.approx(sum(expected.values()), rel=1e-3)


def test_sums_over_joints_are_means_over_frames(network) -> None:
    """L_kin and L_occ as printed: as many times the mean as points are counted in a frame."""
    answer, truth = example(0, frames=2, batch=1)
    mean, summed = (body_loss(network, answer, truth, LossWeights(sums=sums)) for sums in (False, True))
    for name in ("parent", "bone", "occlusion"):
        assert float(summed[name]) == pytest.approx(float(mean[name]) * (POINTS - 1), rel=1e-4), name
    for name in ("position", "expected"):
        assert float(summed[name]) == pytest.approx(float(mean[name])), name


def test_the_expected_error_learns_the_mean_error_and_pulls_on_nothing_else(network) -> None:
    answer, truth = example(6)
    only = LossWeights(0, 0, 0, 0, 0, 1, 0, expected_error=1.0)
    distance = torch.linalg.norm(answer.offset - truth.offset, dim=-1)
    error = distance.mean().expand_as(distance).clone().requires_grad_(True)
    offset = answer.offset.clone().requires_grad_(True)
    body_loss(network, answer._replace(offset=offset, error=error), truth, only)["loss"].backward()
    assert offset.grad is None or not offset.grad.any()
    assert error.grad is not None
    counted = torch.ones(POINTS, dtype=torch.bool)
    counted[SKELETON.index("head")] = False
    assert abs(float(error.grad[..., counted].sum())) < 0.02 / float(distance.mean())  # a minimum, but for the head


def test_gradients_are_finite_at_the_truth(network) -> None:
    """Distances have no slope at zero; the losses must have one."""
    answer, truth = example(7)
    offset = truth.offset.clone().requires_grad_(True)
    body_loss(network, answer._replace(offset=offset), truth, LossWeights())["loss"].backward()
    assert offset.grad is not None and torch.isfinite(offset.grad).all()
