"""Thinning: of takes at high rates some frames a second are completed, and the poses between them are interpolated.

The tracker is made for 30 Hz, and a body moves smoothly between two such frames: cubics through joints that swing at up
to 3 Hz are off by 1 mm, lines by 20 mm. Fits to the markers of every frame follow (`takes.fitting`), so that no
measured motion is lost.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.geometry.rotation import normalize, quaternion_canonical
from bodysense.geometry.series import continuous
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.tracking.estimate import Estimate

Array = np.ndarray
RATE = 30.0  # Hz; fewest frames a second that are completed
_BLOCK = 1000  # frames that are computed at once


def kept_frames(time: Array, seconds: float, longest_gap: float) -> Array:
    """Return the indices (K,) of the frames that are completed: every n-th one, and the ends of times without gaps.

    Args:
        time: (T,) s.
        seconds: time between frames.
        longest_gap: s; a longer time between two frames is a gap.
    """
    step = max(1, int(1 / (RATE * seconds) + 1e-6))
    ends = np.flatnonzero(np.diff(time) > longest_gap) + 1
    spans = zip([0, *ends.tolist()], [*ends.tolist(), len(time)], strict=True)
    return np.concatenate([np.unique(np.r_[np.arange(first, end, step), end - 1]) for first, end in spans])


def at_all_frames(estimate: Estimate, kept: Array, observation: Observation) -> Estimate:
    """Return the estimate of all frames of an observation (T, P) from that of the `kept` (K,) ones.

    Rotations and the place of the body follow cubics through the kept frames, expected errors and contacts lines.
    """
    time, skeleton = observation.time, estimate.pose.skeleton
    known = time[kept]
    rotation = continuous(np.asarray(estimate.pose.rotation))
    root = np.asarray(estimate.pose.root_position)
    turning, moving = np.gradient(rotation, known, axis=0), np.gradient(root, known, axis=0)
    frames = len(time)
    arrays = {
        name: np.empty((frames, *getattr(estimate, name).shape[1:])) for name in ("confidence", "bound", "contact")
    }
    points, turns, places, measured = (
        np.empty((frames, *estimate.points.shape[1:])),
        np.empty((frames, *rotation.shape[1:])),
        np.empty((frames, 3)),
        np.empty((frames, *estimate.measured.shape[1:]), dtype=bool),
    )
    for first in range(0, frames, _BLOCK):
        block = slice(first, first + _BLOCK)
        at = time[block]
        before = np.clip(np.searchsorted(known, at, side="right") - 1, 0, len(known) - 2)
        interval = known[before + 1] - known[before]
        share = (at - known[before]) / interval
        turns[block] = quaternion_canonical(normalize(_cubic(rotation, turning, before, share, interval)))
        places[block] = _cubic(root, moving, before, share, interval)
        points[block] = forward_kinematics(Pose(skeleton, places[block], turns[block]))[0]
        measured[block] = observed_points(observation[block], skeleton)[2]
        for name, values in arrays.items():
            given = getattr(estimate, name)
            values[block] = given[before] + share[:, None] * (given[before + 1] - given[before])
    return replace(
        estimate,
        pose=Pose(skeleton, places, turns),
        points=points,
        measured=measured,
        rest_offset=np.broadcast_to(estimate.rest_offset[0], (frames, *estimate.rest_offset.shape[1:])),
        **arrays,
    )


def _cubic(values: Array, slope: Array, before: Array, share: Array, interval: Array) -> Array:
    """Return values (S, …) of cubics: at `share` (S,) of the interval (S,) s after knot `before` (S,).

    Knots have `values` (K, …) and slopes (K, …) in units a second.
    """
    share, interval = (one.reshape(-1, *(1,) * (values.ndim - 1)) for one in (share, interval))
    rise = share * share * (3 - 2 * share)
    bend = share * (1 - share) * interval
    start = values[before]
    return (
        start + rise * (values[before + 1] - start) + bend * ((1 - share) * slope[before] - share * slope[before + 1])
    )
