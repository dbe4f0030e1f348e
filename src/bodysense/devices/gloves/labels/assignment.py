"""Linear assignment: one column for each row, all different, at the least total cost."""

from __future__ import annotations

import numpy as np


def assignment(cost: np.ndarray) -> np.ndarray:
    """Return different columns (R,) for R rows with the least sum of costs (R, C), R ≤ C; −1 if a cost is infinite.

    Shortest augmenting paths (Jonker and Volgenant, 1987). If the cheapest columns of all rows differ, they are the
    result.
    """
    rows = len(cost)
    if not rows:
        return np.zeros(0, dtype=np.int64)
    nearest = cost.argmin(axis=1)
    if len(set(nearest.tolist())) < rows:
        finite = np.isfinite(cost)
        far = 1.0 + 2 * (rows + 1) * np.abs(cost[finite]).max(initial=1.0)  # more than any detour
        nearest = _shortest_paths(np.where(finite, cost, far))
    return np.where(np.isfinite(cost[np.arange(rows), nearest]), nearest, -1)


def assigned_or_none(cost: np.ndarray) -> np.ndarray:
    """Return columns (R,) as `assignment` does, except that a row may stay unassigned, −1, at a cost of 1."""
    count = cost.shape[1]
    none = np.where(np.eye(len(cost), dtype=bool), 1.0, np.inf)
    chosen = assignment(np.concatenate([cost, none], axis=1))
    return np.where(chosen < count, chosen, -1)


def cost_of(cost: np.ndarray, chosen: np.ndarray) -> float:
    """Return the total cost of an assignment (R,) with costs (R, C), each limited to 1, the cost of no assignment."""
    return float(np.where(chosen >= 0, np.minimum(cost[np.arange(len(cost)), chosen], 1.0), 1.0).sum())


def _shortest_paths(cost: np.ndarray) -> np.ndarray:
    """Return columns (R,) for R rows of finite costs (R, C)."""
    rows, columns = cost.shape
    of_row, of_column = np.zeros(rows), np.zeros(columns)  # dual prices
    row_at = np.full(columns, -1)
    for row in range(rows):
        distance, before = np.full(columns, np.inf), np.full(columns, -1)
        done = np.zeros(columns, dtype=bool)
        here, length, column = row, 0.0, -1
        while here >= 0:
            reduced = length + cost[here] - of_row[here] - of_column
            shorter = ~done & (reduced < distance)
            distance[shorter], before[shorter] = reduced[shorter], column
            column = int(np.where(done, np.inf, distance).argmin())
            length = distance[column]
            done[column] = True
            here = row_at[column]
        of_row[row] += length
        visited = done & (row_at >= 0)
        of_row[row_at[visited]] += length - distance[visited]
        of_column[done] -= length - distance[done]
        while column >= 0:  # reverse the path: each of its columns goes to the row before
            previous = int(before[column])
            row_at[column] = row_at[previous] if previous >= 0 else row
            column = previous
    answer = np.empty(rows, dtype=np.int64)
    taken = np.flatnonzero(row_at >= 0)
    answer[row_at[taken]] = taken
    return answer
