"""Resampling: the same motion at another frame rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.pose import Pose
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_canonical, slerp
from bodysense.io.clip import Clip

_BLOCK = 1000  # frames computed at once
_SAME = 1e-4  # frames: places nearer than this to a frame are that frame; Unix times are exact to 3e-7 s


def resample(clip: Clip, rate: float) -> Clip:
    """Return the clip at `rate` Hz, from its first frame on: rotations by slerp, the root linearly.

    Frames at times that both rates share are the source's, bit for bit. Nothing is low-pass filtered: going down
    takes the pose at each new time, as a slower camera would see it.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise BodysenseError(f"frame rate {rate:g} Hz cannot be; give a positive number, e.g. 30")
    if rate == clip.frame_rate:
        return clip
    count = int(np.floor((len(clip) - 1) * rate / clip.frame_rate + _SAME)) + 1
    place = np.arange(count) * clip.frame_rate / rate
    return replace(clip, pose=_between(clip.pose, place), frame_rate=float(rate))


def at_constant_rate(clip: Clip, time: np.ndarray) -> Clip:
    """Return a clip whose frames were taken at `time` (T,) seconds, resampled to its constant `frame_rate`."""
    time = np.asarray(time, dtype=float)
    if time.shape != (len(clip),) or not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        raise BodysenseError(
            f"{clip.name}: {len(clip)} frames need as many times in seconds, increasing; got {time.shape}"
        )
    count = int(np.floor((time[-1] - time[0]) * clip.frame_rate + _SAME)) + 1
    moments = time[0] + np.arange(count) / clip.frame_rate
    return replace(clip, pose=_between(clip.pose, np.interp(moments, time, np.arange(len(clip)))))


def _between(pose: Pose, place: np.ndarray) -> Pose:
    """Return the pose (N, …) at fractional frames `place` (N,)."""
    last = len(pose.root_position) - 1
    nearest = np.round(place)
    place = np.clip(np.where(np.abs(place - nearest) < _SAME, nearest, place), 0, last)
    if np.array_equal(place, np.arange(last + 1)) and (pose.rotation[..., 0] >= 0).all():
        return pose
    root, rotation = np.empty((len(place), 3)), np.empty((len(place), *pose.rotation.shape[1:]))
    for k in range(0, len(place), _BLOCK):
        block = slice(k, k + _BLOCK)
        before = np.floor(place[block]).astype(int)
        after = np.minimum(before + 1, last)
        t = (place[block] - before)[:, None]
        root[block] = (1 - t) * pose.root_position[before] + t * pose.root_position[after]
        rotation[block] = quaternion_canonical(slerp(pose.rotation[before], pose.rotation[after], t))
    return Pose(pose.skeleton, root, rotation)
