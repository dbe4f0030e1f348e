"""Products of tables with vectors: as exact as two bytes are, and the same bits from every kernel."""

import ctypes

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import expit

from .network_library import aligned, compiled

GROUP, BLOCK, KERNELS = 16, 64, 5


class Matrix(ctypes.Structure):
    _fields_ = [
        ("weight", ctypes.c_void_p),
        ("step", ctypes.c_void_p),
        ("rows", ctypes.c_int),
        ("inputs", ctypes.c_int),
    ]


_P, _N, _SIZE = ctypes.c_void_p, ctypes.c_int, ctypes.c_size_t


class Table(ctypes.Structure):
    _fields_ = [("weight", ctypes.c_void_p), ("rows", ctypes.c_int), ("inputs", ctypes.c_int)]


MULTIPLY = ctypes.CFUNCTYPE(None, _P, _N, _P, _P, _P, _SIZE)
TABLE = ctypes.CFUNCTYPE(None, _P, _N, _P, _SIZE, _P, _SIZE)
QUANTISE = ctypes.CFUNCTYPE(None, _P, _N, _P, _P)
GATES = ctypes.CFUNCTYPE(None, _P, _P, _P, _N, _P)


class Kernel(ctypes.Structure):
    _fields_ = [
        ("name", ctypes.c_char_p),
        ("run", MULTIPLY),
        ("run_table", TABLE),
        ("quantise", QUANTISE),
        ("gates", GATES),
    ]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    opened = ctypes.CDLL(str(compiled(tmp_path_factory.mktemp("core"))))
    opened.kernel_at.restype = opened.fastest_kernel.restype = Kernel
    return opened


def kernels(library: ctypes.CDLL) -> dict[str, Kernel]:
    every = [library.kernel_at(place) for place in range(KERNELS)]
    return {kernel.name.decode(): kernel for kernel in every if kernel.run}


def stored(weight: np.ndarray) -> np.ndarray:
    """Weights (N, K) in the order of the core: by 16 rows, pair of inputs, row, input of the pair."""
    rows, inputs = weight.shape
    whole = np.zeros((-(-rows // GROUP) * GROUP, inputs + inputs % 2), np.int8)
    whole[:rows, :inputs] = weight
    order = whole.reshape(-1, GROUP, whole.shape[1] // 2, 2).transpose(0, 2, 1, 3)
    out = aligned(order.size).view(np.int8)
    out[:] = order.ravel()
    return out


def quantised(kernel: Kernel, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    columns, inputs = x.shape
    value = np.full((columns, inputs + inputs % 2), -1, np.int16)
    step = np.zeros((columns, -(-inputs // BLOCK)), np.float32)
    for column in range(columns):
        kernel.quantise(x[column].ctypes.data, inputs, value[column].ctypes.data, step[column].ctypes.data)
    return value, step


def product(
    kernel: Kernel, weight: np.ndarray, row_step: np.ndarray, value: np.ndarray, step: np.ndarray
) -> np.ndarray:
    rows, inputs = weight.shape
    table = stored(weight)
    steps = np.zeros(-(-rows // GROUP) * GROUP, np.float32)
    steps[:rows] = row_step
    matrix = Matrix(table.ctypes.data, steps.ctypes.data, rows, inputs)
    y = np.ones((len(value), len(steps) + 3), np.float32)
    at = [ctypes.c_void_p(each.ctypes.data) for each in (value, step, y)]
    kernel.run(ctypes.addressof(matrix), len(value), *at, y.shape[1])
    assert (y[:, len(steps) :] == 1).all()
    return y[:, :rows]


@given(
    st.integers(1, 150),
    st.integers(1, 300),
    st.sampled_from([2, 4, 6]),
    st.sampled_from([1e-20, 1.0, 1e20]),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=30)
def test_kernels_agree_and_are_as_exact_as_two_bytes(
    library: ctypes.CDLL, rows: int, inputs: int, columns: int, size: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    weight = rng.integers(-127, 128, (rows, inputs))
    row_step = rng.uniform(0.001, 0.01, rows).astype(np.float32)
    x = (size * rng.normal(size=(columns, inputs))).astype(np.float32)
    value, step = quantised(kernels(library)["plain"], x)
    for kernel in kernels(library).values():
        for got, plain in zip(quantised(kernel, x), (value, step), strict=True):
            np.testing.assert_array_equal(got, plain)
    every = {name: product(kernel, weight, row_step, value, step) for name, kernel in kernels(library).items()}
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
        kernel.run_table(ctypes.addressof(described), columns, x.ctypes.data, gap, y.ctypes.data, y.shape[1])
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


def test_largest_numbers_do_not_overflow(library: ctypes.CDLL) -> None:
    weight, x = np.full((GROUP, 2 * BLOCK), -127), np.full((2, 2 * BLOCK), 3.0, np.float32)
    value, step = quantised(kernels(library)["plain"], x)
    for kernel in kernels(library).values():
        got = product(kernel, weight, np.ones(GROUP, np.float32), value, step)
        np.testing.assert_allclose(got, 1 - 127 * 3.0 * 2 * BLOCK, rtol=1e-6)


def test_vectors_keep_their_largest_number_and_zeros(library: ctypes.CDLL) -> None:
    x = np.zeros((1, 2 * BLOCK - 1), np.float32)
    x[0, :3] = [0.5, -2.0, 1e-9]
    value, step = quantised(kernels(library)["plain"], x)
    assert value[0, 1] == -32767 and value[0, 2] == 0 and value[0, -1] == 0
    assert step[0, 0] == np.float32(2 / 32767) and step[0, 1] == 0


def test_the_fastest_kernel_is_the_first_that_there_is(library: ctypes.CDLL) -> None:
    assert library.fastest_kernel().name.decode() == next(iter(kernels(library)))
