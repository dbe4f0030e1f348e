"""The map that makes expected errors true: its form."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense_lab.completion.points import BODY_POINTS

MASKS = len(BODY_POINTS) + len(BODY)  # what is tracked: positions of 25 points, rotations of 22 joints
POINTS = len(BODY_POINTS)
LOG_TRACKED = math.log(0.001)  # stands for the expected error of points that are tracked
# Log expected errors, what is tracked, certainty of the bones, and the log of how far apart the network's two answers
# are about each joint.
KNOWN = POINTS + MASKS + POINTS + len(BODY)
LOG_ALIKE = math.log(0.01)  # stands for that of joints that are tracked
CERTAINTY_SCALE = 20.0  # 1/m
HIDDEN = 48


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """log error = known @ weight + tanh(known @ inward + inward_offset) @ outward + offset, for each of 25 points."""

    weight: np.ndarray  # (119, 25)
    inward: np.ndarray  # (119, 48)
    inward_offset: np.ndarray  # (48,)
    outward: np.ndarray  # (48, 25)
    offset: np.ndarray  # (25,)


def shown_apart() -> ErrorMap:
    """The map that gives, of joints that are not tracked, how far apart the network's two answers are."""
    start = unchanged_errors()
    weight = np.zeros((KNOWN, POINTS))
    weight[-len(BODY) :, : len(BODY)] = np.eye(len(BODY))
    return replace(start, weight=weight)


def unchanged_errors() -> ErrorMap:
    """Return the map that leaves expected errors unchanged."""
    return ErrorMap(
        np.eye(KNOWN, POINTS),
        np.zeros((KNOWN, HIDDEN)),
        np.zeros(HIDDEN),
        np.zeros((HIDDEN, POINTS)),
        np.zeros(POINTS),
    )


def error_tables(mean: ErrorMap, bound: ErrorMap) -> dict[str, np.ndarray]:
    """Return both maps as the tables that the core reads: rows of 25 means, then of 25 bounds.

    `inward` (96, 119) and its `bias` (96,), `weight` (50, 119 + 96) and its `bias` (50,). They read deviations of bones
    in metres.
    """
    scale = np.ones((KNOWN, 1))
    scale[-POINTS - len(BODY) : -len(BODY)] = CERTAINTY_SCALE
    outward = np.zeros((2 * HIDDEN, 2 * POINTS))
    outward[:HIDDEN, :POINTS], outward[HIDDEN:, POINTS:] = mean.outward, bound.outward
    tables = {
        "inward.weight": (scale * np.concatenate([mean.inward, bound.inward], axis=1)).T,
        "inward.bias": np.concatenate([mean.inward_offset, bound.inward_offset]),
        "weight": np.concatenate([scale * np.concatenate([mean.weight, bound.weight], axis=1), outward]).T,
        "bias": np.concatenate([mean.offset, bound.offset]),
    }
    return {name: table.astype(np.float32) for name, table in tables.items()}
