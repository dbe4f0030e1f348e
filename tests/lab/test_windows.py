"""Windows: stride and step are two things."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.errors import BodysenseError
from bodysense.lab.windows import find_windows, frame_step


def test_poses_at_30_hz_from_a_recording_at_120_hz() -> None:
    step = frame_step(120.0, 30.0)
    windows = find_windows([0], [400], length=27, stride=3, step=step)
    frames = windows.frames()
    seconds = frames / 120.0
    np.testing.assert_allclose(np.diff(seconds, axis=1), 1 / 30)  # poses of a window lie a thirtieth apart …
    np.testing.assert_allclose(np.diff(seconds[:, 0]), 3 / 30)  # … and windows start every third pose
    assert seconds[0, -1] - seconds[0, 0] == pytest.approx(26 / 30)


@settings(deadline=None)
@given(st.lists(st.integers(0, 40), min_size=1, max_size=6), st.integers(1, 9), st.integers(1, 5), st.integers(1, 5))
def test_against_counting_by_hand(lengths: list[int], length: int, stride: int, step: int) -> None:
    starts = np.cumsum([0, *lengths[:-1]])
    windows = find_windows(starts, lengths, length=length, stride=stride, step=step)
    expected = []
    for clip, (start, count) in enumerate(zip(starts, lengths, strict=True)):
        first = 0
        while first + (length - 1) * step < count:
            expected.append((clip, [start + first + k * step for k in range(length)]))
            first += stride * step
    assert len(windows) == len(expected)
    np.testing.assert_array_equal(windows.clip, [clip for clip, _ in expected])
    np.testing.assert_array_equal(windows.frames(), np.array([f for _, f in expected]).reshape(-1, length))


@given(st.integers(1, 300), st.integers(1, 9), st.integers(1, 5), st.integers(1, 5))
def test_the_windows_by_step_are_those_of_the_thinned_recording(
    frames: int, length: int, stride: int, step: int
) -> None:
    recording = np.arange(frames)
    direct = recording[find_windows([0], [frames], length=length, stride=stride, step=step).frames()]
    thinned = recording[::step]
    twice = thinned[find_windows([0], [len(thinned)], length=length, stride=stride).frames()]
    np.testing.assert_array_equal(direct, twice)


def test_frames_of_some_windows() -> None:
    windows = find_windows([0, 10], [10, 5], length=4, stride=2)
    np.testing.assert_array_equal(windows.frames(np.array([3, 4])), [[6, 7, 8, 9], [10, 11, 12, 13]])
    np.testing.assert_array_equal(windows.frames(0), [0, 1, 2, 3])


@pytest.mark.parametrize("name", ["length", "stride", "step"])
def test_numbers_that_cannot_be(name: str) -> None:
    with pytest.raises(BodysenseError, match=f"{name} 0 cannot be"):
        find_windows([0], [10], **({"length": 3} | {name: 0}))


def test_a_rate_that_is_no_multiple() -> None:
    assert frame_step(59.94, 29.97) == 2
    for source, rate in ((24.0, 30.0), (100.0, 30.0), (30.0, 0.0)):
        with pytest.raises(BodysenseError, match=r"no whole multiple of .*; resample the recording first"):
            frame_step(source, rate)
