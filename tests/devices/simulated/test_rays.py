"""Distances of segments, and intersections of segments with boxes."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.devices.simulated.rays import (
    segment_distance_squared,
    segment_meets_box,
)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_segment_distance_of_parallel_and_empty_segments(dtype: type) -> None:
    def distance(*segments: list[float]) -> float:
        return float(np.sqrt(segment_distance_squared(*(np.array(part, dtype=dtype)[:, None] for part in segments))[0]))

    assert distance([0, 0, 0], [1, 0, 0], [0.5, 2, 0], [1, 0, 0]) == pytest.approx(2)  # side by side
    assert distance([0, 0, 0], [1, 0, 0], [3, 0, 0], [-1, 0, 0]) == pytest.approx(1)  # end to end
    assert distance([0, 0, 0], [1, 0, 0], [0.3, 0, 0], [0.2, 0, 0]) == pytest.approx(0, abs=1e-6)  # inside
    assert distance([0, 0, 0], [0, 0, 0], [1, 1, 0], [0, 0, 0]) == pytest.approx(np.sqrt(2))  # two points
    assert distance([0, 0, 0], [0, 0, 0], [-1, 1, 0], [2, 0, 0]) == pytest.approx(1)  # a point and a segment


def test_a_ray_parallel_to_the_sides_of_a_box() -> None:
    axes, half_size = np.eye(3)[:, :, None], np.array([[0.1], [0.2], [0.3]])
    target = np.array([[0.0], [0], [1]])
    for x, expected in ((0.0, True), (0.09, True), (0.11, False), (-0.11, False)):
        assert segment_meets_box(target, np.array([[x], [0.0], [0.5]]), axes, half_size)[0] == expected
    here = np.zeros((3, 1))
    assert segment_meets_box(here, np.array([[0.05], [0.1], [0.2]]), axes, half_size)[0]
    assert not segment_meets_box(here, np.array([[0.05], [0.3], [0.2]]), axes, half_size)[0]
