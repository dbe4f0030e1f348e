"""Compiled rotations: equal to the same functions on PyTorch, for rows anywhere in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import torch

from bodysense.geometry import rotation as r
from bodysense.geometry.rotation import are_numbers_of_numpy, on_rows

ROWS = 400
FUNCTIONS: dict[str, tuple[Callable[..., Any], tuple[int, ...]]] = {
    "bs_multiply_rotations": (r.quaternion_multiply, (4, 4)),
    "bs_rotate_vectors": (r.quaternion_rotate, (4, 3)),
    "bs_exp_rotations": (r.quaternion_exp, (3,)),
    "bs_log_rotations": (r.quaternion_log, (4,)),
}


def random_rows(rng: np.random.Generator, width: int) -> np.ndarray:
    """Return quaternions, or vectors from 1e-9 to 10 long; some quaternions are tiny or half turns, on both sides."""
    rows = rng.normal(size=(ROWS, width))
    rows /= np.linalg.norm(rows, axis=-1, keepdims=True)
    if width == 3:
        return rows * 10 ** rng.uniform(-9, 1, (ROWS, 1))
    rows[::4, 1:] *= 10 ** rng.uniform(-10, 0, (len(rows[::4]), 1))
    rows[::7, 0] = rng.choice([-1.0, 0.0, 1.0], len(rows[::7])) * 10 ** rng.uniform(-18, 0, len(rows[::7]))
    return rows


def in_memory(rng: np.random.Generator, values: np.ndarray) -> Iterator[np.ndarray]:
    """Yield an array whose rows are equal, in each order in memory."""
    width = values.shape[-1]
    yield values
    spread = rng.normal(size=(len(values), 5, width))
    spread[:, 2] = values
    yield spread[:, 2]
    yield np.asfortranarray(values)
    yield np.ascontiguousarray(values[::-1])[::-1]
    wide = rng.normal(size=(len(values), width + 1))
    wide[:, :width] = values
    yield wide[:, :width]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_compiled_functions_equal_those_of_pytorch(name: str) -> None:
    function, widths = FUNCTIONS[name]
    rng = np.random.default_rng(len(name))
    arrays = [random_rows(rng, width) for width in widths]
    expected = function(*(torch.tensor(one) for one in arrays)).numpy()
    whole = on_rows(name, *arrays)
    scale = np.maximum(1, np.linalg.norm(expected, axis=-1, keepdims=True))
    assert np.abs((whole - expected) / scale).max() < 1e-15 * 4
    for laid_out in zip(*(in_memory(rng, one) for one in arrays), strict=True):
        np.testing.assert_array_equal(on_rows(name, *laid_out), whole)
        np.testing.assert_array_equal(function(*laid_out), whole)


def test_leading_axes_broadcast_as_in_numpy() -> None:
    rng = np.random.default_rng(2)
    for shape, other in (((), (7,)), ((5, 1), (7,)), ((3, 5, 7), (5, 1)), ((0,), ()), ((1,), (6, 1))):
        a, b = rng.normal(size=(*shape, 4)), rng.normal(size=(*other, 4))
        expected = r.quaternion_multiply(torch.tensor(a), torch.tensor(b)).numpy()
        np.testing.assert_array_equal(r.quaternion_multiply(a, b), expected)


def test_means_are_normalised_weighted_sums_of_aligned_quaternions() -> None:
    rng = np.random.default_rng(4)
    a, b, share = random_rows(rng, 4), random_rows(rng, 4), rng.uniform(size=(ROWS, 1))
    b[0], share[0] = -a[0], 0.25  # the same rotation
    aligned = np.where((a * b).sum(axis=-1, keepdims=True) < 0, -b, b)
    total = (1 - share) * a + share * aligned
    expected = r.quaternion_canonical(total / np.linalg.norm(total, axis=-1, keepdims=True))
    np.testing.assert_allclose(on_rows("bs_mean_rotations", a, b, share), expected, rtol=0, atol=1e-15)
    nothing = np.zeros((1, 4))
    np.testing.assert_array_equal(on_rows("bs_mean_rotations", nothing, nothing, share[:1]), nothing)


def test_rows_of_another_width_are_refused() -> None:
    with pytest.raises(ValueError, match=r"rows of \[4, 4\] numbers; bs_rotate_vectors takes \[4, 3\]"):
        on_rows("bs_rotate_vectors", np.ones((2, 4)), np.ones((2, 4)))


def test_other_arrays_keep_their_library_and_type() -> None:
    single = np.ones((2, 4), np.float32)
    assert not are_numbers_of_numpy(single) and not are_numbers_of_numpy(torch.ones(2, 4))
    assert r.quaternion_multiply(single, single).dtype == np.float32
