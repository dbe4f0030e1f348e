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
    """The map that leaves expected errors as they are."""
    return ErrorMap(
        np.eye(KNOWN, POINTS),
        np.zeros((KNOWN, HIDDEN)),
        np.zeros(HIDDEN),
        np.zeros((HIDDEN, POINTS)),
        np.zeros(POINTS),
    )
