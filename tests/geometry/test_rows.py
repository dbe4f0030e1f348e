"""Rotations of rows by the compiled core: the bits of the functions that they stand in for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.geometry import rotation

FUNCTIONS: list[tuple[Callable[..., np.ndarray], tuple[int, ...]]] = [
    (rotation.quaternion_multiply, (4, 4)),
    (rotation.quaternion_rotate, (4, 3)),
    (rotation.shortest_arc, (3, 3)),
    (rotation.quaternion_to_matrix, (4,)),
    (rotation.normalize, (1,)),
    (rotation.normalize, (3,)),
    (rotation.normalize, (7,)),
    (rotation.dot, (4, 4)),
]
SHAPES = [((), ()), ((0,), (0,)), ((7,), ()), ((), (7,)), ((5, 1), (1, 6)), ((4,), (3, 4)), ((2, 3, 4), (2, 3, 4))]
SPECIAL = np.array([0.0, -0.0, 1.0, -1.0, 0.8, 1e-13, 1e-200, 1e200, np.inf, np.nan])


def by_numpy(function: Callable[..., np.ndarray], *arrays: np.ndarray) -> np.ndarray:
    with pytest.MonkeyPatch.context() as patch, np.errstate(all="ignore"):
        patch.setattr(rotation, "are_doubles", lambda *arrays: False)
        return function(*arrays)


def layouts(values: np.ndarray) -> list[np.ndarray]:
    """Return equal arrays that lie in memory in other ways."""
    between = np.full((*values.shape[:-1], 3, values.shape[-1] + 2), np.nan)
    between[..., 1, 1:-1] = values
    reverse = values[::-1].copy()[::-1] if values.ndim > 1 else values
    return [values, between[..., 1, 1:-1], np.asfortranarray(values), reverse, values.repeat(2, axis=-1)[..., ::2]]


@pytest.mark.parametrize(("function", "widths"), FUNCTIONS, ids=[f"{one.__name__}{width}" for one, width in FUNCTIONS])
@given(seed=st.integers(0, 9999), shapes=st.sampled_from(SHAPES), special=st.booleans())
def test_rows_have_the_bits_of_numpy(
    function: Callable[..., np.ndarray], widths: tuple[int, ...], seed: int, shapes: tuple, special: bool
) -> None:
    rng = np.random.default_rng(seed)
    arrays = [rng.normal(size=(*shape, width)) for shape, width in zip(shapes, widths, strict=False)]
    if special:
        arrays = [rng.choice(SPECIAL, size=one.shape) for one in arrays]
    shape = np.broadcast_shapes(*(one.shape[:-1] for one in arrays))
    expected = by_numpy(function, *(np.broadcast_to(one, (*shape, one.shape[-1])) for one in arrays))
    for given_arrays in zip(*(layouts(one) for one in arrays), strict=True):
        with np.errstate(all="ignore"):
            result = function(*given_arrays)
        assert result.shape == expected.shape
        np.testing.assert_array_equal(result, expected)
        numbers = ~np.isnan(expected)  # NaN has no meaningful sign
        np.testing.assert_array_equal(np.signbit(result[numbers]), np.signbit(expected[numbers]))


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_opposite_directions_turn_by_half_as_numpy_has_it(turn: float) -> None:
    u = np.random.default_rng(1).normal(size=(200, 3))
    u[::3] = [turn, 0.0, 0.0]
    for v in (-u, -2 * u, -u + 1e-16, np.zeros_like(u)):
        np.testing.assert_array_equal(rotation.shortest_arc(u, v), by_numpy(rotation.shortest_arc, u, v))


def test_other_arrays_are_left_to_their_library() -> None:
    q = np.ones((3, 4), np.float32)
    assert rotation.quaternion_multiply(q, q).dtype == np.float32
    assert (
        not rotation.are_doubles(q, np.ones(4)) and not rotation.are_doubles([1.0]) and rotation.are_doubles(np.ones(4))
    )


def test_rows_of_another_width_are_refused() -> None:
    with pytest.raises(ValueError, match="rows of 3 numbers: 4 are expected"):
        rotation.quaternion_multiply(np.ones((2, 4)), np.ones((2, 3)))
