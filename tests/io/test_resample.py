"""Resampling: shared times, rates and interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.resample import at_constant_rate, resample


@pytest.mark.parametrize(("rate", "new"), [(120.0, 30.0), (24.0, 30.0), (59.94, 30.0)])
def test_against_scipys_slerp(make_clip, rate: float, new: float) -> None:
    clip = make_clip(frames=13, rate=rate)
    result = resample(clip, new)
    assert result.frame_rate == new and clip.frame_rate == rate
    assert result.time[-1] <= clip.time[-1] + 1e-9 < result.time[-1] + 1 / new
    for joint in (0, 7, 30):
        slerp = Slerp(clip.time, Rotation.from_quat(clip.pose.rotation[:, joint], scalar_first=True))
        theirs = slerp(np.minimum(result.time, clip.time[-1])).as_quat(scalar_first=True)
        assert geodesic_angle(result.pose.rotation[:, joint], theirs).max() < 1e-6
    for axis in range(3):
        root = np.interp(result.time, clip.time, clip.pose.root_position[:, axis])
        np.testing.assert_allclose(result.pose.root_position[:, axis], root, atol=1e-9)


def test_shared_times_are_exact_up_and_down(make_clip) -> None:
    clip = make_clip(frames=25, rate=30.0)
    up = resample(clip, 120.0)
    assert len(up) == 97
    np.testing.assert_array_equal(up.pose.rotation[::4], clip.pose.rotation)
    np.testing.assert_array_equal(up.pose.root_position[::4], clip.pose.root_position)
    back = resample(up, 30.0)
    np.testing.assert_array_equal(back.pose.rotation, clip.pose.rotation)
    same = resample(make_clip(frames=9, rate=24.0), 30.0)  # 24 and 30 share every 1/6 s
    np.testing.assert_array_equal(same.pose.rotation[::5], make_clip(frames=9, rate=24.0).pose.rotation[::4])


def test_one_frame_and_the_same_rate(make_clip) -> None:
    clip = make_clip(frames=12)
    assert resample(clip, 30.0) is clip
    one = make_clip(frames=1)
    assert len(resample(one, 90.0)) == 1


@pytest.mark.parametrize("rate", [0.0, -30.0, float("nan"), float("inf")])
def test_invalid_rates_are_refused(make_clip, rate: float) -> None:
    with pytest.raises(BodysenseError, match=r"frame rate .* Hz cannot be; give a positive number"):
        resample(make_clip(), rate)


@pytest.mark.parametrize("begin", [7.0, 1.7e9])
def test_frames_at_uneven_times(make_clip, begin: float) -> None:
    clip = make_clip(frames=31)
    thinned = np.array([0, 1, 2, 5, 6, 10, 11, 12, 20, 21, 22, 30])
    late = at_constant_rate(type(clip)("a", clip.pose[thinned], 30.0), begin + clip.time[thinned])
    assert len(late) == 31
    np.testing.assert_array_equal(late.pose.rotation[thinned], clip.pose.rotation[thinned])
    with pytest.raises(BodysenseError, match=r"12 frames need as many times in seconds, increasing"):
        at_constant_rate(type(clip)("a", clip.pose[thinned], 30.0), -clip.time[thinned])
