"""The map that makes expected errors true: its form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.lab.completion.points import BODY_POINTS

MASKS = len(BODY_POINTS) + len(BODY)  # what is tracked: positions of 25 points, rotations of 22 joints


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """log error = slope · log expected + masks @ weight + offset, for each of 25 points."""

    slope: np.ndarray  # (25,)
    weight: np.ndarray  # (47, 25)
    offset: np.ndarray  # (25,)


def unchanged_errors() -> ErrorMap:
    """The map that leaves expected errors as they are."""
    points = len(BODY_POINTS)
    return ErrorMap(np.ones(points), np.zeros((MASKS, points)), np.zeros(points))
