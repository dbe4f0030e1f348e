"""Turns of palms from their pictures, against the turns that made the pictures."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from bodysense.body.arms import HAND_POINTS, SIDES
from bodysense.body.pose import forward_kinematics, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense_lab.papers.pahmt.features import PALM, palm_turns


def flat_palms() -> np.ndarray:
    """(2, 21, 3) m: hands at rest whose palm points lie in one plane; other points are not used."""
    rest = np.asarray(forward_kinematics(rest_pose(default_skeleton()))[0])
    hands = []
    for side in SIDES:
        hand = rest[default_skeleton().indices([f"{side}_{name}" for name in HAND_POINTS])].copy()
        palm = hand[list(PALM)]
        along = palm[1:].mean(axis=0) - palm[0]
        normal = np.cross(along, palm[1] - palm[-1])
        normal /= np.linalg.norm(normal)
        middle = palm.mean(axis=0)
        hand[list(PALM)] -= ((palm - middle) @ normal)[:, None] * normal
        hands.append(hand)
    return np.array(hands)


def angle(found: torch.Tensor, wanted: Rotation) -> np.ndarray:
    ours = Rotation.from_quat(found.reshape(-1, 4).numpy(), scalar_first=True)
    return (ours.inv() * wanted).magnitude()


@pytest.mark.parametrize("batch", [(), (6,), (3, 4)])
def test_one_solution_is_the_turn_and_the_other_its_mirror_image_in_depth(batch: tuple[int, ...]) -> None:
    rng = np.random.default_rng(len(batch))
    count = int(np.prod(batch, initial=1))
    turn = Rotation.random(2 * count, rng=rng)
    seen = np.einsum("nij,nkj->nki", turn.as_matrix(), np.tile(flat_palms(), (count, 1, 1)))
    picture = rng.uniform(0.2, 3.0) * seen[..., :2] + rng.uniform(-1, 1, 2)
    hand = torch.from_numpy(picture.reshape(*batch, 2, 21, 2))
    found = palm_turns(hand)
    assert found.shape == (*batch, 2, 2, 4)
    apart = np.stack([angle(found[..., k, :], turn) for k in (0, 1)])
    assert np.degrees(apart.min(axis=0)).max() < 0.1  # the palm's plane is that of means: nearly this one
    both = found.reshape(-1, 2, 4).numpy()
    for k in (0, 1):  # either makes the same picture
        again = Rotation.from_quat(both[:, k], scalar_first=True).as_matrix() @ np.tile(
            flat_palms()[:, list(PALM)], (count, 1, 1)
        ).transpose(0, 2, 1)
        again -= again.mean(axis=-1, keepdims=True)
        centred = picture[:, list(PALM)] - picture[:, list(PALM)].mean(axis=1, keepdims=True)
        scale = np.linalg.norm(centred, axis=(1, 2)) / np.linalg.norm(again[:, :2], axis=(1, 2))
        np.testing.assert_allclose(scale[:, None, None] * again[:, :2].transpose(0, 2, 1), centred, atol=2e-3)
    fingers = Rotation.from_quat(both[:, 0], scalar_first=True).apply(
        np.tile((flat_palms()[:, list(PALM)][:, 1:].mean(axis=1) - flat_palms()[:, 0]), (count, 1))
    )
    assert (fingers[:, 2] > -1e-6).all()  # the first answer's lean toward the camera


def test_a_hand_of_one_point_has_a_finite_turn() -> None:
    hand = torch.zeros(3, 2, 21, 2)
    turns = palm_turns(hand)
    torch.testing.assert_close(turns.norm(dim=-1), torch.ones(3, 2, 2))
