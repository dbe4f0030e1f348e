"""The map that calibrates the network's expected errors."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense_lab.completion.data.points import BODY_POINTS

MASKS = len(BODY_POINTS) + len(BODY)  # inputs for tracked points: positions of 25 points, rotations of 22 joints
POINTS = len(BODY_POINTS)
LOG_TRACKED_ERROR = math.log(0.001)  # log m; the input for points that are tracked
# Number of inputs: log expected errors, masks, deviations of the bones, and the log of each joint's disagreement, the
# distance between the network's answers for the body and for its mirror image.
INPUTS = POINTS + MASKS + POINTS + len(BODY)
LOG_TRACKED_DISAGREEMENT = math.log(0.01)  # log m; the input for joints that are tracked
CERTAINTY_SCALE = 20.0  # 1/m; a deviation of 5 cm is 1
HIDDEN = 48  # hidden units


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """Network with a hidden layer that maps `INPUTS` inputs to the logarithm of the error in m of each of 25 points.

    log error = inputs @ weight + tanh(inputs @ inward + inward_offset) @ outward + offset
    """

    weight: np.ndarray  # (119, 25)
    inward: np.ndarray  # (119, 48)
    inward_offset: np.ndarray  # (48,)
    outward: np.ndarray  # (48, 25)
    offset: np.ndarray  # (25,)


def disagreement_map() -> ErrorMap:
    """Return the map whose output is the disagreement of the network's two answers, for joints that are not tracked.

    Its output for the other points is 1 m. The core's bounds are these outputs times the factor of rare poses, so that
    of a point that is no joint is the factor itself.
    """
    start = identity_map()
    weight = np.zeros((INPUTS, POINTS))
    weight[-len(BODY) :, : len(BODY)] = np.eye(len(BODY))
    return replace(start, weight=weight)


def identity_map() -> ErrorMap:
    """Return the map that leaves expected errors unchanged."""
    return ErrorMap(
        np.eye(INPUTS, POINTS),
        np.zeros((INPUTS, HIDDEN)),
        np.zeros(HIDDEN),
        np.zeros((HIDDEN, POINTS)),
        np.zeros(POINTS),
    )


def error_tables(mean: ErrorMap, bound: ErrorMap) -> dict[str, np.ndarray]:
    """Return both maps as the tables that the core reads; rows of 25 means come before rows of 25 bounds.

    The tables are `inward.weight` (96, 119), `inward.bias` (96,), `weight` (50, 119 + 96) and `bias` (50,). Their input
    has deviations of bones in metres.
    """
    scale = np.ones((INPUTS, 1))
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
