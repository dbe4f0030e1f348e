"""Unity's axes, against SciPy and against known rotations of a head."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.formats.unity import from_unity_rotation, unity_euler, unity_position, unity_rotation
from bodysense_live.protocols.driver_axes import driver_rotation, from_driver_rotation

MIRROR = np.diag([-1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def turns() -> Rotation:
    return Rotation.from_quat(np.random.default_rng(1).normal(size=(500, 4)))


def ours(turns: Rotation) -> np.ndarray:
    return turns.as_quat()[:, [3, 0, 1, 2]]


def test_a_rotation_is_mirrored(turns: Rotation) -> None:
    theirs = Rotation.from_quat(unity_rotation(ours(turns))).as_matrix()
    np.testing.assert_allclose(theirs, MIRROR @ turns.as_matrix() @ MIRROR, atol=1e-12)
    np.testing.assert_allclose(from_unity_rotation(unity_rotation(ours(turns))), ours(turns), atol=0)


def test_the_x_axis_is_mirrored_and_the_z_axis_is_unchanged() -> None:
    np.testing.assert_array_equal(unity_position(np.array([0.7, 1.4, 0.2])), [-0.7, 1.4, 0.2])


def test_euler_angles_are_applied_about_z_then_x_then_y(turns: Rotation) -> None:
    x, y, z = unity_euler(ours(turns)).T
    about_fixed_axes = Rotation.from_euler("zxy", np.stack([z, x, y], axis=1), degrees=True)
    np.testing.assert_allclose(about_fixed_axes.as_matrix(), MIRROR @ turns.as_matrix() @ MIRROR, atol=1e-9)
    assert np.abs(x).max() <= 90 + 1e-9


@pytest.mark.parametrize(
    ("vector", "angles"),
    [
        ((0, 0, 0), (0, 0, 0)),
        ((0, -np.pi / 2, 0), (0, 90, 0)),  # to the right: in Unity from +Z toward +X
        ((np.pi / 6, 0, 0), (30, 0, 0)),  # looking down
        ((0, 0, -np.pi / 4), (0, 0, 45)),  # the head leans to its left: Unity's +Y goes toward −X
    ],
)
def test_turning_looking_down_and_leaning(vector: tuple[float, ...], angles: tuple[float, ...]) -> None:
    np.testing.assert_allclose(unity_euler(quaternion_exp(np.array(vector))), angles, atol=1e-9)


def test_forward_is_minus_z_in_a_drivers_axes(turns: Rotation) -> None:
    """SteamVR's devices look along −Z; the up axis is unchanged."""
    theirs = Rotation.from_quat(driver_rotation(ours(turns)))
    for of_theirs, of_ours in (([0, 0, -1.0], [0, 0, 1.0]), ([0, 1.0, 0], [0, 1.0, 0]), ([-1.0, 0, 0], [1.0, 0, 0])):
        np.testing.assert_allclose(theirs.apply(of_theirs), turns.apply(of_ours), atol=1e-12)
    back = Rotation.from_quat(from_driver_rotation(driver_rotation(ours(turns))), scalar_first=True)
    np.testing.assert_allclose((back * turns.inv()).magnitude(), 0, atol=1e-7)
