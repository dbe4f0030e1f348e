"""Nearest points of segments."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.geometry.segments import nearest_shares


def shares(p: np.ndarray, u: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.sum(a * b, axis=-1)

    return nearest_shares(dot(u, u), dot(v, v), dot(u, v), dot(u, p - q), dot(v, p - q))


@pytest.mark.parametrize("kind", ["any", "parallel", "a point", "two points"])
def test_no_two_points_are_nearer(kind: str) -> None:
    rng = np.random.default_rng(0)
    p, u, q, v = rng.normal(size=(4, 60, 3))
    if kind == "parallel":
        v = u * rng.uniform(-2, 2, size=(60, 1))
    if kind in ("a point", "two points"):
        v = np.zeros_like(v)
    if kind == "two points":
        u = np.zeros_like(u)
    s, t = shares(p, u, q, v)
    assert (s >= 0).all() and (s <= 1).all() and (t >= 0).all() and (t <= 1).all()
    found = np.linalg.norm(p + s[:, None] * u - q - t[:, None] * v, axis=-1)
    along = np.linspace(0, 1, 101)
    one = p[:, None] + along[:, None] * u[:, None]
    other = q[:, None] + along[:, None] * v[:, None]
    sampled = np.linalg.norm(one[:, :, None] - other[:, None], axis=-1).min(axis=(1, 2))
    assert (found <= sampled + 1e-9).all()
    np.testing.assert_allclose(found, sampled, atol=0.06)  # half a step on either segment, at most
