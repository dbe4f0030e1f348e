"""Measures of sight: what a wearer sees go wrong, each a function of true and output positions.

Positions are (T, P, 3) m in the world (+Y up) at `rate` Hz, masks of what is tracked are (T, P) bool. A mean error does
not count these faults: a body that freezes for a frame and then leaps, feet that hover, knees that bend while the
wearer stands, steps that the wearer did not take, hands that fly back into view.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np

from bodysense.body.gaps import runs
from bodysense.body.rotation import quaternion_conjugate, quaternion_rotate
from bodysense.metrics import vector_length

FAST = 1.0  # m/s: a hidden point that truly moves faster is seen to move
FROZEN = 0.25  # of the true speed: a point that is output slower is frozen
FLOATING = 0.03  # m over its rest height: a ball that is higher does not touch the floor
STANDING = 0.10  # m over its rest height: the true ball that carries the body is lower, even on tiptoe
UPRIGHT = 0.8  # of its rest height: a standing pelvis is higher
STRAIGHT = 10.0  # °: a true knee that is bent less is straight
BACKWARD = 5.0  # °: a knee that is bent farther the wrong way bends backward
STRIDE = 0.20  # m between the ankles, along the pelvis' heading
STEP = 0.08  # m along the floor: a foot that moves less did not step
TRUE_STEP = 0.20  # m: a true step that is as long is not to be missed
STILL = 0.25  # m/s along the floor: a foot that is slower stands
SETTLED = 0.3  # s after a true step within which the output foot may still finish it
EASE = 0.25  # s after its return within which a point is brought where it is measured
SEEN_FOR = 0.3  # s after its return from which a measured point is where it was measured
TRANSITION = 0.5  # s after a loss or a return over which jerk is compared
Moment = Literal["loss", "return"]


def changed_frames(tracked: np.ndarray) -> np.ndarray:
    """(T,) bool: frames whose mask (T, …) differs from the frame before; never the first."""
    flat = tracked.reshape(len(tracked), -1)
    return np.concatenate([[False], (flat[1:] != flat[:-1]).any(axis=-1)])


def near_change(tracked: np.ndarray) -> np.ndarray:
    """(T,) bool: the frame of a mask change, and the next."""
    changed = changed_frames(tracked)
    return changed | np.concatenate([[False], changed[:-1]])


def leaps(position: np.ndarray, truth: np.ndarray, order: int = 1) -> np.ndarray:
    """(T − order,) m: the most that a point goes farther than its truth goes, in each frame after the first.

    A foot that swings while the true one stands does so as well; with `order` 2 the distance is the one from where the
    velocity leads, so that only breaks in the motion count.
    """
    gone, truly = (vector_length(np.diff(values, order, axis=0)) for values in (position, truth))
    return (gone - truly).max(axis=-1)


def jump_frames(position: np.ndarray, truth: np.ndarray, most: float, order: int = 1) -> np.ndarray:
    """(T − order,) bool: frames with a leap (`leaps`) of more than `most` metres."""
    return leaps(position, truth, order) > most


def frozen_points(position: np.ndarray, truth: np.ndarray, tracked: np.ndarray, rate: float) -> np.ndarray:
    """(N,) bool over hidden points that truly move faster than `FAST`: whether they are output almost still."""
    truly, output = (_speed(values, rate) for values in (truth, position))
    counted = ~tracked[1:] & (truly > FAST)
    return output[counted] < FROZEN * truly[counted]


def standing_frames(
    balls: np.ndarray, pelvis: np.ndarray, ball_rest: float, pelvis_rest: float, rate: float
) -> np.ndarray:
    """(T,) bool: frames in which a body stands upright, or walks: at least one ball is low and still.

    Args:
        balls: true balls of the feet (T, 2, 3) m.
        pelvis: true pelvis (T, 3) m.
        ball_rest: height of the balls in the rest pose, m.
        pelvis_rest: height of the pelvis in the rest pose, m.
        rate: Hz.
    """
    speed = _speed(balls, rate)
    still = np.concatenate([speed[:1], speed]) < STILL
    carried = (still & (balls[..., 1] < ball_rest + STANDING)).any(axis=-1)
    return carried & (pelvis[:, 1] > UPRIGHT * pelvis_rest)


def floating_frames(balls: np.ndarray, truth: np.ndarray, ball_rest: float) -> np.ndarray:
    """(T,) bool: frames in which the lower ball of output feet (T, 2, 3) m is `FLOATING` too high.

    Too high is over its rest height, and over the lower one of the true balls (T, 2, 3) m: recorded feet are not always
    on the floor.
    """
    lowest, truly = (values[..., 1].min(axis=-1) for values in (balls, truth))
    return lowest > np.maximum(truly, ball_rest) + FLOATING


def knee_flexion(hip: np.ndarray, knee: np.ndarray, ankle: np.ndarray) -> np.ndarray:
    """Angle (...,) between thigh and shin, degrees, of points (..., 3); 0: straight."""
    thigh, shin = knee - hip, ankle - knee
    scale = np.maximum(vector_length(thigh) * vector_length(shin), 1e-12)
    return np.degrees(np.arccos(np.clip((thigh * shin).sum(axis=-1) / scale, -1, 1)))


def backward_knees(rotation: np.ndarray) -> np.ndarray:
    """(...,) bool: knees that bend backward, from local rotations (..., 4) wxyz, thigh ← shin.

    The thigh's +X points to the body's left: turning about it takes the shin back, as knees bend.
    """
    sign = np.where(rotation[..., 0] < 0, -1.0, 1.0)
    return np.degrees(2 * np.arctan2(sign * rotation[..., 1], np.abs(rotation[..., 0]))) < -BACKWARD


def wrong_feet(ankles: np.ndarray, truth: np.ndarray, facing: np.ndarray) -> np.ndarray:
    """(N,) bool over frames with a true stride: whether the other foot is output in front.

    Args:
        ankles: output ankles (T, 2, 3) m, left and right.
        truth: true ankles (T, 2, 3) m.
        facing: heading of the true pelvis (T, 4) wxyz.
    """
    back = quaternion_conjugate(facing)
    ahead, truly = (
        np.asarray(quaternion_rotate(back, values[:, 0] - values[:, 1]))[:, 2] for values in (ankles, truth)
    )
    stride = np.abs(truly) > STRIDE
    return ahead[stride] * truly[stride] < 0


def still_spans(foot: np.ndarray, rate: float, shortest: float = 0.1) -> list[tuple[int, int]]:
    """Spans [start, end) of frames in which a foot (T, 3) m stands: slow along the floor for `shortest` seconds."""
    speed = vector_length(np.diff(foot[:, [0, 2]], axis=0)) * rate
    slow = np.concatenate([speed[:1], speed]) < STILL
    return [(start, end) for start, end in runs(slow) if end - start >= shortest * rate]


def false_steps(feet: np.ndarray, truth: np.ndarray, rate: float) -> int:
    """How often an output foot steps while both true feet stand.

    A foot has stepped when it is `STEP` from where it was at the last step, along the floor, beyond what the true one
    slides; the first `SETTLED` seconds of standing do not count. Feet are (T, 2, 3) m.
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
    """How many true steps the output feet do not take, and how many true steps there are.

    A true step leads a foot `TRUE_STEP` or more from one stand to the next. The output foot misses it if, from just
    before to `SETTLED` seconds after, it goes less than half as far. Feet are (T, 2, 3) m.
    """
    missed, steps, slack = 0, 0, round(SETTLED * rate)
    for side in range(2):
        spans = still_spans(truth[:, side], rate)
        for (_, left), (landed, _) in pairwise(spans):
            length = _horizontal_length(truth[landed, side] - truth[left - 1, side])
            if length < TRUE_STEP:
                continue
            begin, end = max(0, left - 1 - slack // 2), min(len(feet), landed + slack)
            gone = _horizontal_length(feet[begin:end, side] - feet[begin, side]).max()
            steps, missed = steps + 1, missed + int(gone < length / 2)
    return missed, steps


def reentry_speeds(position: np.ndarray, tracked: np.ndarray, rate: float) -> np.ndarray:
    """(N,) m/s: the greatest output speed of every point that is tracked again, within `EASE` seconds of its return."""
    speed, reach = _speed(position, rate), round(EASE * rate)
    frames, points = np.nonzero(tracked[1:] & ~tracked[:-1])  # speed k leads to frame k + 1
    if not len(frames):
        return np.zeros(0)
    window = np.minimum(frames[:, None] + np.arange(reach + 1), len(speed) - 1)
    return speed[window, points[:, None]].max(axis=1)


def long_seen(tracked: np.ndarray, rate: float) -> np.ndarray:
    """(T, P) bool: points that have been tracked for `SEEN_FOR` seconds without a gap."""
    frame = np.arange(len(tracked))[:, None]
    last_lost = np.maximum.accumulate(np.where(tracked, -1, frame))
    return frame - last_lost > round(SEEN_FOR * rate)


def transition_frames(tracked: np.ndarray, rate: float) -> dict[Moment, list[int]]:
    """Frames at which a hand with mask (T,) is lost, and returns, with `TRANSITION` seconds of the take after them.

    A loss shorter than `TRANSITION` has a return but no loss of its own (RPM, Barquero et al. 2025).
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
    """(len(frames), K) m/s³: the largest jerk of all points, in each of the K frames that begin at each of `frames`.

    Jerk is the third difference; the one of frame t leads to frame t.
    """
    reach = round(TRANSITION * rate)
    if not frames:
        return np.zeros((0, reach))
    jerk = vector_length(np.diff(position, 3, axis=0)).max(axis=-1) * rate**3
    return jerk[np.array(frames)[:, None] - 3 + np.arange(reach)]


def peak_jerk_ratio(output: np.ndarray, truth: np.ndarray) -> float:
    """PJ by that of the truth: peaks of mean jerk curves (K,) after a moment (RPM)."""
    return float(output.max() / truth.max())


def area_under_jerk(output: np.ndarray, truth: np.ndarray) -> float:
    """AUJ, m/s³: what mean jerk curves (K,) differ by, summed over the frames after a moment (RPM)."""
    return float(np.abs(output - truth).sum())


def _speed(position: np.ndarray, rate: float) -> np.ndarray:
    """(T − 1, P) m/s."""
    return vector_length(np.diff(position, axis=0)) * rate


def _horizontal_length(vector: np.ndarray) -> np.ndarray:
    """Length (...,) of vectors (..., 3) along the floor."""
    return np.hypot(vector[..., 0], vector[..., 2])


def _moves(foot: np.ndarray, truth: np.ndarray) -> int:
    """How often a foot (T, 3) m gets `STEP` away, both from where it last rested and from the way of the truth."""
    moves, first = 0, 0
    while True:
        gone, truly = foot[first:] - foot[first], truth[first:] - truth[first]
        away = np.minimum(_horizontal_length(gone), _horizontal_length(gone - truly)) > STEP
        if not away.any():
            return moves
        moves, first = moves + 1, first + int(away.argmax())
