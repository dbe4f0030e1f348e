"""Arms from directions: bones point along them, elbows are hinges, and weights blend in regressed rotations."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from bodysense.body.arms import ARM_JOINTS, SIDES, arm_skeleton
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import (
    matrix_to_quaternion,
    matrix_to_sixd,
    normalize,
    quaternion_rotate,
    quaternion_to_matrix,
    sixd_to_matrix,
)
from bodysense_lab.papers.pahmt.network import blend_directions, hinged

BONES = torch.tensor(
    arm_skeleton(default_skeleton()).rest_offset[
        [arm_skeleton(default_skeleton()).indices([f"{side}_{end}" for end in ("elbow", "wrist")]) for side in SIDES]
    ]
)


def directions(*batch: int, seed: int = 0) -> torch.Tensor:
    return normalize(torch.randn(*batch, 2, 2, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64))


def turns(*batch: int) -> torch.Tensor:
    noise = torch.randn(*batch, 38, 4, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    return normalize(noise)


def sixd_quaternion(sixd: torch.Tensor) -> torch.Tensor:
    return matrix_to_quaternion(sixd_to_matrix(sixd))


@pytest.mark.parametrize("batch", [(), (5,), (2, 7)])
def test_bones_point_along_the_given_directions(batch: tuple[int, ...]) -> None:
    predicted = directions(*batch)
    base = hinged(predicted)
    assert base.shape == (*batch, 2, 2, 4)
    torch.testing.assert_close(quaternion_rotate(base, normalize(BONES).expand_as(predicted)), predicted)
    predicted_rotation = matrix_to_sixd(quaternion_to_matrix(turns(*batch)))
    local = sixd_quaternion(blend_directions(predicted_rotation, torch.ones(*batch, 2, 2, dtype=torch.float64), base))
    for k, side in enumerate(SIDES):  # down the chain by scipy
        turn = Rotation.identity()
        for place, joint in enumerate(("collar", "shoulder", "elbow")):
            quaternion = local[..., ARM_JOINTS.index(f"{side}_{joint}"), :].reshape(-1, 4)
            turn = turn * Rotation.from_quat(quaternion.numpy(), scalar_first=True)
            if place:
                bone = normalize(BONES)[k, place - 1].numpy()
                np.testing.assert_allclose(turn.apply(bone), predicted[..., k, place - 1, :].reshape(-1, 3), atol=1e-9)


def test_bent_elbows_turn_about_their_hinge_alone() -> None:
    """Upper arms forward, forearms up: the axis lies across."""
    base = hinged(torch.tensor([[0.0, 0, 1], [0, 1, 0]], dtype=torch.float64).expand(2, 2, 3).clone())
    upper, forearm = (Rotation.from_quat(base[0, k].numpy(), scalar_first=True) for k in (0, 1))
    elbow = (upper.inv() * forearm).as_rotvec()
    assert np.degrees(np.linalg.norm(elbow)) == pytest.approx(90, abs=6)  # the bones of rest are not quite in line
    assert elbow[1] / np.linalg.norm(elbow) < -0.95
    np.testing.assert_allclose(np.abs(upper.apply(elbow / np.linalg.norm(elbow))), [1, 0, 0], atol=0.2)


def test_an_arm_of_which_nothing_is_known_hangs_and_gradients_are_finite() -> None:
    predicted = torch.zeros(3, 2, 2, 3, requires_grad=True)
    base = hinged(predicted)
    down = quaternion_rotate(base, normalize(BONES).float().expand(3, 2, 2, 3))
    torch.testing.assert_close(down[..., 1], torch.full((3, 2, 2), -1.0))
    answered = torch.randn(3, 38, 6).requires_grad_()
    gate = torch.full((3, 2, 2), 0.5, requires_grad=True)
    blend_directions(answered, gate, base).square().cumsum(dim=-1).sum().backward()
    for values in (answered, gate):
        assert values.grad is not None and bool(torch.isfinite(values.grad).all())


def test_without_weight_the_regressed_rotation_is_unchanged() -> None:
    rotation = matrix_to_sixd(quaternion_to_matrix(turns(4)))
    base, gate = hinged(directions(4)), torch.zeros(4, 2, 2, dtype=torch.float64)
    torch.testing.assert_close(blend_directions(rotation, gate, base), rotation)
    gate[:, 1, 0] = 1.0
    other = blend_directions(rotation, gate, base)
    moved = {name for k, name in enumerate(ARM_JOINTS) if not torch.allclose(rotation[:, k], other[:, k])}
    assert moved == {"right_shoulder"}
