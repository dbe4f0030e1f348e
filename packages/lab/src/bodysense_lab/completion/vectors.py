"""Vectors and rotations as the graph of a completion step holds them, and what is done with them in few operations.

Vectors are (B, 1, N, 3). Rotations are *axes* (B, 3, N, 3): axis k of joint n in the world, which is column k of its
matrix world ← joint. With the kind of axis first, operations on all joints are long rows of additions and products, and
a vector stands beside the axes without a change of shape. A scalar of each vector is (B, 1, N, 1), or (B, 1, N, 3),
thrice the same, where that saves operations.
"""

from __future__ import annotations

import torch
from torch import Tensor

TINY = 1e-12
_ONES = torch.ones(3, 3)
# Vectors @ `_SPREAD[k]` is component k thrice.
_SPREAD = torch.eye(3).unsqueeze(-1).expand(3, 3, 3).contiguous()
# a × b is the difference of two products, of the components of a and of b in these orders.
_LEFT = torch.eye(3)[:, [1, 2, 0, 2, 0, 1]]
_RIGHT = torch.eye(3)[:, [2, 0, 1, 1, 2, 0]]
_DIFFERENCE = torch.cat([torch.eye(3), -torch.eye(3)])
# What makes opposite directions turn about some axis across them; it counts for nothing beside any other two.
ASIDE = torch.eye(3) + 3e-5 * torch.tensor([[0.0, -0.8, 0.5], [0.8, 0.0, -0.4], [-0.5, 0.4, 0.0]])
# The cosine is the x axis's x and the z axis's z, the sine the z axis's x less the x axis's z.
_AXES_TO_HEADING = torch.tensor([[[1.0, 0], [0, 0], [0, -1]], [[0, 0], [0, 0], [0, 0]], [[0, 1], [0, 0], [1, 0]]])
_NO_BONE = torch.tensor([3e-9, 4e-9, 5e-9]).reshape(3, 1, 1)  # m: gives a bone without length a direction


def length(vector: Tensor) -> Tensor:
    """(..., 3) → (..., 1)."""
    return torch.linalg.vector_norm(vector, dim=-1, keepdim=True)


def unit(vector: Tensor) -> Tensor:
    """(..., 3) of length one; zero stays zero."""
    return vector / length(vector).clamp(min=TINY)


def dot(a: Tensor, b: Tensor) -> Tensor:
    """(..., 3), (..., 3) → (..., 3): the product, thrice."""
    return (a * b) @ _ONES


def cross(a: Tensor, b: Tensor) -> Tensor:
    """(..., 3), (..., 3) → (..., 3)."""
    return ((a @ _LEFT) * (b @ _RIGHT)) @ _DIFFERENCE


def across(vector: Tensor, normal: Tensor) -> Tensor:
    """The part of (..., 3) that is perpendicular to a unit `normal` (..., 3)."""
    return vector - normal * dot(vector, normal)


def replaced(vector: Tensor, other: Tensor, by: Tensor) -> Tensor:
    """(..., 3), or `other` where `by` is 1, not 0: quicker than a choice."""
    return vector + by * (other - vector)


def thrice(scalar: Tensor) -> Tensor:
    """(..., 1) → (..., 3)."""
    return scalar @ _ONES[:1]


def frames(first: Tensor, second: Tensor) -> Tensor:
    """Axes (B, 3, N, 3): x along `first` (B, 1, N, 3), y toward `second` (B, 1, N, 3)."""
    x = unit(first)
    y = unit(across(second, x))
    return torch.cat([x, y, cross(x, y)], dim=1)


def spread(rest_offset: Tensor) -> Tensor:
    """Bones at rest (B, 1, N, 3) → (B, 3, N, 3): component k thrice, to go with axis k. None is without length."""
    return rest_offset @ _SPREAD + _NO_BONE


def carried(axes: Tensor, rest: Tensor) -> Tensor:
    """Bones (B, 1, N, 3) that joints with `axes` (B, 3, N, 3) carry, of bones at rest as `spread`."""
    return (axes * rest).sum(dim=1, keepdim=True)


def turned_onto(axes: Tensor, before: Tensor, after: Tensor) -> Tensor:
    """Axes (B, 3, N, 3) after the smallest turns that take directions `before` (B, 1, N, 3) onto `after`.

    Two reflections make a turn, so that a rotation stays one to rounding. `before` is never zero; where `after` is,
    nothing turns. Opposite directions turn about some axis across them.
    """
    begin = unit(before)
    middle = unit(begin @ ASIDE + unit(after))
    return reflected(reflected(axes, begin), middle)


def reflected(vector: Tensor, normal: Tensor) -> Tensor:
    """Vectors (..., 3) mirrored at the plane across a unit `normal` (..., 3)."""
    return vector - normal * ((vector * normal) @ (2 * _ONES))


def axes_of(quaternion: Tensor) -> Tensor:
    """Unit quaternions wxyz (B, N, 4) → axes (B, 3, N, 3)."""
    sums = quaternion.unsqueeze(1) @ _PAIRS
    return (sums * sums) @ _SQUARES_TO_AXES


def heading_of(axes: Tensor) -> Tensor:
    """Twist about +Y (B, N, 2), as cosine and sine times the same, of axes (B, 3, N, 3).

    It is steady when a head looks up or down.
    """
    return (axes @ _AXES_TO_HEADING).sum(dim=1)


def quaternion_between(parent: Tensor, child: Tensor) -> Tensor:
    """Quaternions wxyz (B, N, 4) parent ← child, w ≥ 0, of axes (B, 3, N, 3) of both in one frame.

    Of four forms that no cancellation spoils at once, the one with the largest part is taken.
    """
    entries = (child.unsqueeze(2) * parent.unsqueeze(1)) @ _ONES[:, :1]  # [k][c]: axis k of the child along axis c
    forms = _ENTRIES_TO_FORMS @ entries.reshape(-1, 9, child.shape[2]) + _FORMS_CONSTANT
    # Row 4 c + k is four times q_k q_c: of k with the largest q_k all c.
    largest = forms.index_select(1, _FORMS_DIAGONAL).argmax(dim=1, keepdim=True)
    q = forms.gather(1, largest + _FORMS_ROWS)
    q = q * torch.where(q[:, :1] < 0, -1.0, 1.0)
    return unit(q.transpose(1, 2))


def _matrix_of_products() -> Tensor:
    """(4, 4, 3, 3): what the products q_a q_b add to the entries [k][c] of axis k, component c."""
    table = torch.zeros(4, 4, 3, 3)
    for part, sign in ((0, (1, 1, 1)), (1, (1, -1, -1)), (2, (-1, 1, -1)), (3, (-1, -1, 1))):
        for axis in range(3):
            table[part, part, axis, axis] = sign[axis]
    for a, b in ((1, 2), (1, 3), (2, 3)):
        table[a, b, a - 1, b - 1] = table[a, b, b - 1, a - 1] = 2
    for part, (c, k) in ((3, (1, 0)), (2, (0, 2)), (1, (2, 1))):
        table[0, part, k, c], table[0, part, c, k] = 2, -2
    return table


def _from_squares() -> tuple[Tensor, Tensor]:
    """(4, 10) sums of parts of a quaternion, and (3, 10, 3): their squares → axes.

    q_a q_b is half of (q_a + q_b)² − q_a² − q_b²: squares of sums need one product where all pairs would need more.
    """
    table = _matrix_of_products()
    pairs = [(a, b) for a in range(4) for b in range(a + 1, 4)]
    sums, axes = torch.zeros(4, 10), torch.zeros(10, 3, 3)
    for a in range(4):
        sums[a, a] = 1
        axes[a] += table[a, a]
    for k, (a, b) in enumerate(pairs, start=4):
        sums[a, k] = sums[b, k] = 1
        axes[k] += table[a, b] / 2
        axes[a] -= table[a, b] / 2
        axes[b] -= table[a, b] / 2
    return sums, axes.transpose(0, 1).contiguous()


def _to_forms() -> tuple[Tensor, Tensor]:
    """(16, 9) and (16, 1): entries [k][c] of a matrix → row 4 c + k, four times q_k q_c."""
    table, constant = torch.zeros(4, 4, 3, 3), torch.eye(4)
    for part, sign in ((0, (1, 1, 1)), (1, (1, -1, -1)), (2, (-1, 1, -1)), (3, (-1, -1, 1))):
        for axis in range(3):
            table[part, part, axis, axis] = sign[axis]
    for a, b in ((1, 2), (1, 3), (2, 3)):
        for k, c in ((a - 1, b - 1), (b - 1, a - 1)):
            table[a, b, k, c] = table[b, a, k, c] = 1
    for part, (c, k) in ((3, (1, 0)), (2, (0, 2)), (1, (2, 1))):
        for p, q in ((0, part), (part, 0)):
            table[p, q, k, c], table[p, q, c, k] = 1, -1
    return table.reshape(16, 9), constant.reshape(16, 1)


_PAIRS, _SQUARES_TO_AXES = _from_squares()
_ENTRIES_TO_FORMS, _FORMS_CONSTANT = _to_forms()
_FORMS_DIAGONAL = torch.arange(4) * 5
_FORMS_ROWS = torch.arange(0, 16, 4).unsqueeze(-1)
