"""Products of tables with vectors: as exact as inputs of one or two bytes are, and the same bits from every kernel."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import expit

from .library import aligned

GROUP, BLOCK, KERNELS = 16, 64, 6
PAIRS, QUADS = 2, 4  # bundles of inputs in two bytes, and in one
FEATURES, STATES = 32767, 127  # steps of the largest number of a block


class Matrix(ctypes.Structure):
    _fields_ = [
        ("weight", ctypes.c_void_p),
        ("unbiased", ctypes.c_void_p),
        ("step", ctypes.c_void_p),
        ("rows", ctypes.c_int),
        ("inputs", ctypes.c_int),
        ("bundle", ctypes.c_int),
    ]


_P, _N, _SIZE = ctypes.c_void_p, ctypes.c_int, ctypes.c_size_t


class Table(ctypes.Structure):
    _fields_ = [("weight", ctypes.c_void_p), ("rows", ctypes.c_int), ("inputs", ctypes.c_int)]


MULTIPLY = ctypes.CFUNCTYPE(None, _P, _N, _P, _P, _P, _SIZE)
TABLE = ctypes.CFUNCTYPE(None, _P, _N, _P, _SIZE, _P, _SIZE)
QUANTISE = ctypes.CFUNCTYPE(None, _P, _N, _N, _P, _P)
GATES = ctypes.CFUNCTYPE(None, _P, _P, _P, _N, _P)


class Kernel(ctypes.Structure):
    _fields_ = [
        ("name", ctypes.c_char_p),
        ("multiply", MULTIPLY),
        ("quantise", QUANTISE),
        ("multiply_bytes", MULTIPLY),
        ("quantise_bytes", QUANTISE),
        ("multiply_table", TABLE),
        ("gates", GATES),
    ]


@pytest.fixture(scope="module")
def library(networks_file: Path) -> ctypes.CDLL:
    opened = ctypes.CDLL(str(networks_file))
    opened.kernel_at.restype = opened.fastest_kernel.restype = Kernel
    return opened


def kernels(library: ctypes.CDLL) -> dict[str, Kernel]:
    every = [library.kernel_at(place) for place in range(KERNELS)]
    return {kernel.name.decode(): kernel for kernel in every if kernel.multiply}


def padded(count: int, bundle: int) -> int:
    return -(-count // bundle) * bundle


def stored(weight: np.ndarray, bundle: int) -> np.ndarray:
    """Weights (N, K) in the order of the core: by 16 rows, bundle of inputs, row, input of the bundle."""
    rows, inputs = weight.shape
    whole = np.zeros((padded(rows, GROUP), padded(inputs, bundle)), np.int8)
    whole[:rows, :inputs] = weight
    order = whole.reshape(-1, GROUP, whole.shape[1] // bundle, bundle).transpose(0, 2, 1, 3)
    out = aligned(order.size).view(np.int8)
    out[:] = order.ravel()
    return out


def unbiased(weight: np.ndarray) -> np.ndarray:
    """-128 × the sums of the weights of each block, by 16 rows, block, row."""
    rows, inputs = weight.shape
    whole = np.zeros((padded(rows, GROUP), padded(inputs, BLOCK)), np.int32)
    whole[:rows, :inputs] = weight
    order = -128 * whole.reshape(-1, GROUP, whole.shape[1] // BLOCK, BLOCK).sum(axis=3).transpose(0, 2, 1)
    out = aligned(4 * order.size).view(np.int32)
    out[:] = order.ravel()
    return out


def bundle_of(kernel: Kernel, steps: int) -> int:
    return QUADS if steps == STATES and kernel.multiply_bytes else PAIRS


def quantised(kernel: Kernel, x: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    columns, inputs = x.shape
    bundle = bundle_of(kernel, steps)
    value = np.full((columns, padded(inputs, bundle)), -1, np.int16 if bundle == PAIRS else np.int8)
    step = np.zeros((columns, -(-inputs // BLOCK)), np.float32)
    for column in range(columns):
        of = (x[column].ctypes.data, inputs, steps, value[column].ctypes.data, step[column].ctypes.data)
        (kernel.quantise if bundle == PAIRS else kernel.quantise_bytes)(*of)
    assert not value[:, inputs:].any()
    return value, step


def product(
    kernel: Kernel, weight: np.ndarray, row_step: np.ndarray, value: np.ndarray, step: np.ndarray, steps: int
) -> np.ndarray:
    rows, inputs = weight.shape
    bundle = bundle_of(kernel, steps)
    table, sums = stored(weight, bundle), unbiased(weight)
    row_steps = np.zeros(padded(rows, GROUP), np.float32)
    row_steps[:rows] = row_step
    matrix = Matrix(table.ctypes.data, sums.ctypes.data, row_steps.ctypes.data, rows, inputs, bundle)
    y = np.ones((len(value), len(row_steps) + 3), np.float32)
    at = [ctypes.c_void_p(each.ctypes.data) for each in (value, step, y)]
    multiply = kernel.multiply if bundle == PAIRS else kernel.multiply_bytes
    multiply(ctypes.addressof(matrix), len(value), *at, y.shape[1])
    assert (y[:, len(row_steps) :] == 1).all()
    return y[:, :rows]


@given(
    st.integers(1, 150),
    st.integers(1, 300),
    st.sampled_from([2, 4, 6, 10]),
    st.sampled_from([1e-20, 1.0, 1e20]),
    st.sampled_from([FEATURES, STATES]),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=60)
def test_kernels_agree_and_are_as_exact_as_their_inputs(
    library: ctypes.CDLL, rows: int, inputs: int, columns: int, size: float, steps: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    weight = rng.integers(-127, 128, (rows, inputs))
    row_step = rng.uniform(0.001, 0.01, rows).astype(np.float32)
    x = (size * rng.normal(size=(columns, inputs))).astype(np.float32)
    value, step = quantised(kernels(library)["plain"], x, steps)
    for kernel in kernels(library).values():
        own, own_step = quantised(kernel, x, steps)
        np.testing.assert_array_equal(own[:, :inputs], value[:, :inputs])
        np.testing.assert_array_equal(own_step, step)
    every = {
        name: product(kernel, weight, row_step, *quantised(kernel, x, steps), steps)
        for name, kernel in kernels(library).items()
    }
    for got in every.values():
        np.testing.assert_array_equal(got, every["plain"])
    wide = np.repeat(step, BLOCK, axis=1)[:, :inputs].astype(np.float64)
    exact = 1 + x.astype(np.float64) @ (weight * row_step[:, None]).T
    bound = (0.51 * wide) @ np.abs(weight * row_step[:, None]).T + 1e-5 * np.abs(exact)
    assert (np.abs(every["plain"] - exact) <= bound + 1e-6).all()


@given(st.integers(1, 70), st.integers(1, 90), st.integers(1, 5), st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_kernels_agree_on_tables_of_floats(
    library: ctypes.CDLL, rows: int, inputs: int, columns: int, seed: int
) -> None:
    rng, groups = np.random.default_rng(seed), -(-rows // GROUP)
    weight, gap = rng.normal(size=(rows, inputs)), inputs + 2
    whole = np.zeros((groups * GROUP, inputs))
    whole[:rows] = weight
    table = aligned(whole.size * 4).view(np.float32)
    table[:] = whole.reshape(groups, GROUP, inputs).transpose(0, 2, 1).ravel()
    described = Table(table.ctypes.data, rows, inputs)
    x = rng.normal(size=(columns, gap)).astype(np.float32)
    found = []
    for kernel in kernels(library).values():
        y = np.ones((columns, groups * GROUP), np.float32)
        kernel.multiply_table(ctypes.addressof(described), columns, x.ctypes.data, gap, y.ctypes.data, y.shape[1])
        found.append(y)
    for got in found:
        np.testing.assert_array_equal(got, found[-1])
    np.testing.assert_allclose(found[-1][:, :rows], 1 + x[:, :inputs] @ weight.T, atol=1e-4)


@given(st.integers(1, 70), st.sampled_from([0.1, 3.0, 50.0]), st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_kernels_agree_on_the_gates_of_a_recurrent_unit(
    library: ctypes.CDLL, size: int, spread: float, seed: int
) -> None:
    given, kept = (spread * np.random.default_rng(seed + k).normal(size=(3, size)).astype(np.float32) for k in (0, 1))
    before = np.random.default_rng(seed + 2).uniform(-1, 1, size).astype(np.float32)
    found = []
    for kernel in kernels(library).values():
        after = np.full(size, np.nan, np.float32)
        kernel.gates(given.ctypes.data, kept.ctypes.data, before.ctypes.data, size, after.ctypes.data)
        found.append(after)
    for got in found:
        np.testing.assert_array_equal(got, found[-1])
    reset, update = (expit(given[k].astype(float) + kept[k]) for k in (0, 1))
    candidate = np.tanh(given[2] + reset * kept[2])
    # Single precision rounds the candidate's sum; where its terms cancel, tanh is steep.
    rounding = 2.0**-24 * (np.abs(given[2].astype(float)) + np.abs(reset * kept[2])) * (1 - candidate**2)
    error = np.abs(found[-1] - (candidate + update * (before - candidate)))
    assert (error < 4e-7 + 2 * rounding).all()


@pytest.mark.parametrize("steps", [FEATURES, STATES])
@pytest.mark.parametrize("sign", [-1, 1])
def test_largest_numbers_do_not_overflow(library: ctypes.CDLL, steps: int, sign: int) -> None:
    weight, x = np.full((GROUP, 2 * BLOCK), 127 * sign), np.full((2, 2 * BLOCK), 3.0, np.float32)
    for kernel in kernels(library).values():
        got = product(kernel, weight, np.ones(GROUP, np.float32), *quantised(kernel, x, steps), steps)
        np.testing.assert_allclose(got, 1 + sign * 127 * 3.0 * 2 * BLOCK, rtol=1e-6)


@pytest.mark.parametrize("steps", [FEATURES, STATES])
def test_vectors_keep_their_largest_number_and_zeros(library: ctypes.CDLL, steps: int) -> None:
    x = np.zeros((1, 2 * BLOCK - 1), np.float32)
    x[0, :3] = [0.5, -2.0, 1e-9]
    for kernel in kernels(library).values():
        value, step = quantised(kernel, x, steps)
        assert value[0, 1] == -steps and value[0, 2] == 0
        assert step[0, 0] == np.float32(2 / steps) and step[0, 1] == 0


def test_the_fastest_kernel_is_the_first_that_there_is(library: ctypes.CDLL) -> None:
    assert library.fastest_kernel().name.decode() == next(iter(kernels(library)))
