"""Normal equations of a posed skeleton: the move of the root and turns of the joints that bring it close to targets.

The unknowns are the move of the root and one world turn φ for each joint. Joint c moves with its parent j by
m_c = m_j − [b]× φ_j, with b the bone between them. So the least cost of a joint's subtree is a quadratic form of its
move and turn. From the tips to the root the turn of each joint is eliminated; from the root to the tips it is solved.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.skeleton import Skeleton

_CROSS = np.zeros((3, 9))  # b @ _CROSS is −[b]×, row by row
_CROSS[[2, 1, 2, 0, 1, 0], [1, 2, 3, 5, 6, 7]] = [1, -1, -1, 1, 1, -1]
# A form is a symmetric matrix (7, 7) of a joint's move, its turn, and 1; with its parent's turn before the 1, (10, 10).
_MOVE, _TURN, _ONE = slice(0, 3), slice(3, 6), 6
_OWN = np.array([0, 1, 2, 7, 8, 9, 6])  # of a joint's form in that with its parent's turn


class NormalEquations:
    """The equations of one skeleton; immutable."""

    def __init__(self, skeleton: Skeleton, lever: np.ndarray) -> None:
        """Prepare a skeleton whose joints have levers (J,) m, which make turns comparable with distances."""
        joints = len(skeleton.joints)
        parents = np.array(skeleton.parents)
        carrier = np.concatenate([np.arange(joints), parents[joints:]])
        self._carried = (np.arange(joints)[:, None] == carrier).astype(float)  # (J, P)
        self._square = lever[:, None, None] ** 2 * np.eye(3)
        self._levels = [
            (level, parents[level], (np.arange(joints)[:, None] == parents[level]).astype(float))
            for level, _ in skeleton.levels[1:]
        ]

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
        joints, points = len(slope), len(error)
        swing = np.concatenate([np.zeros((1, 9)), bone @ _CROSS]).reshape(points, 3, 3)
        rows = np.zeros((points, 3, 7))
        rows[:, :, _MOVE], rows[joints:, :, _TURN], rows[:, :, _ONE] = np.eye(3), swing[joints:], error
        form = (self._carried @ ((rows * weight[:, None, None]).mT @ rows).reshape(points, 49)).reshape(joints, 7, 7)
        form[:, _TURN, _TURN] += block[:, :, :3] + damping * self._square
        form[:, _TURN, _ONE] += block[:, :, 3]
        form[:, _ONE, _TURN] += block[:, :, 3]
        stretch = np.zeros((joints, 3, 10))
        stretch[:, :, 3:6], stretch[:, :, 6], stretch[:, :, 7:] = -slope.mT, spring, slope.mT
        stretch = stretch.mT @ stretch

        gain = []
        for level, _, hung in reversed(self._levels):
            whole = stretch[level]
            whole[:, _OWN[:, None], _OWN] += form[level]
            turn = -np.linalg.solve(whole[:, 7:, 7:], whole[:, 7:, :7])  # by the joint's move, its parent's turn, and 1
            left = whole[:, :7, :7] + whole[:, :7, 7:] @ turn
            left[:, :, _TURN] += left[:, :, _MOVE] @ swing[level]
            left[:, _TURN] += swing[level].mT @ left[:, _MOVE]
            form += (hung @ left.reshape(len(level), 49)).reshape(joints, 7, 7)
            gain.append(turn)

        found = np.ones((joints, 7))
        first = form[0, :6, :6].copy()
        first[_MOVE, _MOVE] += damping * np.eye(3)
        found[0, :6] = -np.linalg.solve(first, form[0, :6, 6])
        for (level, above, _), turn in zip(self._levels, reversed(gain), strict=True):
            after = found[above]
            after[:, _MOVE] += (swing[level] @ after[:, _TURN, None])[:, :, 0]
            found[level, _TURN] = (turn @ after[:, :, None])[:, :, 0]
            found[level, _MOVE] = after[:, _MOVE]
        return found[0, _MOVE], found[:, _TURN]
