"""The map that makes expected errors true: its form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense_lab.completion.points import BODY_POINTS

MASKS = len(BODY_POINTS) + len(BODY)  # what is tracked: positions of 25 points, rotations of 22 joints
POINTS = len(BODY_POINTS)
LOG_TRACKED = math.log(0.001)  # stands for the expected error of points that are tracked
KNOWN = POINTS + MASKS + POINTS  # log expected errors, what is tracked, certainty of the bones
CERTAINTY_SCALE = 20.0  # 1/m
HIDDEN = 48


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """log error = known @ weight + tanh(known @ inward + inward_offset) @ outward + offset, for each of 25 points."""

    weight: np.ndarray  # (97, 25)
    inward: np.ndarray  # (97, 48)
    inward_offset: np.ndarray  # (48,)
    outward: np.ndarray  # (48, 25)
    offset: np.ndarray  # (25,)


def unchanged_errors() -> ErrorMap:
    """The map that leaves expected errors as they are."""
    return ErrorMap(
        np.eye(KNOWN, POINTS),
        np.zeros((KNOWN, HIDDEN)),
        np.zeros(HIDDEN),
        np.zeros((HIDDEN, POINTS)),
        np.zeros(POINTS),
    )
