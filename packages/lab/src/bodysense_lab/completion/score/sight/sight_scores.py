"""Measures of visible faults over many clips: shares, rates, percentiles and mean jerk curves."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import get_args

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.geometry.rotation import geodesic_angle
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.quality.metrics import vector_length
from bodysense_lab.completion.score.measures import JUMP
from bodysense_lab.completion.score.scenes import TrackedScene
from bodysense_lab.completion.score.scores import RunningScores, histogram, percentile
from bodysense_lab.completion.score.sight import sight
from bodysense_lab.completion.score.sight.sight import Moment
from bodysense_lab.completion.score.sight.wearers import rest_heights
from bodysense_lab.completion.score.tracking import TrackedMotion
from bodysense_lab.core.scoring import RATE

_PERCENT = {  # key of a figure: name of its histogram, percentile and factor
    "standing_knee_deg": ("knee", 50, 1.0),
    "reentry_speed_m_s": ("reentry", 99, 1.0),
    "measured_p95_cm": ("measured", 95, 100.0),
    "measured_rotation_deg": ("measured_rotation", 95, 1.0),
}
_PAIR = ("left", "right")
TAKE = "take_"  # prefix of keys of takes, which are completed with past and future


class CellScores(RunningScores):
    """Running scores of one cell: means, histograms for percentiles, and jerk curves after losses and returns."""

    def numbers(self) -> dict[str, float]:
        """Return all figures by key, without those for which nothing was counted."""
        result = super().numbers()
        for key, (name, percent, factor) in _PERCENT.items():
            if ("quantiles", name) in self.sums:
                result[key] = factor * percentile(self.sums["quantiles", name], percent)
        for kind in ("", TAKE):
            ratios, areas = [], []
            for moment in (f"{kind}{moment}" for moment in get_args(Moment)):
                count = int(self.sums.get(("moments", moment), 0))
                if count:
                    output, truth = self.sums["curves", moment] / count
                    ratios.append(sight.peak_jerk_ratio(output, truth))
                    areas.append(sight.area_under_jerk(output, truth))
                    result |= {f"{moment}_pj_ratio": ratios[-1], f"{moment}_auj": areas[-1]}
            if ratios:  # the worse of loss and return
                result |= {f"{kind}pj_ratio": max(ratios), f"{kind}auj": max(areas)}
        return {name: value for name, value in result.items() if math.isfinite(value)}

    def add_values(self, name: str, values: np.ndarray) -> None:
        """Add values to the histogram of a percentile."""
        if values.size:
            self.add_sum("quantiles", name, histogram(values))


def measure_sight(scene: TrackedScene, seen: Observation, tracked: TrackedMotion) -> CellScores:
    """Return all measures of visible faults of a scene; `seen` (T, P) is the tracker's input."""
    scores, skeleton = CellScores(), scene.skeleton
    if len(scene) < 2:
        return scores
    body = skeleton.indices(BODY)
    truth, position = scene.world_pose[0], tracked.position
    _, measured, has, has_rotation = (values[:, body] for values in observed_points(seen, skeleton))
    masks = np.concatenate([seen.has_position, seen.has_rotation], axis=-1)
    _measure_motion(scores, position[:, body], truth[:, body], has, masks)
    _measure_stance(scores, scene, position)
    knees = skeleton.indices([f"{side}_knee" for side in _PAIR])
    back, true_back = (sight.backward_knees(values[:, knees]) for values in (tracked.rotation, scene.pose.rotation))
    scores.add_share("backward_knee_share", back & ~true_back)
    elbows = skeleton.indices([f"{side}_elbow" for side in _PAIR])
    turned = np.degrees(geodesic_angle(tracked.rotation[:, elbows], scene.pose.rotation[:, elbows]))
    scores.add("elbow_deg", float(turned.mean()), len(scene))
    long = sight.long_seen(has, RATE)
    off = vector_length(position[:, body] - truth[:, body])[long]
    scores.add_values("measured", off)
    scores.add_share("measured_covered", off <= tracked.bound[:, body][long])
    long = sight.long_seen(has_rotation, RATE)
    output = np.asarray(forward_kinematics(replace(scene.pose, rotation=tracked.rotation))[1])[:, body]
    scores.add_values("measured_rotation", np.degrees(geodesic_angle(output[long], measured[long])))
    return scores


def measure_transitions(scene: TrackedScene, seen: Observation, tracked: TrackedMotion, kind: str = "") -> CellScores:
    """Return jerk curves of the 22 joints after each loss and return of a hand; `kind` is `TAKE` for a take."""
    scores, skeleton = CellScores(), scene.skeleton
    body, truth = skeleton.indices(BODY), scene.world_pose[0]
    for side in _PAIR:
        mask = observed_points(seen, skeleton)[2][:, skeleton.index(f"{side}_wrist")]
        for moment, frames in sight.transition_frames(mask, RATE).items():
            output, true_output = (
                sight.transition_jerks(values[:, body], frames, RATE) for values in (tracked.position, truth)
            )
            scores.add_sum("curves", f"{kind}{moment}", np.stack([output.sum(axis=0), true_output.sum(axis=0)]))
            scores.add_sum("moments", f"{kind}{moment}", np.array(len(frames)))
    return scores


def _measure_motion(
    scores: CellScores, position: np.ndarray, truth: np.ndarray, has: np.ndarray, masks: np.ndarray
) -> None:
    """Add jumps, frozen points and re-entry speeds of the 22 joints."""
    jumps, near = sight.jump_frames(position, truth, JUMP / 100), sight.near_change(masks)[1:]
    minutes = len(jumps) / RATE / 60
    for name, mask in (("at_change", near), ("elsewhere", ~near)):
        scores.add(f"jumps_{name}_per_minute", int((jumps & mask).sum()) / minutes, minutes)
    scores.add_share("frozen_share", sight.frozen_points(position, truth, has, RATE))
    scores.add_values("reentry", sight.reentry_speeds(position, has, RATE))


def _measure_stance(scores: CellScores, scene: TrackedScene, position: np.ndarray) -> None:
    """Add measures of feet, knees and steps."""
    skeleton, truth = scene.skeleton, scene.world_pose[0]
    rest = rest_heights(skeleton)

    def pair(name: str, values: np.ndarray) -> np.ndarray:
        return values[:, skeleton.indices([f"{side}_{name}" for side in _PAIR])]

    balls, true_balls = (pair("foot", values) for values in (position, truth))
    ball_rest = float(rest[skeleton.index("left_foot")])
    rests = sight.resting_frames(true_balls, ball_rest, RATE)
    upright = sight.upright_frames(truth[:, 0], float(rest[0]))
    stands, floats = rests & upright, sight.floating_frames(balls, true_balls, ball_rest)
    scores.add_share("float_share", floats[stands])
    scores.add_share("low_float_share", floats[rests & ~upright])

    bent, true_bent = (
        sight.knee_flexion(pair("hip", values), pair("knee", values), pair("ankle", values))
        for values in (position, truth)
    )
    scores.add_values("knee", bent[(true_bent < sight.STRAIGHT).all(axis=-1)])
    if stands.any():
        scores.add("knee_excess_deg", float((bent - true_bent)[stands].mean()), int(stands.sum()))

    ankles, true_ankles = (pair("ankle", values) for values in (position, truth))
    minutes = len(truth) / RATE / 60
    steps = sight.false_steps(ankles, true_ankles, RATE)
    scores.add("false_steps_per_minute", steps / minutes, minutes)
    missed, count = sight.missed_steps(ankles, true_ankles, RATE)
    scores.add("missed_steps_share", missed / max(count, 1), count)
    stride, wrong = sight.wrong_feet(ankles, true_ankles, scene.facing)
    walking = sight.walking_frames(truth[:, 0], RATE)
    scores.add_share("wrong_foot_share", wrong[stride])
    scores.add_share("wrong_foot_walking_share", wrong[stride & walking])
    scores.add_share("wrong_foot_astride_share", wrong[stride & ~walking])
