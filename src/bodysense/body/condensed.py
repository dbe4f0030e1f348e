"""The normal equations of a tree of bones, solved with its terminal chains condensed onto the trunk.

The unknowns are the root's move and one world turn φ a joint. A point is `root + Σ bones`, so ∂pᵢ/∂φⱼ = −[b]× with b
the bone that leaves joint j on the way to point i. A terminal chain (a finger, a leg below the hip, neck and head)
meets the rest of the body in the move of its base point and the turn of the joint above only: eliminating its own
turns, a batched Schur complement over all chains, leaves a dense system for the trunk and the arms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import Skeleton

_CHAIN = 3  # joints of a terminal chain at most, a finger's: longer ones would pad all others
_ENDS = 7  # unknowns after elimination: its base point's move, the turn of the joint above, and 1 for the right side
_ZERO_ONE = np.array([0.0, 1.0])
_CROSS = ((0, 3, -2), (-3, 0, 1), (2, -1, 0))  # −[b]×: ±(1 + component); 0 is a zero


@dataclass(frozen=True, eq=False)
class CondensedSystem:
    """Layout of the equations of one skeleton: C chains, padded to one size, and the trunk.

    Rows are three a point (weighted), then three a joint for its spring. All their entries are gathered at once from
    the source [0, 1, bones, −bones, spring slopes, −slopes, point errors, spring errors].
    """

    inner: int  # columns of a chain that are eliminated
    chain: np.ndarray  # (C, rows, inner + 7) into the source
    chain_row: np.ndarray  # (C, rows, 1) into [0, 1, weights]
    chain_padding: np.ndarray  # (C, inner, inner) ones on the diagonal of a chain's padding
    chain_lever: np.ndarray  # (C, inner, inner) squared levers on the diagonal
    chain_block: tuple[np.ndarray, np.ndarray]  # joints (N,) and the indices (N, 12) of their block and right side
    own: int  # rows of the trunk before those of the chains' ends
    trunk: np.ndarray  # (own + 7 C, n + 1) into the source
    trunk_row: np.ndarray  # (own + 7 C, 1) into [0, 1, weights]
    trunk_lever: np.ndarray  # (n, n) squared levers on the diagonal
    trunk_block: tuple[np.ndarray, np.ndarray]
    turn: np.ndarray  # (J, 3) into [trunk unknowns, 1, chain turns]

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
            slope: (J, 3, 3), transposed derivatives of the springs by the joint's own turn.
            spring: (J, 3), how far the springs are stretched.
            block: (J, 12), B and b of every joint, as (3, 4) row by row.
            damping: on the move, and on every turn times its squared lever.

        Returns:
            The root's move (3,) m and the joints' turns (J, 3) rad, world.
        """
        bone, slope = bone.ravel(), slope.ravel()
        source = np.concatenate((_ZERO_ONE, bone, -bone, slope, -slope, error.ravel(), spring.ravel()))
        row_weight = np.concatenate((_ZERO_ONE, weight))

        rows = source.take(self.chain)
        normal = rows.mT @ (rows * row_weight.take(self.chain_row))
        _add(normal, self.chain_block, block)
        inner = self.inner
        own_turns = normal[:, :inner, :inner] + self.chain_padding + damping * self.chain_lever
        eliminated = np.linalg.solve(own_turns, normal[:, :inner, inner:])
        condensed = normal[:, inner:, inner:] - normal[:, inner:, :inner] @ eliminated

        rows = source.take(self.trunk)
        width = rows.shape[1]
        ends = rows[self.own :].reshape(-1, _ENDS, width)
        weighted = rows * row_weight.take(self.trunk_row)
        weighted[self.own :] = (condensed @ ends).reshape(-1, width)
        normal = rows.T @ weighted
        _add(normal, self.trunk_block, block)
        solution = np.ones(width)
        solution[:-1] = np.linalg.solve(normal[:-1, :-1] + damping * self.trunk_lever, -normal[:-1, -1])
        chain = eliminated @ (ends @ solution)[:, :, None]
        return solution[:3], np.concatenate((solution, -chain.ravel())).take(self.turn)


def condensed_system(skeleton: Skeleton, lever: np.ndarray) -> CondensedSystem:
    """Split a skeleton into terminal chains and the trunk, and build the layout; lever (J,) m."""
    joints = len(skeleton.joints)
    place = _Places(skeleton)
    chains = _terminal_chains(skeleton)
    on_path = skeleton.path.astype(bool)
    hanging = [[p for p in range(len(skeleton.points)) if p == c[0] or on_path[p, c[0]]] for c in chains]
    in_chain = np.isin(np.arange(joints), [joint for chain in chains for joint in chain])
    trunk_joints = [joint for joint in range(joints) if not in_chain[joint]]
    held = {point for points in hanging for point in points}
    trunk_points = [point for point in range(len(skeleton.points)) if point not in held]
    bases = [members[0] for members in chains]
    own, trunk, trunk_row = _trunk_rows(skeleton, place, trunk_joints, trunk_points, bases)

    count, longest, most = len(chains), max(map(len, chains), default=0), max(map(len, hanging), default=0)
    inner, unknowns = 3 * longest, 3 + 3 * len(trunk_joints)
    chain = np.zeros((count, 3 * (most + longest), inner + _ENDS), dtype=np.intp)
    chain_row = np.zeros((count, 3 * (most + longest), 1), dtype=np.intp)
    padding, levers = np.ones((count, inner)), np.zeros((count, inner))
    turn, blocks = np.zeros((joints, 3), dtype=np.intp), np.zeros((joints, 12), dtype=np.intp)
    for k, joint in enumerate(trunk_joints):
        turn[joint] = 3 + 3 * k + np.arange(3)
        blocks[joint] = _block_places(3 + 3 * k, unknowns + 1)
    for c, (members, points) in enumerate(zip(chains, hanging, strict=True)):
        for k, point in enumerate(points):
            rows = _three(k)
            chain[c, rows, inner : inner + 3] = np.eye(3)
            chain[c, rows, -1] = place.error(point)
            chain_row[c, rows] = 2 + point
            for a, joint in enumerate(members):
                chain[c, rows, _three(a)] = place.lever_arm(point, joint)
        for a, joint in enumerate(members):
            rows = _three(most + a)
            above = _three(a - 1) if a else slice(inner + 3, inner + 6)
            chain[c, rows, _three(a)], chain[c, rows, above] = place.slopes(joint)
            chain[c, rows, -1] = place.spring(joint)
            chain_row[c, rows] = 1
            padding[c, _three(a)], levers[c, _three(a)] = 0, lever[joint] ** 2
            turn[joint] = unknowns + 1 + inner * c + 3 * a + np.arange(3)
            blocks[joint] = _block_places(3 * a, inner + _ENDS) + c * (inner + _ENDS) ** 2

    return CondensedSystem(
        inner=inner,
        chain=chain,
        chain_row=chain_row,
        chain_padding=padding[:, :, None] * np.eye(inner),
        chain_lever=levers[:, :, None] * np.eye(inner),
        chain_block=(np.flatnonzero(in_chain), blocks[in_chain]),
        own=own,
        trunk=trunk,
        trunk_row=trunk_row,
        trunk_lever=np.diag(np.concatenate([np.ones(3), np.repeat(lever[trunk_joints] ** 2, 3)])),
        trunk_block=(np.flatnonzero(~in_chain), blocks[~in_chain]),
        turn=turn,
    )


def _trunk_rows(
    skeleton: Skeleton, place: _Places, joints: list[int], points: list[int], bases: list[int]
) -> tuple[int, np.ndarray, np.ndarray]:
    """Return the number of the trunk's own rows, these and `_ENDS` for every chain's base, and indices of weights."""
    column = {joint: _three(1 + k) for k, joint in enumerate(joints)}
    own = 3 * (len(points) + len(joints))
    trunk = np.zeros((own + _ENDS * len(bases), 3 + 3 * len(joints) + 1), dtype=np.intp)
    row = np.zeros((own + _ENDS * len(bases), 1), dtype=np.intp)
    starts = [3 * k for k in range(len(points))] + [own + _ENDS * c for c in range(len(bases))]
    for start, point in zip(starts, points + bases, strict=True):
        rows = slice(start, start + 3)
        trunk[rows, :3] = np.eye(3)
        for joint in joints:
            trunk[rows, column[joint]] = place.lever_arm(point, joint)
        if start < own:
            trunk[rows, -1] = place.error(point)
            row[rows] = 2 + point
        else:
            trunk[start + 3 : start + 6, column[skeleton.parents[point]]] = np.eye(3)
            trunk[start + 6, -1] = 1
    for k, joint in enumerate(joints):
        rows = _three(len(points) + k)
        trunk[rows, column[joint]], above = place.slopes(joint)
        if joint:
            trunk[rows, column[skeleton.parents[joint]]] = above
        trunk[rows, -1] = place.spring(joint)
        row[rows] = 1
    return own, trunk, row


def _terminal_chains(skeleton: Skeleton) -> list[list[int]]:
    """Return chains of joints from the last branch of a limb to its end, at most the last `_CHAIN`; never the root."""
    joints = len(skeleton.joints)
    children = [[c for c in range(1, joints) if skeleton.parents[c] == joint] for joint in range(joints)]
    length = [0] * joints  # joints from here to the end; 0 if they branch, or are too many
    for joint in reversed(range(1, joints)):
        below = [length[c] for c in children[joint]]
        if not below or (len(below) == 1 and 0 < below[0] < _CHAIN):
            length[joint] = 1 + sum(below)
    chains = []
    for joint in range(1, joints):
        if length[joint] and not length[skeleton.parents[joint]]:
            chain = [joint]
            while children[chain[-1]]:
                chain.append(children[chain[-1]][0])
            chains.append(chain)
    return chains


class _Places:
    """Indices of a skeleton's quantities in the source."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.parents = skeleton.parents
        self.path = skeleton.path
        points, joints = len(skeleton.points), len(skeleton.joints)
        self._negative = 3 * (points - 1)
        self._slope = 2 + 2 * self._negative
        self._joints = joints
        self._error = self._slope + 18 * joints
        self._spring = self._error + 3 * points

    def lever_arm(self, point: int, joint: int) -> np.ndarray:
        """Return the (3, 3) derivative of a point by a joint's turn: −[b]×, or zeros."""
        leaving = [int(k) for k in np.flatnonzero(self.path[point]) if self.parents[k] == joint]
        start = 2 + 3 * (leaving[0] - 1) if leaving else 0

        def place(signed: int) -> int:
            return start + abs(signed) - 1 + (self._negative if signed < 0 else 0) if signed and leaving else 0

        return np.array([[place(signed) for signed in row] for row in _CROSS])

    def slopes(self, joint: int) -> tuple[np.ndarray, np.ndarray]:
        """Return (3, 3) derivatives of a joint's spring by its own turn and by its parent's, transposed back."""
        own = self._slope + 9 * joint + np.arange(9).reshape(3, 3).T
        return own, own + 9 * self._joints

    def error(self, point: int) -> np.ndarray:
        return self._error + 3 * point + np.arange(3)

    def spring(self, joint: int) -> np.ndarray:
        return self._spring + 3 * joint + np.arange(3)


def _three(k: int) -> slice:
    return slice(3 * k, 3 * k + 3)


def _block_places(start: int, width: int) -> np.ndarray:
    """Return (12,) indices of a 3×3 diagonal block and its last column, row by row, in a matrix of `width`."""
    columns = np.array([start, start + 1, start + 2, width - 1])
    return (width * (start + np.arange(3))[:, None] + columns).ravel()


def _add(matrix: np.ndarray, places: tuple[np.ndarray, np.ndarray], block: np.ndarray) -> None:
    """Add joints' (J, 12) blocks at their indices in a matrix."""
    joints, index = places
    matrix.reshape(-1)[index] += block.take(joints, axis=0)
