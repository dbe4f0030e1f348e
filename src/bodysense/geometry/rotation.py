"""Rotations: unit quaternions (wxyz), matrices, 6-D, axis-angle, Euler angles.

All functions take arrays of NumPy or PyTorch (through the Array API) with any leading batch axes, and return arrays of
the same library. They are differentiable on PyTorch. Quaternions are active rotations, `child → parent`.

The compiled core computes products, turned vectors, exponentials, logarithms and means of NumPy arrays of float64: one
pass over the arrays instead of about thirty operations.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeAlias

import array_api_compat
import numpy as np

from bodysense.files import load_library

Array: TypeAlias = Any  # a NumPy array or a PyTorch tensor

_FLOAT64 = np.dtype(np.float64)
_FEW = 8  # numbers: NumPy adds up fewer of them one after another
_MANY = 64  # numbers in fewer rows are added up faster by NumPy's own sum
_AXES = {"X": 0, "Y": 1, "Z": 2}
# Numbers in a row of each argument, and of the result.
_WIDTHS = {
    "bs_multiply_rotations": (4, 4, 4),
    "bs_rotate_vectors": (4, 3, 3),
    "bs_exp_rotations": (3, 4),
    "bs_log_rotations": (4, 3),
    "bs_mean_rotations": (4, 4, 1, 4),
}


def array_namespace(*arrays: Array) -> Any:
    """Return the library of arrays. NumPy's functions need no wrapper: version 2 follows the Array API."""
    for one in arrays:
        if type(one) is not np.ndarray:
            return array_api_compat.array_namespace(*arrays)  # noqa: TID251 (of PyTorch)
    return np


def quaternion_identity(like: Array) -> Array:
    """Return identity quaternions (..., 4) for the leading axes of `like` (..., n), with its dtype and device."""
    xp = array_namespace(like)
    one = xp.ones_like(like[..., :1])
    return xp.concat([one, xp.zeros_like(one), xp.zeros_like(one), xp.zeros_like(one)], axis=-1)


def dot(a: Array, b: Array) -> Array:
    """Return the inner product over the last axis, which is kept: (..., n), (..., n) → (..., 1)."""
    if type(a) is np.ndarray is type(b):
        return _sum_of_few(a * b)
    xp = array_namespace(a, b)
    return xp.sum(a * b, axis=-1, keepdims=True)


def _sum_of_few(parts: np.ndarray) -> np.ndarray:
    """Return the sum (..., 1) over a short last axis, in its order: NumPy adds up each row in a loop of its own."""
    if not 1 < parts.shape[-1] < _FEW or parts.size < _MANY:
        return np.sum(parts, axis=-1, keepdims=True)
    total = parts[..., :1] + parts[..., 1:2]
    for k in range(2, parts.shape[-1]):
        total += parts[..., k : k + 1]
    return total


def safe_norm(a: Array, floor: float = 1e-12) -> Array:
    """Return the length over the last axis, which is kept; the gradient is zero, not NaN, for lengths below `floor`."""
    xp = array_namespace(a)
    squared = dot(a, a)
    if xp is np:
        return np.where(squared < floor * floor, 0.0, np.sqrt(squared))
    tiny = squared < floor * floor
    return xp.where(tiny, xp.zeros_like(squared), xp.sqrt(xp.where(tiny, xp.ones_like(squared), squared)))


def normalize(a: Array) -> Array:
    """Scale the last axis to unit length. A zero vector stays zero."""
    xp = array_namespace(a)
    length = safe_norm(a)
    return a / xp.where(length == 0, xp.ones_like(length), length)


def cross(a: Array, b: Array) -> Array:
    """Return the vector product over the last axis: (..., 3), (..., 3) → (..., 3)."""
    xp = array_namespace(a, b)
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return xp.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def quaternion_multiply(a: Array, b: Array) -> Array:
    """Return the Hamilton product: first `b`, then `a`. (..., 4), (..., 4) → (..., 4)."""
    if are_numbers_of_numpy(a, b):
        return on_rows("bs_multiply_rotations", a, b)
    xp = array_namespace(a, b)
    aw, ax, ay, az = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bw, bx, by, bz = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    return xp.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def quaternion_conjugate(q: Array) -> Array:
    """Return the inverse of a unit quaternion."""
    xp = array_namespace(q)
    return xp.concat([q[..., :1], -q[..., 1:]], axis=-1)


def quaternion_canonical(q: Array) -> Array:
    """Return the equal rotation with w ≥ 0."""
    xp = array_namespace(q)
    return xp.where(q[..., :1] < 0, -q, q)


def quaternion_rotate(q: Array, v: Array) -> Array:
    """Rotate vectors: (..., 4), (..., 3) → (..., 3)."""
    if are_numbers_of_numpy(q, v):
        return on_rows("bs_rotate_vectors", q, v)
    t = 2 * cross(q[..., 1:], v)
    return v + q[..., :1] * t + cross(q[..., 1:], t)


def quaternion_to_matrix(q: Array) -> Array:
    """Convert quaternions to matrices: (..., 4) → (..., 3, 3)."""
    xp = array_namespace(q)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    entries = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    if xp is not np:
        return xp.stack([xp.stack(row, axis=-1) for row in entries], axis=-2)
    matrix = np.empty((*q.shape[:-1], 3, 3), q.dtype)
    for row, parts in enumerate(entries):
        for column, part in enumerate(parts):
            matrix[..., row, column] = part
    return matrix


def matrix_to_quaternion(m: Array) -> Array:
    """Convert matrices (..., 3, 3) to quaternions (..., 4), w ≥ 0, by the best conditioned of Shepperd's four forms."""
    xp = array_namespace(m)
    m00, m11, m22 = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    a, b, c = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    d, e, f = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    squared = [1 + m00 + m11 + m22, 1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22]
    rows = [
        [squared[0], a, b, c],
        [a, squared[1], d, e],
        [b, d, squared[2], f],
        [c, e, f, squared[3]],
    ]
    forms = xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)
    largest = xp.argmax(xp.stack(squared, axis=-1), axis=-1)[..., None]
    chosen = xp.concat([largest == k for k in range(4)], axis=-1)
    best = xp.sum(xp.where(chosen[..., None], forms, xp.zeros_like(forms)), axis=-2)
    return quaternion_canonical(normalize(best))


def quaternion_exp(rotation_vector: Array) -> Array:
    """Convert axis-angle vectors (radians) to quaternions: (..., 3) → (..., 4)."""
    if are_numbers_of_numpy(rotation_vector):
        return on_rows("bs_exp_rotations", rotation_vector)
    xp = array_namespace(rotation_vector)
    squared = dot(rotation_vector, rotation_vector)
    small = squared < 1e-8
    angle = xp.sqrt(xp.where(small, xp.ones_like(squared), squared))
    scale = xp.where(small, 0.5 - squared / 48, xp.sin(angle / 2) / angle)
    w = xp.where(small, 1 - squared / 8 + squared * squared / 384, xp.cos(angle / 2))
    return xp.concat([w, rotation_vector * scale], axis=-1)


def quaternion_log(q: Array) -> Array:
    """Convert quaternions to axis-angle vectors of at most π radians: (..., 4) → (..., 3)."""
    if are_numbers_of_numpy(q):
        return on_rows("bs_log_rotations", q)
    xp = array_namespace(q)
    q = quaternion_canonical(q)
    w, v = q[..., :1], q[..., 1:]
    sine = safe_norm(v, 1e-7)
    small = sine == 0
    angle = 2 * xp.atan2(xp.where(small, xp.ones_like(sine), sine), w)
    return v * xp.where(
        small, 2 / xp.where(w == 0, xp.ones_like(w), w), angle / xp.where(small, xp.ones_like(sine), sine)
    )


def matrix_to_sixd(m: Array) -> Array:
    """Return the first two columns, one after the other: (..., 3, 3) → (..., 6). Zhou et al. 2019."""
    xp = array_namespace(m)
    return xp.concat([m[..., :, 0], m[..., :, 1]], axis=-1)


def sixd_to_matrix(sixd: Array) -> Array:
    """Orthonormalise two 3-vectors by Gram-Schmidt: (..., 6) → (..., 3, 3). Zhou et al. 2019, eq. 15."""
    xp = array_namespace(sixd)
    x = normalize(sixd[..., :3])
    second = sixd[..., 3:]
    y = normalize(second - dot(x, second) * x)
    return xp.stack([x, y, cross(x, y)], axis=-1)


def slerp(a: Array, b: Array, t: Array) -> Array:
    """Interpolate at constant speed on the shorter arc: (..., 4), (..., 4), (...,) or a number → (..., 4)."""
    step = quaternion_log(quaternion_multiply(quaternion_conjugate(a), b))
    return quaternion_multiply(a, quaternion_exp(step * (t if isinstance(t, (int, float)) else t[..., None])))


def mean_rotation(a: Array, b: Array, share: Array | float = 0.5) -> Array:
    """Return the weighted mean (..., 4) of two rotations (NumPy); `share` (..., 1) is the weight of the second."""
    share = np.broadcast_to(np.asarray(share, np.float64), (*np.shape(share)[:-1], 1))
    return on_rows("bs_mean_rotations", a, b, share)


def smooth_step(share: Array) -> Array:
    """Return 3x² - 2x³, which goes from 0 to 1 with zero slope at both ends."""
    return share**2 * (3 - 2 * share)


def shortest_arc(u: Array, v: Array) -> Array:
    """Return the smallest rotation that takes direction `u` to direction `v`: (..., 3), (..., 3) → (..., 4).

    Opposite directions turn by π about an axis at right angles to `u`; a zero vector gives the identity.
    """
    xp = array_namespace(u, v)
    u, v = normalize(u), normalize(v)
    # An axis at right angles to u, for the opposite case: drop u's smallest component.
    flat = xp.abs(u[..., :1]) > 0.8
    zero, one = xp.zeros_like(u[..., :1]), xp.ones_like(u[..., :1])
    helper = xp.concat([xp.where(flat, zero, one), xp.where(flat, one, zero), zero], axis=-1)
    cosine = dot(u, v)
    opposite = cosine < -1 + 4 * xp.finfo(cosine.dtype).eps
    half_turn = xp.concat([xp.zeros_like(cosine), normalize(cross(u, helper))], axis=-1)
    arc = normalize(xp.concat([1 + xp.where(opposite, xp.zeros_like(cosine), cosine), cross(u, v)], axis=-1))
    return xp.where(opposite, half_turn, arc)


def angle_between(u: Array, v: Array) -> Array:
    """Return the angles (...) in radians, 0 to π, between vectors (..., 3) of any length; 0 for a zero vector."""
    xp = array_namespace(u, v)
    return xp.atan2(safe_norm(cross(u, v))[..., 0], dot(u, v)[..., 0])


def angle_about(axis: Array, u: Array, v: Array) -> Array:
    """Return the angles (...) in radians, −π to π, about a unit axis from `u` to `v`, square to it: (..., 3)."""
    xp = array_namespace(axis, u, v)
    return xp.atan2(dot(cross(u, v), axis)[..., 0], dot(u, v)[..., 0])


def swing_twist(q: Array, axis: Array) -> tuple[Array, Array]:
    """Split q = swing · twist: twist about the unit `axis` (..., 3), swing about an axis at right angles to it.

    The twist is undefined if the swing is a half turn; it is the identity then.
    """
    xp = array_namespace(q)
    along = dot(q[..., 1:], axis) * axis
    twist = xp.concat([q[..., :1], along], axis=-1)
    length = safe_norm(twist, 1e-8)
    undefined = length == 0
    twist = xp.where(undefined, quaternion_identity(q), twist / xp.where(undefined, xp.ones_like(length), length))
    twist = quaternion_canonical(twist)
    return quaternion_multiply(q, quaternion_conjugate(twist)), twist


def heading(q: Array) -> Array:
    """Return the rotation about +Y in `q`: the yaw of yaw · pitch, unless pitch is a half turn. (..., 4) → (..., 4)."""
    xp = array_namespace(q)
    zero = xp.zeros_like(q[..., :1])
    return swing_twist(q, xp.concat([zero, zero + 1, zero], axis=-1))[1]


def geodesic_angle(a: Array, b: Array) -> Array:
    """Return the angle of the rotation from `a` to `b`, radians in [0, π]: (..., 4), (..., 4) → (...,)."""
    xp = array_namespace(a, b)
    difference = quaternion_multiply(quaternion_conjugate(a), b)
    return 2 * xp.atan2(safe_norm(difference[..., 1:])[..., 0], xp.abs(difference[..., 0]))


def euler_to_quaternion(angles: Array, order: str) -> Array:
    """Convert intrinsic Euler angles (radians), one column per axis of `order`, to quaternions: (..., n) → (..., 4).

    'ZXY' is R = Rz · Rx · Ry.
    """
    xp = array_namespace(angles)
    result = None
    for column, axis in enumerate(order):
        half = angles[..., column] / 2
        parts = [xp.cos(half), xp.zeros_like(half), xp.zeros_like(half), xp.zeros_like(half)]
        parts[1 + _AXES[axis]] = xp.sin(half)
        turn = xp.stack(parts, axis=-1)
        result = turn if result is None else quaternion_multiply(result, turn)
    return result


def quaternion_to_euler(q: Array, order: str) -> Array:
    """Convert quaternions to intrinsic Euler angles (radians) of three different axes: (..., 4) → (..., 3).

    In gimbal lock the last angle is 0.
    """
    xp = array_namespace(q)
    i, j, k = (_AXES[axis] for axis in order)
    if len({i, j, k}) != 3:
        raise ValueError(f"order {order!r} must name X, Y and Z once each")
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    m = quaternion_to_matrix(q)
    sine = xp.clip(sign * m[..., i, k], -1.0, 1.0)
    locked = xp.abs(sine) > 1 - 1e-12
    # atan2 keeps its precision near ±90°, where asin loses half its digits.
    middle = xp.atan2(sine, xp.sqrt(m[..., i, i] ** 2 + m[..., i, j] ** 2))
    first = xp.where(locked, xp.atan2(sign * m[..., k, j], m[..., j, j]), xp.atan2(-sign * m[..., j, k], m[..., k, k]))
    last = xp.where(locked, xp.zeros_like(sine), xp.atan2(-sign * m[..., i, j], m[..., i, i]))
    return xp.stack([first, middle, last], axis=-1)


class _StridedRows(ctypes.Structure):
    """`bs_rows`."""

    _fields_ = [("at", ctypes.c_void_p), ("step", ctypes.c_ssize_t)]


def are_numbers_of_numpy(*arrays: object) -> bool:
    """Whether all arrays are NumPy's, of float64: those that the compiled core computes."""
    for one in arrays:
        if type(one) is not np.ndarray or not (one.dtype is _FLOAT64 or one.dtype == _FLOAT64):
            return False
    return True


def on_rows(name: str, *arrays: np.ndarray) -> np.ndarray:
    """Return what a function of the core gives for each row of arrays (..., n), whose leading axes broadcast."""
    function, widths, width = _function(name)
    shape = shapes = arrays[0].shape[:-1]
    for one, wanted in zip(arrays, widths, strict=True):
        if one.shape[-1] != wanted:
            raise ValueError(f"rows of {[one.shape[-1] for one in arrays]} numbers; {name} takes {list(widths)}")
        if one.shape[:-1] != shape:
            shapes = None
    if shapes is None:
        shape = np.broadcast(*(one[..., 0] for one in arrays)).shape
    whole = [_rows(one, shape) for one in arrays]  # refers to the memory until the call is done
    result = np.empty((*shape, width))
    function(result.size // width, *[rows for rows, _ in whole], _address(result))
    return result


def _rows(values: np.ndarray, shape: tuple[int, ...]) -> tuple[_StridedRows, np.ndarray]:
    """Return the rows of an array, broadcast to leading axes, and the array that owns them."""
    width, is_double = values.shape[-1], values.dtype is _FLOAT64 or values.dtype == _FLOAT64
    is_whole = values.shape[:-1] == shape
    if is_double and is_whole and values.flags.c_contiguous:
        return _StridedRows(_address(values), width), values
    if not is_double or values.strides[-1] != values.itemsize:
        values = np.ascontiguousarray(values, np.float64)
    if values.size == width and not is_whole:
        return _StridedRows(_address(values), 0), values
    if not is_whole:
        every = np.empty((*shape, width))
        every[...] = values
        values = every
    steps = values.strides
    if values.ndim == 2 and steps[0] % values.itemsize == 0:
        return _StridedRows(_address(values), steps[0] // values.itemsize), values
    values = np.ascontiguousarray(values)
    return _StridedRows(_address(values), width), values


def _address(values: np.ndarray) -> int:
    """Return the address of an array's numbers. `values.ctypes` takes four times as long, so it is the last resort."""
    flags = values.flags
    if flags.c_contiguous and flags.writeable and values.size:
        return ctypes.addressof(ctypes.c_char.from_buffer(values.data))
    return values.__array_interface__["data"][0]


@lru_cache(maxsize=len(_WIDTHS))
def _function(name: str) -> tuple[Callable[..., None], tuple[int, ...], int]:
    """Return a function of the core, and the numbers in a row of each argument and of its result."""
    function, (*widths, width) = getattr(load_library("_core"), name), _WIDTHS[name]
    function.restype, function.argtypes = None, [ctypes.c_size_t, *[_StridedRows] * len(widths), ctypes.c_void_p]
    return function, tuple(widths), width
