"""Measures of a scripted scene: errors, steps, gliding and floating feet, crossed legs, turns, knees, lost hands.

The truth of a scene is exact: which feet are planted, when they step, and what the person does. Positions are (T, P, 3)
m in the world (+Y up), at `RATE`.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.skeleton import BODY, Skeleton
from bodysense.geometry.rotation import heading, quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.quality.metrics import joint_error, vector_length
from bodysense_lab.completion.score.scenes import TrackedScene
from bodysense_lab.completion.score.scores import RunningScores
from bodysense_lab.completion.score.sight import sight
from bodysense_lab.completion.score.sight.wearers import rest_heights
from bodysense_lab.completion.score.tracking import TrackedMotion
from bodysense_lab.core.scoring import RATE
from bodysense_lab.synthesis.scenes import ScriptedScene

SIDES = ("left", "right")
LEGS = tuple(f"{side}_{name}" for side in SIDES for name in ("hip", "knee", "ankle", "foot"))
ARMS = tuple(f"{side}_{name}" for side in SIDES for name in ("shoulder", "elbow", "wrist"))
ON_FLOOR = 0.015  # m over its rest height; a foot with a lower ball is on the floor, as a stepping foot hardly is
GLIDES = 0.10  # m/s along the floor; a faster foot that is on the floor glides
CALM_HEAD = 0.30  # m/s; gliding is counted while the head is slower
STEP = 0.08  # m; shorter steps are not counted
BEFORE, AFTER = 0.2, 0.35  # s around a true step in which the output foot may take it
CROSSED = 0.02  # m; the left ankle is farther than this to the right of the right one
TURNING = 20.0  # degrees a second; a faster pelvis turns
UNDER = 0.005  # m; a point of the body that is lower is under the floor
LOW_HAND = 0.35  # m below the shoulder; a hand that is lower is low
_FLOOR_POINTS = ("knee", "ankle", "foot", "toe", "wrist")


def measure_scene(
    scripted: ScriptedScene, scene: TrackedScene, seen: Observation, tracked: TrackedMotion, lost: np.ndarray
) -> RunningScores:
    """Return all measures of a scene; `lost` (T, 2) bool are frames in which a hand is lost, left and right."""
    scores, skeleton, position, truth = RunningScores(), scene.skeleton, tracked.position, scene.world_pose[0]
    body = skeleton.indices(BODY)
    error = joint_error(position, truth)
    scores.add("error_cm", float(error[:, body].mean()), len(scene))
    for name, points in (("legs", LEGS), ("arms", ARMS)):
        scores.add(f"{name}_cm", float(error[:, skeleton.indices(points)].mean()), len(scene))
    hidden = ~observed_points(seen, skeleton)[2][:, body]
    within = np.asarray(error[:, body] <= 100 * tracked.bound[:, body])
    scores.add_share("covered_share", within[hidden])
    _measure_feet(scores, scripted, skeleton, position, truth, error)
    _measure_turns(scores, scene, tracked)
    wrists = skeleton.indices([f"{side}_wrist" for side in SIDES])
    shoulders = skeleton.indices([f"{side}_shoulder" for side in SIDES])
    if lost.any():
        scores.add("lost_hand_cm", float(error[:, wrists][lost].mean()), int(lost.sum()))
        low = lost & (truth[:, wrists, 1] < truth[:, shoulders, 1] - LOW_HAND)
        if low.any():
            scores.add("lost_low_hand_cm", float(error[:, wrists][low].mean()), int(low.sum()))
    low_points = skeleton.indices([f"{side}_{name}" for name in _FLOOR_POINTS for side in SIDES])
    scores.add_share("under_floor_share", np.asarray(position[:, low_points, 1].min(axis=1) < -UNDER))
    return scores


def _measure_feet(
    scores: RunningScores,
    scripted: ScriptedScene,
    skeleton: Skeleton,
    position: np.ndarray,
    truth: np.ndarray,
    error: np.ndarray,
) -> None:
    """Add measures of steps, gliding, floating, crossing and knees."""

    def pair(name: str, values: np.ndarray) -> np.ndarray:
        return values[:, skeleton.indices([f"{side}_{name}" for side in SIDES])]

    balls, true_balls = pair("foot", position), pair("foot", truth)
    ankles, true_ankles = pair("ankle", position), pair("ankle", truth)
    rest = float(rest_heights(skeleton)[skeleton.index("left_foot")])
    missed, count = missed_steps(scripted, balls, true_balls)
    scores.add("missed_steps_share", missed / max(count, 1), count)
    scores.add("steps", count, 1.0)
    minutes = len(truth) / RATE / 60
    scores.add("false_steps_per_minute", sight.false_steps(balls, true_balls, RATE) / minutes, minutes)
    calm = calm_frames(position[:, skeleton.index("head")])
    glides = gliding_feet(balls, rest) & ~gliding_feet(true_balls, rest)
    scores.add_share("gliding_share", glides[calm].max(axis=1))
    seated = scripted.in_phase("seated")
    crossed = crossed_legs(ankles, position, skeleton) & ~crossed_legs(true_ankles, truth, skeleton)
    scores.add_share("crossed_share", crossed[~seated])
    for phase in ("standing", "bowing"):
        during = scripted.in_phase(phase) & scripted.planted.any(axis=1)
        scores.add_share(f"float_{phase}_share", sight.floating_frames(balls, true_balls, rest)[during])
    kneels = scripted.in_phase("kneeling")
    if kneels.any():
        over = np.asarray(balls[kneels, :, 1] > np.maximum(true_balls[kneels, :, 1], rest) + sight.FLOATING)
        scores.add_share("float_kneeling_share", over)
        scores.add("kneeling_legs_cm", float(error[kneels][:, skeleton.indices(LEGS)].mean()), int(kneels.sum()))
    bent, true_bent = (
        sight.knee_flexion(pair("hip", values), pair("knee", values), pair("ankle", values))
        for values in (position, truth)
    )
    scores.add("knee_off_deg", float(np.abs(bent - true_bent).mean()), len(truth))
    still = scripted.in_phase("standing") & scripted.planted.all(axis=1)
    if still.any():
        scores.add("standing_knee_excess_deg", float((bent - true_bent)[still].mean()), int(still.sum()))


def missed_steps(scripted: ScriptedScene, balls: np.ndarray, truth: np.ndarray) -> tuple[int, int]:
    """Return the number of true steps that the output feet miss, and the number of true steps of `STEP` or more.

    The output foot misses a step if it moves less than half as far, from `BEFORE` to `AFTER` s around it. Balls of the
    feet are (T, 2, 3) m.
    """
    missed, steps, last = 0, 0, len(truth) - 1
    for step in scripted.steps:
        begin, end = round(step.begin * RATE), round(step.end * RATE)
        if begin < 0 or end > last:
            continue
        length = _level(truth[end, step.side] - truth[begin, step.side])
        if length < STEP:
            continue
        first, final = max(0, begin - round(BEFORE * RATE)), min(last, end + round(AFTER * RATE))
        path = _level(balls[first : final + 1, step.side] - balls[first, step.side])
        steps, missed = steps + 1, missed + int(path.max() < length / 2)
    return missed, steps


def gliding_feet(balls: np.ndarray, rest: float) -> np.ndarray:
    """Return (T − 1, 2) bool: feet that glide along the floor.

    Args:
        balls: balls of the feet (T, 2, 3) m; a foot is on the floor if its ball is lower than `ON_FLOOR` over its rest
            height in both frames.
        rest: height of the balls in the rest pose, m.
    """
    low = balls[..., 1] < rest + ON_FLOOR
    return (_level(np.diff(balls, axis=0)) * RATE > GLIDES) & low[1:] & low[:-1]


def calm_frames(head: np.ndarray) -> np.ndarray:
    """Return (T − 1,) bool: frames in which a head (T, 3) m moves slower than `CALM_HEAD`."""
    return np.asarray(vector_length(np.diff(head, axis=0)) * RATE < CALM_HEAD)


def crossed_legs(ankles: np.ndarray, position: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return (T,) bool: the left ankle is to the right of the right ankle, by the line between the hips."""
    hips = position[:, skeleton.index("left_hip")] - position[:, skeleton.index("right_hip")]
    hips = hips * [1.0, 0.0, 1.0]
    across = hips / np.maximum(np.linalg.norm(hips, axis=-1, keepdims=True), 1e-6)
    return np.asarray(((ankles[:, 0] - ankles[:, 1]) * across).sum(axis=-1) < -CROSSED)


def _measure_turns(scores: RunningScores, scene: TrackedScene, tracked: TrackedMotion) -> None:
    """Add the angle by which the pelvis is behind the true one while it turns, and the absolute angle, degrees."""
    true_yaw = _yaw(scene.world_pose[1][:, 0])
    off = _yaw(quaternion_multiply(quaternion_conjugate(scene.facing), np.asarray(heading(tracked.rotation[:, 0]))))
    rate = np.degrees(np.gradient(np.unwrap(true_yaw))) * RATE
    turns = np.abs(rate) > TURNING
    if turns.any():
        behind = -np.degrees(off) * np.sign(rate)
        scores.add("turn_lag_deg", float(behind[turns].mean()), int(turns.sum()))
        scores.add("turn_off_deg", float(np.abs(behind[turns]).mean()), int(turns.sum()))


def _yaw(rotation: np.ndarray) -> np.ndarray:
    """Return headings (T,), radians, of rotations (T, 4) wxyz."""
    ahead = np.asarray(quaternion_rotate(rotation, np.broadcast_to([0.0, 0.0, 1.0], (len(rotation), 3))))
    return np.arctan2(ahead[:, 0], ahead[:, 2])


def _level(vector: np.ndarray) -> np.ndarray:
    """Return the length (...) of the horizontal part of vectors (..., 3)."""
    return np.hypot(vector[..., 0], vector[..., 2])
