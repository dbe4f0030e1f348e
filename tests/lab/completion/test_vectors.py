"""Turns, frames and quaternions against independent oracles."""

import numpy as np
import pytest
import roma
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bodysense_lab.completion.vectors import (
    across,
    axes_of,
    carried,
    cross,
    frames,
    heading_of,
    quaternion_between,
    spread,
    turned_onto,
    unit,
)


def vectors(count: int, seed: int) -> torch.Tensor:
    """(1, 1, count, 3)."""
    values = np.random.default_rng(seed).standard_normal((1, 1, count, 3))
    return torch.tensor(values, dtype=torch.float32)


def axes(matrices: np.ndarray) -> torch.Tensor:
    """(N, 3, 3) world ← joint → (1, 3, N, 3)."""
    return torch.tensor(matrices.transpose(2, 0, 1)[None], dtype=torch.float32)


def matrices(of: torch.Tensor) -> torch.Tensor:
    return of[0].permute(1, 2, 0)


def quaternions(rotation: Rotation) -> torch.Tensor:
    return torch.tensor(rotation.as_quat(scalar_first=True)[None], dtype=torch.float32)


def some_rotations() -> Rotation:
    half_turns = Rotation.from_rotvec(np.pi * np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, -0.8, 0]]))
    thirds = Rotation.from_rotvec(2 / 3 * np.pi / np.sqrt(3) * np.array([[1.0, -1, 1], [1, 1, 1]]))
    return Rotation.concatenate(
        [Rotation.identity(1), half_turns, thirds, Rotation.random(300, rng=np.random.default_rng(4))]
    )


def test_the_smallest_turn_is_taken() -> None:
    before, after = vectors(200, 1), vectors(200, 2)
    turned = matrices(turned_onto(axes(np.tile(np.eye(3), (200, 1, 1))), before, after))
    assert torch.allclose((turned @ unit(before)[0, 0, :, :, None])[..., 0], unit(after)[0, 0], atol=1e-4)
    angle = torch.arccos((unit(before) * unit(after)).sum(-1).clamp(-1, 1))[0, 0]
    assert torch.allclose(roma.rotmat_to_rotvec(turned).norm(dim=-1), angle, atol=2e-3)


def test_joints_are_turned_with_what_they_carry() -> None:
    old = some_rotations()[:100].as_matrix()
    before, after = vectors(100, 3), vectors(100, 4)
    turn = matrices(turned_onto(axes(np.tile(np.eye(3), (100, 1, 1))), before, after))
    turned = matrices(turned_onto(axes(old), before, after))
    assert torch.allclose(turned, turn @ torch.tensor(old, dtype=torch.float32), atol=1e-5)


@pytest.mark.parametrize("off", [0.0, 1e-7, 1e-4, 1e-2])
def test_opposite_directions_turn_about_some_axis_across_them(off: float) -> None:
    before = vectors(50, 5)
    after = -before + off * vectors(50, 6)
    turned = matrices(turned_onto(axes(np.tile(np.eye(3), (50, 1, 1))), before, after))
    assert torch.allclose(turned @ turned.mT, torch.eye(3).expand(50, 3, 3), atol=1e-5)
    assert torch.allclose(torch.linalg.det(turned), torch.ones(50), atol=1e-5)
    assert torch.allclose((turned @ unit(before)[0, 0, :, :, None])[..., 0], unit(after)[0, 0], atol=0.03)


def test_bones_without_length_leave_rotations() -> None:
    old = some_rotations()[:20].as_matrix()
    bone = carried(axes(old), spread(torch.zeros(1, 1, 20, 3)))
    for after in (bone, torch.zeros_like(bone), vectors(20, 7)):
        turned = matrices(turned_onto(axes(old), bone, after))
        assert torch.allclose(turned @ turned.mT, torch.eye(3).expand(20, 3, 3), atol=1e-5)
        assert torch.allclose(torch.linalg.det(turned), torch.ones(20), atol=1e-5)
    assert torch.allclose(matrices(turned_onto(axes(old), bone, bone)), torch.tensor(old).float(), atol=1e-4)


def test_quaternions_there_and_back() -> None:
    child, parent = some_rotations(), some_rotations()[::-1]
    assert torch.allclose(matrices(axes_of(quaternions(child))), torch.tensor(child.as_matrix()).float(), atol=1e-6)
    ours = quaternion_between(axes(parent.as_matrix()), axes(child.as_matrix()))[0].numpy()
    wanted = (parent.inv() * child).as_quat(scalar_first=True)
    assert np.minimum(np.abs(ours - wanted).max(axis=1), np.abs(ours + wanted).max(axis=1)).max() < 1e-5
    assert (ours[:, 0] >= 0).all()
    assert np.abs(np.linalg.norm(ours, axis=1) - 1).max() < 1e-6


@given(st.floats(-3.1, 3.1), st.floats(-1.4, 1.4))
def test_a_heading_stays_when_a_head_looks_up(yaw: float, pitch: float) -> None:
    looks = Rotation.from_euler("YX", [[yaw, pitch]])
    cosine, sine = heading_of(axes_of(quaternions(looks)))[0, 0].tolist()
    assert abs(np.angle(np.exp(1j * (np.arctan2(sine, cosine) - yaw)))) < 1e-3


def test_frames_are_orthonormal_and_begin_along_the_first_vector() -> None:
    first, second = vectors(100, 8), vectors(100, 9)
    made = matrices(frames(first, second))
    assert torch.allclose(made @ made.mT, torch.eye(3).expand(100, 3, 3), atol=1e-5)
    assert torch.allclose(torch.linalg.det(made), torch.ones(100), atol=1e-5)
    assert torch.allclose(made[..., 0], unit(first)[0, 0], atol=1e-6)
    assert (made[..., 1] * second[0, 0]).sum(-1).min() > 0
    zhou = roma.special_gramschmidt(torch.stack([first[0, 0], second[0, 0]], dim=-1))
    assert torch.allclose(made, zhou, atol=1e-4)


def test_products_of_vectors() -> None:
    a, b = vectors(30, 10), vectors(30, 11)
    assert torch.allclose(cross(a, b), torch.linalg.cross(a, b), atol=1e-6)
    assert (across(a, unit(b)) * b).sum(-1).abs().max() < 1e-5


def test_bones_go_with_the_joints_that_carry_them() -> None:
    turns, rest = some_rotations()[:40], vectors(40, 12)
    placed = carried(axes(turns.as_matrix()), spread(rest))
    assert np.abs(placed[0, 0].numpy() - turns.apply(rest[0, 0].numpy())).max() < 1e-6
