"""The normal equations of a posed skeleton: how its root should move and its joints turn, to be close to targets.

The unknowns are the root's move and one world turn φ a joint. A point is `root + Σ bones`, so ∂pᵢ/∂φⱼ = −[b]× with b
the bone that leaves joint j on the way to point i.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.skeleton import Skeleton

_CROSS = np.zeros((3, 9))  # b @ _CROSS is −[b]×, row by row
_CROSS[[2, 1, 2, 0, 1, 0], [1, 2, 3, 5, 6, 7]] = [1, -1, -1, 1, 1, -1]


class NormalEquations:
    """The equations of one skeleton; immutable."""

    def __init__(self, skeleton: Skeleton, lever: np.ndarray) -> None:
        """Prepare a skeleton whose joints have levers (J,) m, which make turns comparable with distances."""
        joints = len(skeleton.joints)
        parents = np.array(skeleton.parents)
        self._joint = 1 + np.arange(joints)  # place among the unknowns, after the root's move
        self._above = 1 + np.maximum(parents[:joints], 0)
        point, end = np.nonzero(skeleton.path)
        self._point, self._bone, self._turned = point, end - 1, 1 + parents[end]
        self._children = (np.arange(joints)[:, None] == self._above - 1).astype(float)
        self._jacobian = np.zeros((len(skeleton.points), 3, 1 + joints, 3))
        self._jacobian[:, :, 0] = np.eye(3)
        self._damping = np.concatenate([np.ones(3), np.repeat(lever**2, 3)])

    def solve(
        self,
        *,
        bone: np.ndarray,
        error: np.ndarray,
        weight: np.ndarray,
        slope: np.ndarray,
        spring: np.ndarray,
        block: np.ndarray,
        damping: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Minimise Σ wᵢ |pᵢ + dpᵢ − tᵢ|² + Σ |spring + slopeᵀ (φⱼ − φ_parent)|² + Σ (φⱼᵀ B φⱼ + 2 bᵀ φⱼ) + damping.

        Args:
            bone: (P − 1, 3) m, world, from its parent to every point but the root.
            error: (P, 3) m, points minus targets.
            weight: (P,).
            slope: (J, 3, 3), transposed derivatives of the springs by the joint's own turn; the root's are 0.
            spring: (J, 3), how far the springs are stretched.
            block: (J, 3, 4), B and b of every joint.
            damping: on the move, and on every turn times its squared lever.

        Returns:
            The root's move (3,) m and the joints' turns (J, 3) rad, world.
        """
        joint, above, count = self._joint, self._above, len(self._joint)
        jacobian = self._jacobian.copy()
        jacobian[self._point, :, self._turned] = (bone @ _CROSS).reshape(-1, 3, 3).take(self._bone, axis=0)
        root = np.sqrt(weight)[:, None]
        jacobian *= root[..., None, None]
        rows = jacobian.reshape(error.size, -1)
        normal, gradient = rows.T @ rows, ((root * error).ravel() @ rows).reshape(-1, 3)

        stiff = slope @ slope.mT
        pulled = (slope @ spring[:, :, None])[:, :, 0]
        blocks = normal.reshape(1 + count, 3, 1 + count, 3)
        blocks[joint, :, joint] += (
            stiff + block[:, :, :3] + (self._children @ stiff.reshape(count, 9)).reshape(-1, 3, 3)
        )
        blocks[joint[1:], :, above[1:]] -= stiff[1:]
        blocks[above[1:], :, joint[1:]] -= stiff[1:]
        gradient[1:] += pulled + block[:, :, 3] - self._children @ pulled

        normal.reshape(-1)[:: normal.shape[0] + 1] += damping * self._damping
        solution = np.linalg.solve(normal, -gradient.ravel())
        return solution[:3], solution[3:].reshape(-1, 3)
