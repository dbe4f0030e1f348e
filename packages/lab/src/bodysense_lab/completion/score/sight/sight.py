"""Measures of faults that a wearer sees, as functions of true and output positions.

Positions are (T, P, 3) m in the world (+Y up) at `rate` Hz, and masks of tracked points are (T, P) bool. A mean error
does not show these faults: a body that freezes for a frame and then leaps, feet that float, knees that bend while the
wearer stands, steps that the wearer did not take, hands that fly back into view.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np

from bodysense.geometry.gaps import runs
from bodysense.geometry.rotation import angle_between, quaternion_conjugate, quaternion_rotate
from bodysense.quality.metrics import vector_length

FAST = 1.0  # m/s; faster hidden points are checked for freezing
FROZEN = 0.25  # of the true speed; a slower output point is frozen
FLOATING = 0.03  # m over its rest height; a higher ball of a foot does not touch the floor
STANDING = 0.10  # m over its rest height; a true ball that carries the body is lower, even on tiptoe
UPRIGHT = 0.8  # of its rest height; a standing pelvis is higher
STRAIGHT = 10.0  # °; a true knee that is bent less is straight
BACKWARD = 5.0  # °; a knee that is bent farther in the wrong direction bends backward
STRIDE = 0.20  # m between the ankles along the pelvis's heading; less is no stride
WALKING, WALKING_WINDOW = 0.3, 0.5  # m/s along the floor of a pelvis that walks, and s over which it is measured
STEP = 0.08  # m along the floor; a foot that moves less did not step
TRUE_STEP = 0.20  # m; only true steps of this length count as missed
STILL = 0.25  # m/s along the floor; a slower foot stands
SETTLED = 0.3  # s after a true step in which the output foot may finish its step
EASE = 0.25  # s after its return in which a point is eased to its measured position
SEEN_FOR = 0.3  # s after its return from which a point must be at its measured position
TRANSITION = 0.5  # s after a loss or a return in which jerk is compared
Moment = Literal["loss", "return"]


def changed_frames(tracked: np.ndarray) -> np.ndarray:
    """Return (T,) bool: frames whose mask (T, …) differs from that of the previous frame; False for the first."""
    flat = tracked.reshape(len(tracked), -1)
    return np.concatenate([[False], (flat[1:] != flat[:-1]).any(axis=-1)])


def near_change(tracked: np.ndarray) -> np.ndarray:
    """Return (T,) bool: the frames of mask changes and the frames after them."""
    changed = changed_frames(tracked)
    return changed | np.concatenate([[False], changed[:-1]])


def leaps(position: np.ndarray, truth: np.ndarray, order: int = 1) -> np.ndarray:
    """Return (T − order,) m: the largest distance that a point moves beyond that of the true point, in each frame.

    With `order` 1, a foot that swings while the true foot stands counts, too. With `order` 2, distances are from the
    position to which the velocity leads, so only breaks in the motion count.
    """
    distance, true_distance = (vector_length(np.diff(values, order, axis=0)) for values in (position, truth))
    return (distance - true_distance).max(axis=-1)


def jump_frames(position: np.ndarray, truth: np.ndarray, most: float, order: int = 1) -> np.ndarray:
    """Return (T − order,) bool: frames with a leap (see `leaps`) of more than `most` metres."""
    return leaps(position, truth, order) > most


def frozen_points(position: np.ndarray, truth: np.ndarray, tracked: np.ndarray, rate: float) -> np.ndarray:
    """Return (N,) bool for hidden points with a true speed above `FAST`: the output point is almost still."""
    true_speed, speed = (_speed(values, rate) for values in (truth, position))
    counted = ~tracked[1:] & (true_speed > FAST)
    return speed[counted] < FROZEN * true_speed[counted]


def resting_frames(balls: np.ndarray, ball_rest: float, rate: float) -> np.ndarray:
    """Return (T,) bool: frames in which at least one ball of a foot is low and still.

    Args:
        balls: true balls of the feet (T, 2, 3) m.
        ball_rest: height of the balls in the rest pose, m.
        rate: Hz.
    """
    speed = _speed(balls, rate)
    still = np.concatenate([speed[:1], speed]) < STILL
    return np.asarray((still & (balls[..., 1] < ball_rest + STANDING)).any(axis=-1))


def upright_frames(pelvis: np.ndarray, pelvis_rest: float) -> np.ndarray:
    """Return (T,) bool: frames in which the true pelvis (T, 3) m is not much below its height in the rest pose (m)."""
    return np.asarray(pelvis[:, 1] > UPRIGHT * pelvis_rest)


def floating_frames(balls: np.ndarray, truth: np.ndarray, ball_rest: float) -> np.ndarray:
    """Return (T,) bool: frames in which the lower ball of the output feet (T, 2, 3) m floats.

    It floats if it is `FLOATING` above its rest height and above the lower true ball (T, 2, 3) m; recorded feet are not
    always on the floor.
    """
    lowest, true_lowest = (values[..., 1].min(axis=-1) for values in (balls, truth))
    return lowest > np.maximum(true_lowest, ball_rest) + FLOATING


def knee_flexion(hip: np.ndarray, knee: np.ndarray, ankle: np.ndarray) -> np.ndarray:
    """Return the angle (...,) between thigh and shin, degrees, for points (..., 3); 0: straight."""
    return np.degrees(angle_between(knee - hip, ankle - knee))


def backward_knees(rotation: np.ndarray) -> np.ndarray:
    """Return (...,) bool: knees that bend backward, from local rotations (..., 4) wxyz, thigh ← shin.

    The thigh's +X points to the body's left. Knees bend by positive turns about it.
    """
    sign = np.where(rotation[..., 0] < 0, -1.0, 1.0)
    return np.degrees(2 * np.arctan2(sign * rotation[..., 1], np.abs(rotation[..., 0]))) < -BACKWARD


def wrong_feet(ankles: np.ndarray, truth: np.ndarray, facing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return masks (T,), bool: frames with a true stride, and those of them whose output has the other foot in front.

    Args:
        ankles: output ankles (T, 2, 3) m, left and right.
        truth: true ankles (T, 2, 3) m.
        facing: heading of the true pelvis (T, 4) wxyz.
    """
    back = quaternion_conjugate(facing)
    ahead, true_ahead = (
        np.asarray(quaternion_rotate(back, values[:, 0] - values[:, 1]))[:, 2] for values in (ankles, truth)
    )
    stride = np.abs(true_ahead) > STRIDE
    return stride, stride & (ahead * true_ahead < 0)


def walking_frames(pelvis: np.ndarray, rate: float) -> np.ndarray:
    """Return frames (T,), bool, in which a pelvis (T, 3) m moves along the floor at `WALKING` or faster."""
    window = max(1, round(WALKING_WINDOW * rate / 2))
    place = np.arange(len(pelvis))
    before, after = np.maximum(place - window, 0), np.minimum(place + window, len(pelvis) - 1)
    distance = vector_length((pelvis[after] - pelvis[before])[:, [0, 2]])
    return distance * rate >= WALKING * np.maximum(after - before, 1)


def still_spans(foot: np.ndarray, rate: float) -> list[tuple[int, int]]:
    """Return spans [start, end) of frames in which a foot (T, 3) m stands: slow along the floor for 0.1 s."""
    speed = vector_length(np.diff(foot[:, [0, 2]], axis=0)) * rate
    slow = np.concatenate([speed[:1], speed]) < STILL
    return [(start, end) for start, end in runs(slow) if end - start >= 0.1 * rate]


def false_steps(feet: np.ndarray, truth: np.ndarray, rate: float) -> int:
    """Count the steps of output feet (T, 2, 3) m while both true feet (T, 2, 3) m stand.

    A foot steps when it has moved by `STEP` along the floor since its last step, beyond the sliding of the true foot.
    The first `SETTLED` seconds of standing do not count.
    """
    both = np.ones(len(truth), dtype=bool)
    for side in range(2):
        still = np.zeros(len(truth), dtype=bool)
        for start, end in still_spans(truth[:, side], rate):
            still[start:end] = True
        both &= still
    spans = [(start + round(SETTLED * rate), end) for start, end in runs(both)]
    return sum(
        _moves(feet[start:end, side], truth[start:end, side])
        for start, end in spans
        if start < end
        for side in range(2)
    )


def missed_steps(feet: np.ndarray, truth: np.ndarray, rate: float) -> tuple[int, int]:
    """Return the number of true steps that the output feet miss, and the number of true steps.

    A true step moves a foot by `TRUE_STEP` or more between two spans of standing. The output foot misses it if it moves
    less than half as far, from just before the step to `SETTLED` seconds after. Feet are (T, 2, 3) m.
    """
    missed, steps, slack = 0, 0, round(SETTLED * rate)
    for side in range(2):
        spans = still_spans(truth[:, side], rate)
        for (_, lifted), (landed, _) in pairwise(spans):
            length = _horizontal_length(truth[landed, side] - truth[lifted - 1, side])
            if length < TRUE_STEP:
                continue
            begin, end = max(0, lifted - 1 - slack // 2), min(len(feet), landed + slack)
            distance = _horizontal_length(feet[begin:end, side] - feet[begin, side]).max()
            steps, missed = steps + 1, missed + int(distance < length / 2)
    return missed, steps


def reentry_speeds(position: np.ndarray, tracked: np.ndarray, rate: float) -> np.ndarray:
    """Return (N,) m/s: the largest output speed of each point that returns, within `EASE` seconds of its return."""
    speed, reach = _speed(position, rate), round(EASE * rate)
    frames, points = np.nonzero(tracked[1:] & ~tracked[:-1])  # speed k leads to frame k + 1
    if not len(frames):
        return np.zeros(0)
    window = np.minimum(frames[:, None] + np.arange(reach + 1), len(speed) - 1)
    return speed[window, points[:, None]].max(axis=1)


def long_seen(tracked: np.ndarray, rate: float) -> np.ndarray:
    """Return (T, P) bool: points that have been tracked for `SEEN_FOR` seconds without a gap."""
    frame = np.arange(len(tracked))[:, None]
    last_lost = np.maximum.accumulate(np.where(tracked, -1, frame))
    return frame - last_lost > round(SEEN_FOR * rate)


def transition_frames(tracked: np.ndarray, rate: float) -> dict[Moment, list[int]]:
    """Return the frames of losses and returns of a hand with mask (T,) that have `TRANSITION` seconds after them.

    A loss shorter than `TRANSITION` counts as a return only (RPM, Barquero et al. 2025).
    """
    reach = round(TRANSITION * rate)
    found: dict[Moment, list[int]] = {"loss": [], "return": []}
    for start, end in runs(~tracked):
        if start > 2 and end - start >= reach and start + reach <= len(tracked):
            found["loss"].append(start)
        if start > 0 and end > 2 and end + reach <= len(tracked):
            found["return"].append(end)
    return found


def transition_jerks(position: np.ndarray, frames: list[int], rate: float) -> np.ndarray:
    """Return (len(frames), K) m/s³: the largest jerk of all points in the K frames from each of `frames` on.

    Jerk is the third difference of positions; that of frame t ends at frame t.
    """
    reach = round(TRANSITION * rate)
    if not frames:
        return np.zeros((0, reach))
    jerk = vector_length(np.diff(position, 3, axis=0)).max(axis=-1) * rate**3
    return jerk[np.array(frames)[:, None] - 3 + np.arange(reach)]


def peak_jerk_ratio(output: np.ndarray, truth: np.ndarray) -> float:
    """Return the peak of a mean jerk curve (K,) divided by that of the true one (PJ ratio, RPM)."""
    return float(output.max() / truth.max())


def area_under_jerk(output: np.ndarray, truth: np.ndarray) -> float:
    """Return the summed absolute difference of mean jerk curves (K,), m/s³ (AUJ, RPM)."""
    return float(np.abs(output - truth).sum())


def _speed(position: np.ndarray, rate: float) -> np.ndarray:
    """Return speeds (T − 1, P), m/s, of positions (T, P, 3) m."""
    return vector_length(np.diff(position, axis=0)) * rate


def _horizontal_length(vector: np.ndarray) -> np.ndarray:
    """Return the length (...,) of the horizontal part of vectors (..., 3)."""
    return np.hypot(vector[..., 0], vector[..., 2])


def _moves(foot: np.ndarray, truth: np.ndarray) -> int:
    """Count the moves of a foot (T, 3) m by `STEP` since its last move, also relative to the true foot's motion."""
    moves, first = 0, 0
    while True:
        path, true_path = foot[first:] - foot[first], truth[first:] - truth[first]
        away = np.minimum(_horizontal_length(path), _horizontal_length(path - true_path)) > STEP
        if not away.any():
            return moves
        moves, first = moves + 1, first + int(away.argmax())
