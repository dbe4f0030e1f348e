"""Two-bone limbs: they reach what they can, keep their bones, and turn no more than they must."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from scipy.spatial.transform import Rotation

from bodysense.body.rotation import geodesic_angle
from bodysense.estimators.limbs import reach

UPPER, LOWER = 0.3, 0.25
VECTORS = npst.arrays(float, (4, 3), elements=st.floats(-1, 1))


def limbs(bend: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Four limbs along +x, bent about +z by (4,) and turned by rotation vectors (4, 3): bones, rotations, hinges."""
    first = Rotation.from_rotvec(turn)
    second = first * Rotation.from_rotvec(bend[:, None] * np.array([0.0, 0, 1]))
    bones = [first.apply([UPPER, 0, 0]), second.apply([LOWER, 0, 0])]
    rotation = np.stack([one.as_quat(scalar_first=True) for one in (first, second)])
    return *bones, rotation, first.apply([0.0, 0, 1])


def ends(rotation: np.ndarray) -> np.ndarray:
    """(4, 3) where limbs of these rotations end."""
    first, second = (Rotation.from_quat(one, scalar_first=True) for one in rotation)
    return first.apply([UPPER, 0, 0]) + second.apply([LOWER, 0, 0])


@settings(max_examples=100, deadline=None)
@given(bend=npst.arrays(float, 4, elements=st.floats(0, 2.5)), turn=VECTORS, target=VECTORS)
def test_a_limb_ends_at_its_target_or_points_at_it(bend: np.ndarray, turn: np.ndarray, target: np.ndarray) -> None:
    target[np.linalg.norm(target, axis=1) < 0.02] = [0.3, 0.1, 0.0]
    upper, lower, rotation, hinge = limbs(bend, turn)
    turned = reach(upper, lower, target, rotation, hinge)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=-1), 1, atol=1e-12)
    end = ends(turned)
    distance = np.linalg.norm(target, axis=1)
    wanted = np.clip(distance, UPPER - LOWER, UPPER + LOWER)
    np.testing.assert_allclose(end, target * (wanted / distance)[:, None], atol=1e-3)
    bent = (bend > 0.1) & (bend < 2.4)
    np.testing.assert_allclose(end[bent], (target * (wanted / distance)[:, None])[bent], atol=3e-4)


@settings(max_examples=50, deadline=None)
@given(bend=npst.arrays(float, 4, elements=st.floats(0.1, 2.5)), turn=VECTORS)
def test_who_is_there_already_does_not_turn(bend: np.ndarray, turn: np.ndarray) -> None:
    upper, lower, rotation, hinge = limbs(bend, turn)
    turned = reach(upper, lower, upper + lower, rotation, hinge)
    assert geodesic_angle(turned, rotation).max() < 1e-5


def test_a_straight_limb_bends_about_its_hinge() -> None:
    upper, lower, rotation, hinge = limbs(np.zeros(4), np.zeros((4, 3)))
    turned = reach(upper, lower, np.tile([0.4, 0.0, 0.0], (4, 1)), rotation, hinge)
    first = Rotation.from_quat(turned[0], scalar_first=True).apply([UPPER, 0, 0])
    second = Rotation.from_quat(turned[1], scalar_first=True).apply([LOWER, 0, 0])
    assert (np.cross(first, second)[:, 2] > 0.01).all()
    np.testing.assert_allclose(ends(turned), np.tile([0.4, 0, 0], (4, 1)), atol=1e-9)


def test_a_target_behind_is_reached() -> None:
    """Half a turn away, and at the limb's start."""
    upper, lower, rotation, hinge = limbs(np.full(4, 0.5), np.zeros((4, 3)))
    turned = reach(upper, lower, -(upper + lower), rotation, hinge)
    np.testing.assert_allclose(ends(turned), -(upper + lower), atol=1e-6)
    turned = reach(upper, lower, np.zeros((4, 3)), rotation, hinge)
    assert np.isfinite(turned).all()
