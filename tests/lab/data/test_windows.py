"""Windows of frames over clips."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bodysense.errors import BodysenseError
from bodysense_lab.data.windows import find_windows


@given(st.lists(st.integers(0, 40), min_size=1, max_size=6), st.integers(1, 9), st.integers(1, 5))
def test_windows_equal_those_counted_by_hand(lengths: list[int], length: int, stride: int) -> None:
    starts = np.cumsum([0, *lengths[:-1]])
    windows = find_windows(starts, lengths, length=length, stride=stride)
    expected = []
    for clip, (start, count) in enumerate(zip(starts, lengths, strict=True)):
        first = 0
        while first + length - 1 < count:
            expected.append((clip, [start + first + k for k in range(length)]))
            first += stride
    assert len(windows) == len(expected)
    np.testing.assert_array_equal(windows.clip, [clip for clip, _ in expected])
    np.testing.assert_array_equal(windows.frames(), np.array([f for _, f in expected]).reshape(-1, length))


@pytest.mark.parametrize("name", ["length", "stride"])
def test_lengths_and_strides_below_1_are_refused(name: str) -> None:
    with pytest.raises(BodysenseError, match=f"{name} 0 is not possible"):
        find_windows([0], [10], **({"length": 3} | {name: 0}))
