"""Rotations: group axioms, SciPy and NumPy as oracles, NumPy = PyTorch, gradients."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation, Slerp

from bodysense.geometry import rotation as r

SHAPES = [(), (3, 1, 2), (0,)]
ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def random_quaternion(shape: tuple[int, ...] = (200,), seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def random_vector(shape: tuple[int, ...] = (200,), seed: int = 0, longest: float = np.pi) -> np.ndarray:
    """Vectors of all lengths from tiny to `longest`."""
    rng = np.random.default_rng(seed)
    v = rng.normal(size=(*shape, 3))
    length = longest * 10 ** -rng.uniform(0, 9, (*shape, 1))
    return v / np.linalg.norm(v, axis=-1, keepdims=True) * length


def scipy_rotation(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


def assert_same_rotation(a: Any, b: Any, tolerance: float = 1e-10) -> None:
    a, b = np.asarray(a), np.asarray(b)
    sign = np.where((a * b).sum(axis=-1, keepdims=True) < 0, -1, 1)
    np.testing.assert_allclose(a * sign, b, rtol=0, atol=tolerance)


# The group


def test_multiplication_is_associative_with_identity_and_inverse() -> None:
    a, b, c = (random_quaternion(seed=seed) for seed in range(3))
    multiply = r.quaternion_multiply
    np.testing.assert_allclose(multiply(multiply(a, b), c), multiply(a, multiply(b, c)), atol=1e-12)
    np.testing.assert_allclose(multiply(a, r.quaternion_identity(a)), a, atol=1e-15)
    np.testing.assert_allclose(multiply(r.quaternion_identity(a), a), a, atol=1e-15)
    np.testing.assert_allclose(multiply(a, r.quaternion_conjugate(a)), np.broadcast_to(IDENTITY, a.shape), atol=1e-12)


def test_multiplication_rotates_by_the_right_factor_first() -> None:
    a, b, v = random_quaternion(seed=0), random_quaternion(seed=1), random_vector()
    both = r.quaternion_rotate(r.quaternion_multiply(a, b), v)
    np.testing.assert_allclose(both, r.quaternion_rotate(a, r.quaternion_rotate(b, v)), atol=1e-12)
    np.testing.assert_allclose(both, (scipy_rotation(a) * scipy_rotation(b)).apply(v), atol=1e-12)


@pytest.mark.parametrize("rows", [1, 7, 300])
@pytest.mark.parametrize("width", [1, 3, 4, 7, 8, 12])
def test_inner_products_are_added_up_in_the_order_of_numpy(width: int, rows: int) -> None:
    a, b = np.random.default_rng(width).standard_normal((2, 2, rows, width))
    assert np.array_equal(r.dot(a, b), np.sum(a * b, axis=-1, keepdims=True))
    assert r.dot(a.astype(np.float32), b.astype(np.float32)).dtype == np.float32


def test_canonical_is_the_same_rotation_with_positive_w() -> None:
    q = random_quaternion()
    canonical = r.quaternion_canonical(q)
    assert (canonical[:, 0] >= 0).all()
    assert_same_rotation(canonical, q)


# Forms


def test_matrices_equal_scipy() -> None:
    q = random_quaternion()
    m = r.quaternion_to_matrix(q)
    np.testing.assert_allclose(m, scipy_rotation(q).as_matrix(), atol=1e-12)
    assert_same_rotation(r.matrix_to_quaternion(m), q)
    assert (r.matrix_to_quaternion(m)[:, 0] >= 0).all()


@pytest.mark.parametrize("short_of", [0.0, 1e-12, 1e-9, 1e-6, 1e-3])
def test_half_turns_survive_every_form(short_of: float) -> None:
    axes = np.stack([*np.eye(3), [0.6, 0.8, 0.0], np.ones(3) / np.sqrt(3)])
    vector = axes * (np.pi - short_of)
    q = r.quaternion_exp(vector)
    assert_same_rotation(r.matrix_to_quaternion(r.quaternion_to_matrix(q)), q, 1e-9)
    assert_same_rotation(r.quaternion_exp(r.quaternion_log(q)), q, 1e-12)
    assert np.linalg.norm(r.quaternion_log(q), axis=-1).max() <= np.pi + 1e-12


def test_exponential_and_logarithm_equal_scipy_and_are_inverse() -> None:
    v = random_vector((2000,))
    q = r.quaternion_exp(v)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1, atol=1e-12)
    assert_same_rotation(q, Rotation.from_rotvec(v).as_quat(scalar_first=True), 1e-14)
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    np.testing.assert_allclose(r.quaternion_log(q) / length, v / length, atol=1e-9)
    np.testing.assert_allclose(r.quaternion_log(-q) / length, v / length, atol=1e-9)


def test_exponential_of_more_than_half_a_turn_comes_back_shorter() -> None:
    v = random_vector(longest=20.0)
    log = r.quaternion_log(r.quaternion_exp(v))
    np.testing.assert_allclose(log, Rotation.from_rotvec(v).as_rotvec(), atol=1e-9)


def test_zero_turn() -> None:
    np.testing.assert_array_equal(r.quaternion_exp(np.zeros(3)), IDENTITY)
    np.testing.assert_array_equal(r.quaternion_log(IDENTITY), np.zeros(3))
    np.testing.assert_array_equal(r.quaternion_log(-IDENTITY), np.zeros(3))


def test_sixd_round_trip_and_gram_schmidt() -> None:
    m = r.quaternion_to_matrix(random_quaternion())
    np.testing.assert_allclose(r.sixd_to_matrix(r.matrix_to_sixd(m)), m, atol=1e-12)
    raw = np.random.default_rng(0).normal(size=(200, 6))
    found = r.sixd_to_matrix(raw)
    np.testing.assert_allclose(found @ found.swapaxes(-1, -2), np.broadcast_to(np.eye(3), found.shape), atol=1e-10)
    np.testing.assert_allclose(np.linalg.det(found), 1, atol=1e-10)
    columns, triangle = np.linalg.qr(raw.reshape(-1, 2, 3).swapaxes(1, 2))  # of any sign
    columns = columns * np.sign(np.linalg.diagonal(triangle))[:, None]
    np.testing.assert_allclose(found[..., :2], columns, atol=1e-10)


def test_euler_angles_equal_intrinsic_ones_of_scipy() -> None:
    rng = np.random.default_rng(0)
    angles = rng.uniform([-np.pi, -np.pi / 2, -np.pi], [np.pi, np.pi / 2, np.pi], (300, 3))
    for order in ORDERS:
        q = r.euler_to_quaternion(angles, order)
        assert_same_rotation(q, Rotation.from_euler(order, angles).as_quat(scalar_first=True))
        np.testing.assert_allclose(r.quaternion_to_euler(q, order), angles, atol=1e-9, err_msg=order)


def test_gimbal_lock_keeps_the_rotation() -> None:
    rng = np.random.default_rng(0)
    short_of = np.repeat([0.0, 1e-9, 1e-4], 50)
    angles = rng.uniform(-3, 3, (150, 3))
    angles[:, 1] = np.pi / 2 * (1 - short_of) * rng.choice([-1, 1], 150)
    for order in ORDERS:
        q = r.euler_to_quaternion(angles, order)
        found = r.quaternion_to_euler(q, order)
        assert np.isfinite(found).all(), order
        assert_same_rotation(r.euler_to_quaternion(found, order), q, 3e-6)
        assert (found[short_of == 0, 2] == 0).all(), order


def test_euler_angles_of_fewer_or_repeated_axes() -> None:
    angles = np.array([[0.3, -0.4]])
    assert_same_rotation(
        r.euler_to_quaternion(angles, "ZX"), Rotation.from_euler("ZX", angles).as_quat(scalar_first=True)
    )
    with pytest.raises(ValueError, match="'ZXZ' must name X, Y and Z once each"):
        r.quaternion_to_euler(IDENTITY, "ZXZ")


# Between rotations


def test_slerp_equals_scipy_on_the_shorter_arc() -> None:
    a, b = random_quaternion((50,), 0), random_quaternion((50,), 1)
    t = np.random.default_rng(2).uniform(size=50)
    found = r.slerp(a, b, t)
    for k in range(50):
        expected = Slerp([0, 1], scipy_rotation(np.stack([a[k], b[k]])))(t[k]).as_quat(scalar_first=True)
        assert_same_rotation(found[k], expected, 1e-9)
    assert_same_rotation(r.slerp(a, b, 0), a)
    assert_same_rotation(r.slerp(a, b, 1.0), b)
    assert_same_rotation(r.slerp(a, -b, 0.5), r.slerp(a, b, 0.5))
    assert_same_rotation(r.slerp(a, a, 0.3), a)


def test_geodesic_angle_equals_scipy() -> None:
    a, b = random_quaternion(seed=0), random_quaternion(seed=1)
    expected = (scipy_rotation(a).inv() * scipy_rotation(b)).magnitude()
    np.testing.assert_allclose(r.geodesic_angle(a, b), expected, atol=1e-9)
    np.testing.assert_allclose(r.geodesic_angle(a, -b), expected, atol=1e-9)
    np.testing.assert_allclose(r.geodesic_angle(a, -a), 0, atol=1e-12)


def test_shortest_arc_takes_one_direction_to_the_other() -> None:
    u, v = (np.random.default_rng(seed).normal(size=(500, 3)) for seed in range(2))
    q = r.shortest_arc(u, v)
    direction = v / np.linalg.norm(v, axis=-1, keepdims=True)
    found = r.quaternion_rotate(q, u) / np.linalg.norm(u, axis=-1, keepdims=True)
    np.testing.assert_allclose(found, direction, atol=1e-10)
    cosine = (u * v).sum(-1) / np.linalg.norm(u, axis=-1) / np.linalg.norm(v, axis=-1)
    np.testing.assert_allclose(r.geodesic_angle(np.broadcast_to(IDENTITY, q.shape), q), np.arccos(cosine), atol=1e-7)


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 1e-6, 3e-4, 1e-2])
def test_shortest_arc_of_opposite_directions(off: float) -> None:
    u = r.normalize(np.stack([*np.eye(3), *-np.eye(3), np.ones(3), [0.9, 0.1, -0.3]]))
    v = -u * np.cos(off) + r.normalize(np.cross(u, [0.3, 0.5, 0.8])) * np.sin(off)
    q = r.shortest_arc(u, v)
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1, atol=1e-12)
    np.testing.assert_allclose(r.quaternion_rotate(q, u), v, atol=1e-7)
    np.testing.assert_allclose(r.geodesic_angle(np.broadcast_to(IDENTITY, q.shape), q), np.pi - off, atol=1e-6)


def test_shortest_arc_of_zero_vectors_is_the_identity() -> None:
    np.testing.assert_array_equal(r.shortest_arc(np.zeros(3), np.ones(3)), IDENTITY)
    np.testing.assert_array_equal(r.shortest_arc(np.ones(3), np.zeros(3)), IDENTITY)


def test_swing_and_twist_recompose() -> None:
    q, axis = random_quaternion(), random_vector(seed=3)
    axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
    swing, twist = r.swing_twist(q, axis)
    assert_same_rotation(r.quaternion_multiply(swing, twist), q)
    np.testing.assert_allclose((swing[:, 1:] * axis).sum(-1), 0, atol=1e-12)
    np.testing.assert_allclose(np.cross(twist[:, 1:], axis), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(swing, axis=-1), 1, atol=1e-12)


def test_swing_of_half_a_turn_has_no_twist() -> None:
    q = np.array([0.0, 1.0, 0.0, 0.0])
    swing, twist = r.swing_twist(q, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_array_equal(twist, IDENTITY)
    assert_same_rotation(swing, q)


def test_a_turned_vector_is_at_the_angle_and_on_the_side_of_its_turn() -> None:
    rng = np.random.default_rng(4)
    axis, u = (r.normalize(rng.normal(size=(200, 3))) for _ in range(2))
    u = np.cross(axis, u) * rng.uniform(0.1, 9, (200, 1))
    angle = rng.uniform(-np.pi, np.pi, 200)
    v = r.quaternion_rotate(r.quaternion_exp(angle[:, None] * axis), u) * rng.uniform(0.1, 9, (200, 1))
    np.testing.assert_allclose(r.angle_about(axis, u, v), angle, atol=1e-9)
    np.testing.assert_allclose(r.angle_between(u, v), np.abs(angle), atol=1e-9)
    assert r.angle_between(np.zeros(3), np.ones(3)) == 0.0


def test_heading_is_the_yaw_of_yaw_then_pitch() -> None:
    rng = np.random.default_rng(0)
    angles = rng.uniform([-np.pi, -1.5], [np.pi, 1.5], (100, 2))
    yaw = np.zeros((100, 2))
    yaw[:, 0] = angles[:, 0]
    assert_same_rotation(r.heading(r.euler_to_quaternion(angles, "YX")), r.euler_to_quaternion(yaw, "YX"))


# NumPy and PyTorch

UNARY: dict[str, tuple[Callable[..., Any], Callable[[tuple[int, ...]], np.ndarray]]] = {
    "identity": (r.quaternion_identity, random_quaternion),
    "safe_norm": (r.safe_norm, random_vector),
    "normalize": (r.normalize, random_vector),
    "conjugate": (r.quaternion_conjugate, random_quaternion),
    "canonical": (r.quaternion_canonical, random_quaternion),
    "to_matrix": (r.quaternion_to_matrix, random_quaternion),
    "from_matrix": (r.matrix_to_quaternion, lambda shape: r.quaternion_to_matrix(random_quaternion(shape))),
    "exp": (r.quaternion_exp, random_vector),
    "log": (r.quaternion_log, random_quaternion),
    "to_sixd": (r.matrix_to_sixd, lambda shape: r.quaternion_to_matrix(random_quaternion(shape))),
    "from_sixd": (r.sixd_to_matrix, lambda shape: np.random.default_rng(0).normal(size=(*shape, 6))),
    "heading": (r.heading, random_quaternion),
    "to_euler": (lambda q: r.quaternion_to_euler(q, "ZXY"), random_quaternion),
    "from_euler": (lambda v: r.euler_to_quaternion(v, "ZXY"), random_vector),
}
BINARY: dict[str, tuple[Callable[..., Any], Callable[..., np.ndarray], Callable[..., np.ndarray]]] = {
    "dot": (r.dot, random_vector, random_vector),
    "cross": (r.cross, random_vector, random_vector),
    "multiply": (r.quaternion_multiply, random_quaternion, random_quaternion),
    "rotate": (r.quaternion_rotate, random_quaternion, random_vector),
    "slerp": (lambda a, b: r.slerp(a, b, 0.3), random_quaternion, random_quaternion),
    "shortest_arc": (r.shortest_arc, random_vector, random_vector),
    "swing": (lambda q, v: r.swing_twist(q, r.normalize(v))[0], random_quaternion, random_vector),
    "twist": (lambda q, v: r.swing_twist(q, r.normalize(v))[1], random_quaternion, random_vector),
    "angle_between": (r.angle_between, random_vector, random_vector),
    "angle_about": (lambda u, v: r.angle_about(r.normalize(r.cross(u, v)), u, v), random_vector, random_vector),
    "angle": (r.geodesic_angle, random_quaternion, random_quaternion),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_pytorch_gives_what_numpy_gives(shape: tuple[int, ...]) -> None:
    for name in [*UNARY, *BINARY]:
        check_pytorch(name, shape)


def check_pytorch(name: str, shape: tuple[int, ...]) -> None:
    if name in UNARY:
        function, make = UNARY[name]
        arguments = [make(shape)]
    else:
        function, first, second = BINARY[name]
        arguments = [first(shape, 0), second(shape, 1)]
    expected = function(*arguments)
    assert isinstance(expected, np.ndarray | np.float64)
    assert expected.shape[: len(shape)] == shape, name
    found = function(*(torch.tensor(argument) for argument in arguments))
    np.testing.assert_allclose(found.numpy(), expected, rtol=0, atol=1e-12, err_msg=name)
    single = function(*(torch.tensor(argument, dtype=torch.float32) for argument in arguments))
    assert single.dtype == torch.float32, name


def test_leading_axes_broadcast() -> None:
    q, v = random_quaternion((5, 1)), random_vector((1, 7))
    assert r.quaternion_rotate(q, v).shape == (5, 7, 3)
    assert r.quaternion_multiply(q, random_quaternion((1, 7))).shape == (5, 7, 4)


# Gradients


def test_gradients_agree_with_differences() -> None:
    away = np.random.default_rng(3).uniform(0.3, 1.2, (2, 3))
    for name in {*UNARY, *BINARY} - {"identity"}:
        check_gradients(name, away)


def check_gradients(name: str, away: np.ndarray) -> None:

    def tensor(make: Callable[..., np.ndarray], seed: int) -> torch.Tensor:
        values = away * (1 + 0.3 * seed) * np.array([1, -1, 1]) if make is random_vector else make((2,))
        if make is random_quaternion:
            values = random_quaternion((2,), 5 + seed)
        return torch.tensor(values, requires_grad=True)

    if name in UNARY:
        function, make = UNARY[name]
        arguments = (tensor(make, 0),)
    else:
        function, first, second = BINARY[name]
        arguments = (tensor(first, 0), tensor(second, 1))
    assert torch.autograd.gradcheck(function, arguments, atol=1e-5), name


IDENTITY_MATRIX = np.eye(3)
HARD_POINTS: dict[str, tuple[Callable[..., Any], list[Any]]] = {
    "exp at zero": (r.quaternion_exp, [np.zeros(3)]),
    "log at identity": (r.quaternion_log, [IDENTITY]),
    "log at the other identity": (r.quaternion_log, [-IDENTITY]),
    "log of half a turn": (r.quaternion_log, [np.array([0.0, 1.0, 0.0, 0.0])]),
    "quaternion of identity": (r.matrix_to_quaternion, [IDENTITY_MATRIX]),
    "quaternion of half a turn": (r.matrix_to_quaternion, [np.diag([1.0, -1.0, -1.0])]),
    "sixd of zero": (r.sixd_to_matrix, [np.zeros(6)]),
    "sixd of parallel columns": (r.sixd_to_matrix, [np.array([1.0, 0, 0, 2, 0, 0])]),
    "normalize zero": (r.normalize, [np.zeros(3)]),
    "safe norm of zero": (r.safe_norm, [np.zeros(3)]),
    "angle of equals": (r.geodesic_angle, [IDENTITY, IDENTITY]),
    "angle of opposites": (r.geodesic_angle, [IDENTITY, np.array([0.0, 0, 1, 0])]),
    "slerp of equals": (lambda a, b: r.slerp(a, b, 0.5), [IDENTITY, IDENTITY]),
    "arc of equals": (r.shortest_arc, [np.array([0.0, 1, 0]), np.array([0.0, 1, 0])]),
    "arc of opposites": (r.shortest_arc, [np.array([0.0, 1, 0]), np.array([0.0, -1, 0])]),
    "arc of zeros": (r.shortest_arc, [np.zeros(3), np.zeros(3)]),
    "heading of identity": (r.heading, [IDENTITY]),
    "heading of half a turn about x": (r.heading, [np.array([0.0, 1, 0, 0])]),
}


def test_gradients_are_finite_at_hard_points() -> None:
    for name, (function, values) in HARD_POINTS.items():
        arguments = [torch.tensor(value, dtype=torch.float32, requires_grad=True) for value in values]
        result = function(*arguments)
        assert torch.isfinite(result).all(), name
        result.sum().backward()
        for argument in arguments:
            assert argument.grad is not None and torch.isfinite(argument.grad).all(), name


def test_gradient_of_exp_and_log_at_identity_is_the_identity() -> None:
    zero = torch.zeros(3, dtype=torch.float64)
    jacobian = torch.autograd.functional.jacobian(lambda v: r.quaternion_log(r.quaternion_exp(v)), zero)
    np.testing.assert_allclose(np.asarray(jacobian), np.eye(3), atol=1e-12)
