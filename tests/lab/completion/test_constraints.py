"""Turns, frames and limbs against independent oracles."""

import numpy as np
import roma
import torch
from scipy.spatial.transform import Rotation

from bodysense.lab.completion.constraints import bent_limbs, frame_of, turned_onto
from bodysense.lab.completion.graph import quaternion_of


def vectors(count: int, seed: int) -> torch.Tensor:
    return torch.tensor(np.random.default_rng(seed).standard_normal((count, 3)), dtype=torch.float32)


def test_the_smallest_turn_is_taken() -> None:
    before, after = vectors(200, 1), vectors(200, 2)
    turned = turned_onto(torch.eye(3).expand(200, 3, 3), before, after)
    unit = torch.nn.functional.normalize
    assert torch.allclose((turned @ unit(before)[..., None])[..., 0], unit(after), atol=1e-3)
    angle = torch.arccos((unit(before) * unit(after)).sum(-1).clamp(-1, 1))
    assert torch.allclose(roma.rotmat_to_rotvec(turned).norm(dim=-1), angle, atol=2e-3)


def test_opposite_directions_give_a_rotation() -> None:
    before = vectors(50, 3)
    turned = turned_onto(torch.eye(3).expand(50, 3, 3), before, -before)
    assert torch.allclose(turned @ turned.mT, torch.eye(3).expand(50, 3, 3), atol=1e-5)
    assert torch.allclose(torch.linalg.det(turned), torch.ones(50), atol=1e-5)


def test_quaternions_are_those_of_scipy() -> None:
    rotations = Rotation.random(500, rng=np.random.default_rng(4))
    half_turns = Rotation.from_rotvec(np.pi * np.eye(3))
    matrices = np.concatenate([rotations.as_matrix(), half_turns.as_matrix()])
    ours = quaternion_of(torch.tensor(matrices, dtype=torch.float32)).numpy()
    back = Rotation.from_quat(ours[:, [1, 2, 3, 0]]).as_matrix()
    assert np.abs(back - matrices).max() < 1e-5
    assert (ours[:, 0] >= 0).all()


def test_frames_are_orthonormal_and_begin_along_the_first_vector() -> None:
    first, second = vectors(100, 5), vectors(100, 6)
    rows = frame_of(first, second)
    assert torch.allclose(rows @ rows.mT, torch.eye(3).expand(100, 3, 3), atol=1e-5)
    assert torch.allclose(rows[:, 0], torch.nn.functional.normalize(first), atol=1e-5)


def limbs(count: int = 300):
    """Limbs of two bones and targets within and beyond their reach."""
    start, pole = vectors(count, 7), vectors(count, 8)
    upper, lower = 0.3 + 0.1 * torch.rand(count, 1), 0.3 + 0.1 * torch.rand(count, 1)
    unit = torch.nn.functional.normalize
    middle = start + upper * unit(vectors(count, 9))
    end = middle + lower * unit(vectors(count, 10))
    target = start + unit(vectors(count, 11)) * (0.15 + 0.8 * torch.rand(count, 1))
    return (one[None] for one in (start, middle, end, target, start + pole))


def test_limbs_reach_what_they_can_and_keep_their_bones() -> None:
    start, middle, end, target, pole = limbs()
    natural = torch.nn.functional.normalize(vectors(300, 12))[None]
    bias, one_sided = torch.full((1, 300, 1), 0.02), torch.ones(1, 300, 1)
    new_middle, new_end = bent_limbs(start, middle, end, target, pole, natural, bias, one_sided)
    for a, b, c, d in ((start, middle, start, new_middle), (middle, end, new_middle, new_end)):
        assert torch.allclose((b - a).norm(dim=-1), (d - c).norm(dim=-1), atol=1e-4)
    far, reach = (target - start).norm(dim=-1), (middle - start).norm(dim=-1) + (end - middle).norm(dim=-1)
    near = (far < 0.999 * reach) & (far > ((middle - start).norm(dim=-1) - (end - middle).norm(dim=-1)).abs() + 2e-3)
    assert near.sum() > 100
    assert torch.allclose(new_end[near], target[near], atol=1e-4)
    # Beyond its reach a limb points at its target.
    along = torch.nn.functional.normalize(new_end - start, dim=-1)
    toward = torch.nn.functional.normalize(target - start, dim=-1)
    assert torch.allclose(along, toward, atol=1e-4)
    # The middle joint never goes behind its natural side.
    side = new_middle - start
    assert ((side - along * (side * along).sum(-1, keepdim=True)) * natural).sum(-1).min() > -1e-4
