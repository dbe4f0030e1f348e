"""Upright stance: feet keep their positions, a standing body moves as a whole, seated and walking bodies hardly."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.geometry.rotation import matrix_to_quaternion, quaternion_exp, quaternion_multiply, quaternion_to_matrix
from bodysense_lab.completion.data.corpus import Corpus
from bodysense_lab.completion.data.postures.limbs import bend_limb, hips_of, limb_of
from bodysense_lab.completion.data.postures.upright import HIPS_AHEAD, set_upright, stance_shifts

RATE, FRAMES = 30.0, 120
OFFSET = default_skeleton().rest_offset
ANKLES = [BODY.index(f"{side}_ankle") for side in ("left", "right")]


def stooping(ahead: float, heading: float, speed: float = 0.0, lowered: float = 0.04) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (T, 22, 4) and pelvis path (T, 3) m of a body whose pelvis is `ahead` m in front of its feet."""
    turn = quaternion_exp(np.array([0.0, heading, 0.0]))
    standing = np.asarray(forward_kinematics(standing_pose(default_skeleton()))[1])[: len(BODY)]
    rotation = np.tile(quaternion_multiply(turn, standing), (FRAMES, 1, 1))
    forward = np.array([np.sin(heading), 0.0, np.cos(heading)])
    feet = np.array([0.0, OFFSET[0, 1], 0.0]) + (np.arange(FRAMES) / RATE * speed)[:, None] * forward
    root = feet + ahead * forward - [0.0, lowered, 0.0]
    matrix = quaternion_to_matrix(rotation)
    for k, side in enumerate(("left", "right")):
        limb = limb_of("leg", side, OFFSET)
        hips = hips_of(matrix[:, 0], OFFSET)[:, k]
        ankle = feet + hips + [0.0, -OFFSET[0, 1] - hips[0, 1] + 0.09, 0.0]
        bent = bend_limb(limb, root + hips, ankle, np.tile(forward, (FRAMES, 1)))
        matrix[:, limb.first], matrix[:, limb.second] = bent
    return matrix_to_quaternion(matrix), root


def ankles(rotation: np.ndarray, root: np.ndarray) -> np.ndarray:
    matrix, places = quaternion_to_matrix(rotation), []
    for k, side in enumerate(("left", "right")):
        limb = limb_of("leg", side, OFFSET)
        hips = root + hips_of(matrix[:, 0], OFFSET)[:, k]
        places.append(hips + matrix[:, limb.first] @ limb.upper + matrix[:, limb.second] @ limb.lower)
    return np.stack(places, axis=1)


@pytest.mark.parametrize("heading", [0.0, 1.2, -2.7])
def test_a_standing_body_moves_back_over_unchanged_feet(heading: float) -> None:
    rotation, root = stooping(0.08, heading)
    after, path = set_upright(rotation, root, OFFSET, -0.06, np.ones((FRAMES, 2), dtype=bool), RATE)
    moved, forward = path - root, np.array([np.sin(heading), 0.0, np.cos(heading)])
    np.testing.assert_allclose(moved @ forward, -0.06, atol=1e-6)
    assert (moved[:, 1] >= 0).all() and moved[:, 1].max() > 0.01
    np.testing.assert_allclose(ankles(after, path), ankles(rotation, root), atol=2e-3)
    others = [k for k, name in enumerate(BODY) if name.rpartition("_")[2] not in ("hip", "knee")]
    assert np.abs(quaternion_to_matrix(after[:, others]) - quaternion_to_matrix(rotation[:, others])).max() < 1e-6


def test_walking_bodies_move_by_a_quarter_and_low_ones_not() -> None:
    rotation, root = stooping(0.08, 0.0, speed=1.2)
    planted = np.zeros((FRAMES, 2), dtype=bool)
    path = set_upright(rotation, root, OFFSET, -0.06, planted, RATE)[1]
    np.testing.assert_allclose((path - root)[:, 2], -0.015, atol=1e-6)
    low, seat = stooping(0.08, 0.0, lowered=0.35)
    path = set_upright(low, seat, OFFSET, -0.06, np.ones((FRAMES, 2), dtype=bool), RATE)[1]
    np.testing.assert_allclose(path, seat, atol=1e-9)


def test_the_shift_begins_and_ends_smoothly() -> None:
    rotation, root = stooping(0.08, 0.0)
    planted = np.ones((FRAMES, 2), dtype=bool)
    planted[40:80, 0] = False
    moved = set_upright(rotation, root, OFFSET, -0.06, planted, RATE)[1] - root
    assert np.ptp(moved[:, 2]) > 0.04
    assert np.abs(np.diff(moved[:, 2])).max() * RATE < 0.15  # m/s


def corpus_of_stance(person: str, ahead: float) -> Corpus:
    rotation, root = stooping(ahead, 0.7)
    return Corpus(
        rotation=rotation.astype(np.float32),
        root=root.astype(np.float32),
        visible=np.zeros((FRAMES, 65), dtype=bool),
        fingers=np.zeros((0, 30, 4), dtype=np.float32),
        rest_offset=OFFSET[None].astype(np.float32),
        start=np.array([0]),
        length=np.array([FRAMES]),
        rate=np.array([RATE]),
        finger_start=np.array([-1]),
        name=np.array([f"{person}/clip"]),
        category=np.array(["everyday"]),
    )


@pytest.mark.parametrize(("ahead", "shift"), [(0.10, -0.06), (0.02, 0.0), (0.2, -0.09)])
def test_the_shift_of_a_person_is_measured_in_still_frames(ahead: float, shift: float) -> None:
    measured = stance_shifts(corpus_of_stance("a", ahead))
    scale = 0.95 / OFFSET[0, 1]
    wanted = np.clip(HIPS_AHEAD - ahead * scale, -0.09, 0.0)
    np.testing.assert_allclose(measured, wanted, atol=2e-3)
    assert measured[0] == pytest.approx(shift, abs=0.012)
