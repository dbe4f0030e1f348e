"""The quadratic program of contact, against SciPy's general solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from bodysense.devices.gloves.contact_rows import least_change

SOFTNESS = 1e-9
WIDE = (np.full(8, -np.inf), np.full(8, np.inf))


def problem(seed: int, demands: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(demands, 8)), rng.normal(size=demands), rng.uniform(0.1, 1.0, size=8)


@pytest.mark.parametrize("seed", range(6))
def test_the_change_is_the_smallest_that_meets_the_demands(seed: int) -> None:
    rows, demand, compliance = problem(seed, 6)
    exact = np.arange(6) == 0
    found = least_change(rows, demand, exact, compliance, WIDE, np.full(6, SOFTNESS))
    best = minimize(
        lambda x: float((x * x / compliance).sum()),
        np.zeros(8),
        constraints=[
            {"type": "eq", "fun": lambda x: rows[0] @ x - demand[0]},
            {"type": "ineq", "fun": lambda x: rows[1:] @ x - demand[1:]},
        ],
        method="SLSQP",
        tol=1e-12,
    )
    np.testing.assert_allclose(found, best.x, atol=1e-4)
    assert rows[0] @ found == pytest.approx(demand[0], abs=1e-6)
    assert (rows[1:] @ found >= demand[1:] - 1e-6).all()


def test_met_demands_cause_no_change() -> None:
    rows, demand, compliance = problem(9, 4)
    found = least_change(rows, -np.abs(demand), np.zeros(4, bool), compliance, WIDE, np.full(4, SOFTNESS))
    np.testing.assert_array_equal(found, 0)


def test_bounds_precede_demands_and_fixed_parts_do_not_move() -> None:
    rows, demand, compliance = problem(3, 4)
    compliance[2] = 0.0
    bounds = (np.full(8, -0.2), np.full(8, 0.3))
    found = least_change(rows, 5 + np.abs(demand), np.zeros(4, bool), compliance, bounds, np.full(4, 1e-3))
    assert (found >= -0.2).all() and (found <= 0.3).all() and found[2] == 0
    assert np.isin(found, [-0.2, 0.3]).any()
