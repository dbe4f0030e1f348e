"""The measures of sight over many clips: shares, rates, percentiles and mean jerk curves."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import get_args

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.rotation import geodesic_angle
from bodysense.body.skeleton import BODY
from bodysense.metrics import vector_length
from bodysense.observation import Observation, observed_points
from bodysense_lab.completion import sight
from bodysense_lab.completion.measures import JUMP, Averages
from bodysense_lab.completion.quantiles import Quantiles
from bodysense_lab.completion.scenes import TrackedScene
from bodysense_lab.completion.sight import Moment
from bodysense_lab.completion.tracking import Tracked
from bodysense_lab.scoring import RATE

_PERCENT = {  # percentile and factor of every quantile, by its key
    "standing_knee_deg": ("knee", 50, 1.0),
    "reentry_speed_m_s": ("reentry", 99, 1.0),
    "measured_p95_cm": ("measured", 95, 100.0),
    "measured_rotation_deg": ("measured_rotation", 95, 1.0),
}
_PAIR = ("left", "right")
TAKE = "take_"  # begins the keys of takes, completed with past and future


@dataclass
class JerkCurves:
    """Sums of jerk curves (K,) m/s³ of the output and of the truth, over moments of one kind."""

    output: np.ndarray = field(default_factory=lambda: np.zeros(round(sight.TRANSITION * RATE)))
    truth: np.ndarray = field(default_factory=lambda: np.zeros(round(sight.TRANSITION * RATE)))
    count: int = 0

    def merge(self, other: JerkCurves) -> None:
        """Count what another has counted."""
        self.output, self.truth, self.count = (
            self.output + other.output,
            self.truth + other.truth,
            self.count + other.count,
        )


@dataclass
class SightScores:
    """Running scores of one cell."""

    averages: Averages = field(default_factory=Averages)
    quantiles: dict[str, Quantiles] = field(default_factory=dict)
    curves: dict[str, JerkCurves] = field(default_factory=dict)  # by moment; of takes after "take_"

    def merge(self, other: SightScores) -> None:
        """Count what another has counted."""
        self.averages.merge(other.averages)
        for name, one in other.quantiles.items():
            self.quantiles.setdefault(name, Quantiles()).merge(one)
        for moment, curves in other.curves.items():
            self.curves.setdefault(moment, JerkCurves()).merge(curves)

    def numbers(self) -> dict[str, float]:
        """Every figure by its key; those of which nothing was counted are left out."""
        result = {name: self.averages.get(name) for name in self.averages.weight}
        for key, (name, percent, factor) in _PERCENT.items():
            if name in self.quantiles:
                result[key] = factor * self.quantiles[name].at(percent)
        for kind in ("", TAKE):
            ratios, areas = [], []
            for moment in get_args(Moment):
                curves = self.curves.get(f"{kind}{moment}", JerkCurves())
                if curves.count:
                    output, truth = curves.output / curves.count, curves.truth / curves.count
                    ratios.append(sight.peak_jerk_ratio(output, truth))
                    areas.append(sight.area_under_jerk(output, truth))
                    result |= {f"{kind}{moment}_pj_ratio": ratios[-1], f"{kind}{moment}_auj": areas[-1]}
            if ratios:  # the worse of loss and return
                result |= {f"{kind}pj_ratio": max(ratios), f"{kind}auj": max(areas)}
        return {name: value for name, value in result.items() if math.isfinite(value)}

    def count_share(self, name: str, mask: np.ndarray) -> None:
        """Count the share of a mask (N,) that is true."""
        if mask.size:
            self.averages.add(name, float(mask.mean()), mask.size)

    def count_values(self, name: str, values: np.ndarray) -> None:
        """Count values of which a percentile is wanted."""
        if values.size:
            self.quantiles.setdefault(name, Quantiles()).add(values)


def measure_sight(scene: TrackedScene, seen: Observation, tracked: Tracked) -> SightScores:
    """Every measure of sight of one scene, of which the tracker saw `seen` (T, P)."""
    scores, skeleton = SightScores(), scene.skeleton
    if len(scene) < 2:
        return scores
    body = skeleton.indices(BODY)
    truth, position = scene.placed[0], tracked.position
    _, measured, has, has_rotation = (values[:, body] for values in observed_points(seen, skeleton))
    masks = np.concatenate([seen.has_position, seen.has_rotation], axis=-1)
    _measure_motion(scores, position[:, body], truth[:, body], has, masks)
    _measure_stance(scores, scene, position)
    knees = skeleton.indices([f"{side}_knee" for side in _PAIR])
    back, truly = (sight.backward_knees(values[:, knees]) for values in (tracked.rotation, scene.pose.rotation))
    scores.count_share("backward_knee_share", back & ~truly)
    elbows = skeleton.indices([f"{side}_elbow" for side in _PAIR])
    turned = np.degrees(geodesic_angle(tracked.rotation[:, elbows], scene.pose.rotation[:, elbows]))
    scores.averages.add("elbow_deg", float(turned.mean()), len(scene))
    long = sight.long_seen(has, RATE)
    off = vector_length(position[:, body] - truth[:, body])[long]
    scores.count_values("measured", off)
    scores.count_share("measured_covered", off <= tracked.bound[:, body][long])
    long = sight.long_seen(has_rotation, RATE)
    output = np.asarray(forward_kinematics(replace(scene.pose, rotation=tracked.rotation))[1])[:, body]
    scores.count_values("measured_rotation", np.degrees(geodesic_angle(output[long], measured[long])))
    return scores


def measure_transitions(scene: TrackedScene, seen: Observation, tracked: Tracked, kind: str = "") -> SightScores:
    """Jerk after each loss and each return of a hand, over the 22 joints; `kind` is `TAKE` for a take."""
    scores, skeleton = SightScores(), scene.skeleton
    body, truth = skeleton.indices(BODY), scene.placed[0]
    for side in _PAIR:
        mask = observed_points(seen, skeleton)[2][:, skeleton.index(f"{side}_wrist")]
        for moment, frames in sight.transition_frames(mask, RATE).items():
            output, truly = (
                sight.transition_jerks(values[:, body], frames, RATE) for values in (tracked.position, truth)
            )
            scores.curves.setdefault(f"{kind}{moment}", JerkCurves()).merge(
                JerkCurves(output.sum(axis=0), truly.sum(axis=0), len(frames))
            )
    return scores


def count_body_jumps(scene: TrackedScene, position: np.ndarray) -> int:
    """Frames in which one of the 22 joints of positions (T, P, 3) m jumps."""
    body = scene.skeleton.indices(BODY)
    return int(sight.jump_frames(position[:, body], scene.placed[0][:, body], JUMP / 100).sum())


def _measure_motion(
    scores: SightScores, position: np.ndarray, truth: np.ndarray, has: np.ndarray, masks: np.ndarray
) -> None:
    """Jumps, frozen points and re-entries of the 22 joints."""
    jumps, near = sight.jump_frames(position, truth, JUMP / 100), sight.near_change(masks)[1:]
    minutes = len(jumps) / RATE / 60
    for name, mask in (("at_change", near), ("elsewhere", ~near)):
        scores.averages.add(f"jumps_{name}_per_minute", int((jumps & mask).sum()) / minutes, minutes)
    scores.count_share("frozen_share", sight.frozen_points(position, truth, has, RATE))
    scores.count_values("reentry", sight.reentry_speeds(position, has, RATE))


def _measure_stance(scores: SightScores, scene: TrackedScene, position: np.ndarray) -> None:
    """Feet, knees and steps."""
    skeleton, truth = scene.skeleton, scene.placed[0]
    rest = skeleton.rest_offset[0, 1] + (skeleton.path @ skeleton.rest_offset)[:, 1]

    def pair(name: str, values: np.ndarray) -> np.ndarray:
        return values[:, skeleton.indices([f"{side}_{name}" for side in _PAIR])]

    balls, true_balls = (pair("foot", values) for values in (position, truth))
    ball_rest = float(rest[skeleton.index("left_foot")])
    stands = sight.standing_frames(true_balls, truth[:, 0], ball_rest, float(rest[0]), RATE)
    scores.count_share("float_share", sight.floating_frames(balls, true_balls, ball_rest)[stands])

    bent, truly = (
        sight.knee_flexion(pair("hip", values), pair("knee", values), pair("ankle", values))
        for values in (position, truth)
    )
    scores.count_values("knee", bent[(truly < sight.STRAIGHT).all(axis=-1)])
    if stands.any():
        scores.averages.add("knee_excess_deg", float((bent - truly)[stands].mean()), int(stands.sum()))

    ankles, true_ankles = (pair("ankle", values) for values in (position, truth))
    minutes = len(truth) / RATE / 60
    steps = sight.false_steps(ankles, true_ankles, RATE)
    scores.averages.add("false_steps_per_minute", steps / minutes, minutes)
    missed, count = sight.missed_steps(ankles, true_ankles, RATE)
    scores.averages.add("missed_steps_share", missed / max(count, 1), count)
    scores.count_share("wrong_foot_share", sight.wrong_feet(ankles, true_ankles, scene.facing))
