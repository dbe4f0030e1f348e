"""Functions of the compiled core over rows of numbers: each row of NumPy arrays (..., n) of float64 by itself.

A function of rotations is one pass over its arrays here. As NumPy's operations it is about thirty.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from bodysense.files import load_library

# Numbers in a row of each argument, and of the result.
_WIDTHS = {
    "bs_multiply_rotations": (4, 4, 4),
    "bs_rotate_vectors": (4, 3, 3),
    "bs_exp_rotations": (3, 4),
    "bs_log_rotations": (4, 3),
    "bs_mean_rotations": (4, 4, 1, 4),
}


class _StridedRows(ctypes.Structure):
    """`bs_rows`."""

    _fields_ = [("at", ctypes.c_void_p), ("step", ctypes.c_ssize_t)]


def are_numbers_of_numpy(*arrays: object) -> bool:
    """Whether all arrays are NumPy's, of float64: those that the compiled core computes."""
    return all(type(one) is np.ndarray and one.dtype == np.float64 for one in arrays)


def on_rows(name: str, *arrays: np.ndarray) -> np.ndarray:
    """Return what a function of the core gives for each row of arrays (..., n), whose leading axes broadcast."""
    function, *widths, width = _function(name)
    shape = arrays[0].shape[:-1]
    if any(one.shape[:-1] != shape for one in arrays):
        shape = np.broadcast_shapes(*(one.shape[:-1] for one in arrays))
    if [one.shape[-1] for one in arrays] != widths:
        raise ValueError(f"rows of {[one.shape[-1] for one in arrays]} numbers; {name} takes {widths}")
    whole = [_rows(one, shape) for one in arrays]  # refers to the memory until the call is done
    result = np.empty((*shape, width))
    function(result.size // width, *(rows for rows, _ in whole), result.ctypes.data)
    return result


def _rows(values: np.ndarray, shape: tuple[int, ...]) -> tuple[_StridedRows, np.ndarray]:
    """Return the rows of an array, broadcast to leading axes, and the array that owns them."""
    if values.shape[:-1] != shape:
        values = np.broadcast_to(values, (*shape, values.shape[-1]))
    steps = values.strides
    if (
        values.ndim == 2
        and values.dtype == np.float64
        and steps[1] == values.itemsize
        and steps[0] % values.itemsize == 0
    ):
        return _StridedRows(values.ctypes.data, steps[0] // values.itemsize), values
    values = np.ascontiguousarray(values, np.float64)
    return _StridedRows(values.ctypes.data, values.shape[-1]), values


@lru_cache(maxsize=len(_WIDTHS))
def _function(name: str) -> tuple[Callable[..., None], *tuple[int, ...]]:
    """Return a function of the core, and the numbers in a row of its arguments and of its result."""
    function, widths = getattr(load_library("_core"), name), _WIDTHS[name]
    function.restype, function.argtypes = None, [ctypes.c_size_t, *[_StridedRows] * (len(widths) - 1), ctypes.c_void_p]
    return function, *widths
