"""Least squares over frames: a pose of every frame, and parameters that all frames share.

Gauss-Newton with numerical derivatives and Levenberg's damping. A Schur complement eliminates the poses, so that a step
solves one small system for each frame and one for the parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bodysense.devices.gloves.hand_model import POSE, apply_change

_STEP = 1e-5  # step of the numerical derivative, in a parameter's unit, rad or m
_DONE = 1e-4  # share of the cost; a smaller gain ends the iteration


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Residuals of K frames, in standard deviations, and the weights of the parameters' prior."""

    residuals: Callable[[np.ndarray, np.ndarray], np.ndarray]  # (..., N) parameters, (..., K, 32) poses → (..., K, R)
    prior: np.ndarray  # (N,) standard deviations per unit

    def cost(self, theta: np.ndarray, pose: np.ndarray) -> float:
        """Return the cost; half of it is the negative logarithm of the likelihood."""
        return float((self.residuals(theta, pose) ** 2).sum() + ((self.prior * theta) ** 2).sum())

    def refine(
        self, theta: np.ndarray, pose: np.ndarray, steps: int, damping: float
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Return parameters, poses and their cost after at most `steps` steps; steps that raise the cost are undone."""
        cost = self.cost(theta, pose)
        for _ in range(steps):
            trial = self.step(theta, pose, damping)
            new = self.cost(*trial)
            if new < cost:
                done = cost - new < _DONE * cost
                (theta, pose), cost, damping = trial, new, damping / 4
                if done:
                    break
            else:
                damping *= 6
        return theta, pose, cost

    def step(self, theta: np.ndarray, pose: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """Return parameters (N,) and poses (K, 32) after one step."""
        count = len(theta)
        shift = np.concatenate([np.zeros((1, count + POSE)), _STEP * np.eye(count + POSE)])[:, None]
        now, *after = self.residuals(theta + shift[..., :count], apply_change(pose, shift[..., count:]))
        slope = (np.stack(after, axis=-1) - now[..., None]) / _STEP  # (K, R, N + 32)
        common, own = slope[..., :count], slope[..., count:]
        drawn = own.swapaxes(1, 2) @ np.concatenate([own, common, now[..., None]], axis=-1)
        inner, across = drawn[..., :POSE], drawn[..., POSE:]
        inner += damping * inner * np.eye(POSE) + 1e-9 * np.eye(POSE)
        solved = np.linalg.solve(inner, across)
        # One large product over all frames is faster than many small ones.
        every, poses = common.reshape(now.size, count), pose.size
        left = across[..., :-1].reshape(poses, count).T @ solved.reshape(poses, count + 1)
        outer = every.T @ every + np.diag(self.prior**2)
        outer += damping * outer * np.eye(count)
        outer -= left[:, :-1]
        slope = every.T @ now.ravel() + self.prior**2 * theta - left[:, -1]
        change = -np.linalg.solve(outer, slope)
        return theta + change, apply_change(pose, -(solved[..., -1] + solved[..., :-1] @ change))
