"""Measures of one tracked clip as running scores over frames: errors, motion, feet and jumps.

Positions are relative to the head and rotations to the parent, for the 22 joints of `BODY`. Velocities, jitter, skate,
depth under the floor and jumps are in the world. Everything is at `RATE`.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.skeleton import BODY, LOWER_BODY, Skeleton
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.quality.metrics import (
    floor_penetration,
    foot_skate,
    jitter,
    joint_error,
    mpjpe,
    on_floor,
    rotation_error,
    velocity_error,
)
from bodysense_lab.completion.score.scenes import TrackedScene
from bodysense_lab.completion.score.scores import Calibration, RunningScores
from bodysense_lab.completion.score.sight.sight import jump_frames
from bodysense_lab.completion.score.tracking import TrackedMotion
from bodysense_lab.core.scoring import RATE, scored_points

JUMP = 5.0  # cm in a frame, beyond the distance of the true joint
REGIONS = {"lower": LOWER_BODY, "upper": tuple(name for name in BODY if name not in LOWER_BODY)}
_BALLS = ("left_foot", "right_foot")
_FEET = (*_BALLS, "left_ankle", "right_ankle", "left_toe", "right_toe")


def measure(scene: TrackedScene, tracked: TrackedMotion) -> RunningScores:
    """Return all measures of a scene but those of hidden joints."""
    scores, skeleton, frames = RunningScores(), scene.skeleton, len(scene)
    body = skeleton.indices(BODY)
    truth, position = scene.world_pose[0], tracked.position
    error = scene.error_from_head(position)
    scores.add("mpjpe_cm", mpjpe(error), frames)
    for region, names in REGIONS.items():
        scores.add(f"{region}_mpjpe_cm", mpjpe(error[:, [BODY.index(name) for name in names]]), frames)
    turned = rotation_error(tracked.rotation[:, body], scene.pose.rotation[:, body])
    scores.add("rotation_deg", turned, frames)
    if frames > 1:
        velocity = velocity_error(position[:, body], truth[:, body], RATE)
        scores.add("velocity_cm_s", velocity, frames - 1)
        minutes = (frames - 1) / RATE / 60
        for order, name in ((1, "jumps"), (2, "breaks")):
            scores.add(f"{name}_per_minute", count_jumps(position, scene, order) / minutes, minutes)
    scores.merge(motion_measures(position, truth, skeleton))
    return scores


def motion_measures(position: np.ndarray, truth: np.ndarray, skeleton: Skeleton) -> RunningScores:
    """Return jitter, skate and depth under the floor of positions (T, P, 3) m; `truth` may be the same positions."""
    scores, frames = RunningScores(), len(position)
    if frames > 1:
        balls = skeleton.indices(_BALLS)
        standing = float(on_floor(truth[:, balls], RATE).sum())
        scores.add("skate_cm_s", foot_skate(position[:, balls], truth[:, balls], RATE), standing)
    if frames > 3:
        scores.add("jitter", jitter(position[:, skeleton.indices(BODY)], RATE), frames - 3)
    scores.add("depth_cm", floor_penetration(position[:, skeleton.indices(_FEET)]), frames)
    return scores


def count_jumps(position: np.ndarray, scene: TrackedScene, order: int = 1) -> int:
    """Count frames in which a joint of `BODY` moves `JUMP` farther than the true joint; positions are (T, P, 3) m.

    With `order` 2, the distance is that from the position to which its velocity leads.
    """
    body = scene.skeleton.indices(BODY)
    return int(jump_frames(position[:, body], scene.world_pose[0][:, body], JUMP / 100, order).sum())


def measure_hidden(position: np.ndarray, scene: TrackedScene) -> RunningScores:
    """Return world errors of positions (T, P, 3) m of joints that UNOC tests, in frames in which cameras miss them."""
    scores, tested = RunningScores(), scored_points(scene.skeleton)
    hidden = ~scene.visible[:, tested]
    error = joint_error(position[:, tested], scene.world_pose[0][:, tested])[hidden]
    if error.size:
        scores.add("occluded_mpjpe_cm", float(error.mean()), error.size)
        scores.add("occluded_square", float((error**2).mean()), error.size)
    return scores


def measure_confidence(scene: TrackedScene, seen: Observation, tracked: TrackedMotion) -> dict[str, Calibration]:
    """Return expected and true world errors of untracked joints, by region; `seen` is (T, P)."""
    known = observed_points(seen, scene.skeleton)[2]
    error = joint_error(tracked.position, scene.world_pose[0]) / 100
    regions = {}
    for region, names in REGIONS.items():
        places = scene.skeleton.indices(names)
        counted = ~known[:, places]
        regions[region] = Calibration()
        expected, true, bound = (values[:, places][counted] for values in (tracked.confidence, error, tracked.bound))
        regions[region].add_errors(expected, true, bound)
    return regions
