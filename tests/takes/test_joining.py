"""Joining of two passes without the network: shares by certainty, and hidden frames that lead to a return."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import geodesic_angle, mean_rotation, quaternion_exp
from bodysense.takes.joining import BACKWARD_SHARE, LEAD, future_share, lead_to_returns

SECONDS = 1 / 30
FRAMES, RETURN = 90, 50  # a wrist is hidden until it is seen again in this frame
SKELETON = default_skeleton()
WRIST, ELBOW, KNEE = (SKELETON.index(name) for name in ("left_wrist", "left_elbow", "left_knee"))


@pytest.mark.parametrize("times", [1.0, 2.0, 8.0])
def test_the_more_certain_pass_counts_more(times: float) -> None:
    past = np.full((FRAMES, len(SKELETON.points)), 0.05)
    share = future_share(past, past / times, SECONDS)
    other = future_share(past / times, past, SECONDS)
    np.testing.assert_allclose(share, share[0])
    if times == 1:
        np.testing.assert_allclose(share, BACKWARD_SHARE)
    assert share[0] >= BACKWARD_SHARE >= other[0]
    np.testing.assert_allclose(share + other, 2 * BACKWARD_SHARE)


def test_shares_change_slowly() -> None:
    past, future = np.full((2, FRAMES, len(SKELETON.points)), 0.05)
    future[45:] = 0.005
    share = future_share(past, future, SECONDS)
    assert share[0] == pytest.approx(BACKWARD_SHARE) and share[-1] > 0.95
    assert np.diff(share).min() >= 0 and np.diff(share).max() < 0.1


def leaping() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rotations (T, J, 4) of an elbow that jumps when its wrist is seen again, heads, and seen points."""
    rotation = np.zeros((FRAMES, len(SKELETON.joints), 4))
    rotation[..., 0] = 1
    rotation[RETURN:, ELBOW] = quaternion_exp(np.array([0.0, 1.0, 0.0]))
    seen = np.ones((FRAMES, len(SKELETON.points)), dtype=bool)
    seen[:RETURN, WRIST] = False
    return rotation, np.zeros((FRAMES, 3)), seen


def test_hidden_frames_lead_to_a_return() -> None:
    rotation, head, seen = leaping()
    found, _ = lead_to_returns(rotation, head, seen, SECONDS)
    steps = geodesic_angle(found[1:, ELBOW], found[:-1, ELBOW])
    assert steps.max() < 0.15 < geodesic_angle(rotation[1:, ELBOW], rotation[:-1, ELBOW]).max()
    np.testing.assert_array_equal(found[RETURN:], rotation[RETURN:])
    early = RETURN - round(2 * LEAD / SECONDS) - 15
    np.testing.assert_array_equal(found[:early], rotation[:early])
    np.testing.assert_array_equal(found[:, KNEE], rotation[:, KNEE])


def test_points_seen_in_all_frames_are_unchanged() -> None:
    rotation, head, seen = leaping()
    found, _ = lead_to_returns(rotation, head, np.ones_like(seen), SECONDS)
    np.testing.assert_array_equal(found, rotation)


def test_the_mean_of_rotations_is_between_them() -> None:
    a, b = quaternion_exp(np.array([[0.2, 0.0, 0.0], [0.8, 0.0, 0.0]]))
    for share in (0.0, 0.5, 1.0):
        assert geodesic_angle(mean_rotation(a, -b, share), a) == pytest.approx(0.6 * share, abs=1e-6)


def test_a_return_is_reached_at_a_joints_fastest_speed() -> None:
    """An elbow that spins at 18 rad/s on both sides of a jump enters it at 9 rad/s, which no person exceeds."""
    spin, jump = np.array([0.0, 18.0 * SECONDS, 0.0]), np.array([0.0, 1.0, 0.0])
    rotation, head, seen = leaping()
    angle = np.arange(FRAMES)[:, None] * spin + (np.arange(FRAMES) >= RETURN)[:, None] * jump
    rotation[:, ELBOW] = quaternion_exp(angle)
    found, _ = lead_to_returns(rotation, head, seen, SECONDS)
    into = geodesic_angle(found[RETURN, ELBOW], found[RETURN - 1, ELBOW])
    assert into == pytest.approx(9.0 * SECONDS, rel=0.02)
