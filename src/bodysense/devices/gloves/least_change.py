"""The smallest change that meets linear demands: a small quadratic program, solved exactly."""

from __future__ import annotations

import numpy as np

_ROUNDS = 3  # of fixing what has reached a bound
_TRIES = 3  # block exchanges that may fail to improve before single ones
_MOST_EXCHANGES = 60  # then what is found so far must do


def least_change(
    rows: np.ndarray,
    demand: np.ndarray,
    exact: np.ndarray,
    ease: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    softness: np.ndarray,
) -> np.ndarray:
    """The x (N,) that makes Σ x² / ease smallest with rows · x ≥ demand, or = demand where `exact`.

    Args:
        rows: (K, N).
        demand: (K,).
        exact: (K,) bool.
        ease: (N,) how easily each part changes; 0 if it may not.
        bounds: (N,), (N,) smallest and largest x, 0 between them; they come before demands.
        softness: (K,) > 0: a demand is missed by softness times the force that it takes.
    """
    low, high = bounds
    x = fixed = np.zeros_like(ease)
    moving = ease
    for _ in range(_ROUNDS):
        eased = rows * moving
        matrix = eased @ rows.T
        matrix[np.diag_indices_from(matrix)] += softness
        x = fixed + forces(matrix, demand - rows @ fixed, exact) @ eased
        over = ((x < low) | (x > high)) & (moving > 0)
        if not over.any():
            return x
        fixed = np.where(over, np.clip(x, low, high), fixed)
        moving = np.where(over, 0.0, moving)
    return np.clip(x, low, high)


def forces(matrix: np.ndarray, demand: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """The f (K,) with matrix · f ≥ demand, f ≥ 0, one of both an equation; equations alone where `exact`.

    `matrix` (K, K) is symmetric and positive definite. Block principal pivoting (Júdice and Pires, 1994): it does not
    depend on the order of the demands.
    """
    pushing = exact | (demand > 0)
    force = np.zeros_like(demand)
    fewest, tries = len(demand) + 1, _TRIES
    for _ in range(_MOST_EXCHANGES):
        chosen = np.flatnonzero(pushing)
        force[:] = 0.0
        if chosen.size:
            force[chosen] = np.linalg.solve(matrix[np.ix_(chosen, chosen)], demand[chosen])
        short = matrix @ force - demand
        wrong = np.where(pushing, force < -1e-12, short < -1e-12) & ~exact
        count = int(wrong.sum())
        if not count:
            break
        if count < fewest:
            fewest, tries = count, _TRIES
        elif tries:
            tries -= 1
        else:
            last = np.flatnonzero(wrong)[-1]
            wrong[:] = False
            wrong[last] = True
        pushing ^= wrong
    return np.where(exact, force, np.maximum(force, 0.0))
