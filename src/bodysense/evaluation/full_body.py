"""A whole body from a headset and two hands: errors, motion and feet, by groups of clips (docs: metrics).

Positions are of the 22 joints of `BODY`, measured from the head; rotations are local ones, parent ← joint, of the same.
Velocities, jitter, skate and depth under the floor are of the world. Everything is at `RATE` and averaged over frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, LOWER_BODY, Skeleton
from bodysense.body.stature import height_from_headset
from bodysense.data.augment import at_height
from bodysense.data.clip import Clip
from bodysense.data.resample import resample
from bodysense.errors import BodysenseError
from bodysense.estimators.estimate import Estimator
from bodysense.estimators.ik_tracker import IkTracker
from bodysense.evaluation.headset import RATE, group_of
from bodysense.evaluation.metrics import (
    floor_penetration,
    foot_skate,
    jitter,
    joint_error,
    mpjre_component,
    on_floor,
    rotation_error,
    velocity_error,
)
from bodysense.evaluation.spread import spread
from bodysense.observation import Observation
from bodysense.occlusion.three_point import ThreePoint, observe

Stage = Literal["estimate", "tracked", "truth"]  # the estimator's own answer, what the tracker makes of it, the motion
MakeEstimator = Callable[[Skeleton], Estimator]
Sums = dict[tuple[str, Stage, str], "Mean"]  # by group of clips, stage and measure

REGIONS = {
    "": BODY,
    "lower_": LOWER_BODY,
    "upper_": tuple(name for name in BODY if name not in LOWER_BODY),
    "hands_": ("left_wrist", "right_wrist"),
}
HEAD_FAR, HAND_FAR = 1.0, 2.0  # cm: farther than this from where they are measured, head and hands are misplaced
_BALLS = ("left_foot", "right_foot")
_FEET = (*_BALLS, "left_ankle", "right_ankle", "left_toe", "right_toe")


@dataclass
class Mean:
    """A running mean."""

    count: float = 0.0
    total: float = 0.0

    def add(self, value: float, count: float) -> None:
        """Count a mean of so many values; nothing where there are none."""
        if count:
            self.count += count
            self.total += value * count

    def merge(self, other: Mean) -> None:
        """Count what another has counted."""
        self.count += other.count
        self.total += other.total

    @property
    def value(self) -> float:
        """NaN where nothing was counted."""
        return self.total / self.count if self.count else math.nan


@dataclass(frozen=True)
class FullBodyScores:
    """What one estimator scored on one set of clips."""

    sums: Sums = field(repr=False)
    clips: int
    seconds: float

    def get(self, measure: str, stage: Stage = "tracked", group: str = "main") -> float:
        """One figure, of the measures that `score_clip` lists; NaN where nothing was counted."""
        return self.sums.get((group, stage, measure), Mean()).value


def evaluate_full_body(
    clips: Iterable[Clip],
    make_estimator: MakeEstimator,
    device: ThreePoint = ThreePoint(),
    *,
    tracked: bool = True,
    height: float | None = None,
    measured: bool = False,
    jobs: int = 1,
    advance: Callable[[Clip], None] = lambda clip: None,
) -> FullBodyScores:
    """Score an estimator on what headset and hands track of canonical clips.

    Args:
        clips: The motion.
        make_estimator: Makes the estimator for a wearer's skeleton; must pickle where `jobs` is not 1.
        device: What is tracked; `HEAD_ONLY` has no hands.
        tracked: Also score what the tracker makes of it.
        height: Metres; scales every body.
        measured: The estimator is not told the height; it is taken from the headset.
        jobs: Processes.
        advance: Is told of every clip that is done.
    """
    sums: Sums = {}
    count, seconds = 0, 0.0
    options = {"device": device, "tracked": tracked, "height": height, "measured": measured}
    work = partial(score_clip, make_estimator=make_estimator, **options)
    for clip, one in spread(work, clips, jobs):
        for key, mean in one.items():
            sums.setdefault(key, Mean()).merge(mean)
        count, seconds = count + 1, seconds + clip.seconds
        advance(clip)
    return FullBodyScores(sums, count, seconds)


def score_clip(
    clip: Clip,
    make_estimator: MakeEstimator,
    device: ThreePoint,
    tracked: bool,
    height: float | None,
    measured: bool = False,
) -> Sums:
    """Every measure of one clip.

    `mpjpe_cm`, with `lower_`, `upper_` or `hands_` before it of a region, `hands_world_cm` and `head_world_cm` of what
    is measured, `rotation_deg`, `mpjre_component_deg`, `velocity_cm_s`, `jitter` (10² m/s³), `skate_cm_s` and
    `penetration_cm`; the last three of the truth too. With `measured` also `height_error_cm`, and `refused`, the share
    of frames of clips whose wearer's height the headset does not tell: those have no other measure.
    """
    clip = resample(clip if height is None else at_height(clip, height), RATE)
    skeleton = clip.pose.skeleton
    observation = observe(clip.pose, clip.time, device)
    wearer, said = _measured(observation, skeleton) if measured else (skeleton, {})
    sums: Sums = {}
    group = group_of(clip)
    for measure, value in said.items():
        sums.setdefault((group, "estimate", measure), Mean()).add(value, len(clip))
    if wearer is None:
        return sums
    estimator = make_estimator(wearer)
    truth = _Motion(*_placed(clip.pose))
    motions: dict[Stage, _Motion] = {"truth": truth}
    if tracked:
        tracker = IkTracker(estimator)
        pose, estimate, _ = tracker.step(observation, tracker.start())
        motions["tracked"] = _Motion(*_placed(pose))
    else:
        estimate, _ = estimator.step(observation, estimator.start())
    local = None if estimate.pose is None else estimate.pose.rotation
    motions["estimate"] = _Motion(estimate.position, local)
    for stage, motion in motions.items():
        for measure, (value, count) in _measures(motion, truth, skeleton).items():
            if stage != "truth" or measure in ("jitter", "skate_cm_s", "penetration_cm"):
                sums.setdefault((group, stage, measure), Mean()).add(value, count)
    return sums


def _measured(observation: Observation, skeleton: Skeleton) -> tuple[Skeleton | None, dict[str, float]]:
    """The body of a wearer whose height the headset tells, None where it does not, and measures of that."""
    try:
        height = height_from_headset(observation.position[:, observation.points.index("head"), 1], skeleton)
    except BodysenseError:
        return None, {"refused": 1.0}
    return skeleton.scaled(height), {"refused": 0.0, "height_error_cm": 100 * abs(height - skeleton.height)}


@dataclass(frozen=True, eq=False)
class _Motion:
    position: np.ndarray  # (T, P, 3) m, world
    rotation: np.ndarray | None  # (T, J, 4) wxyz, parent ← joint


def _placed(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(forward_kinematics(pose)[0]), pose.rotation


def _measures(motion: _Motion, truth: _Motion, skeleton: Skeleton) -> dict[str, tuple[float, float]]:
    """Means and how many values they are of."""
    head, body = skeleton.index("head"), skeleton.indices(BODY)
    frames = len(motion.position)
    from_head = joint_error(motion.position - motion.position[:, [head]], truth.position - truth.position[:, [head]])
    in_world = joint_error(motion.position, truth.position)
    measures: dict[str, tuple[float, float]] = {}
    for region, names in REGIONS.items():
        measures[f"{region}mpjpe_cm"] = (float(from_head[:, skeleton.indices(names)].mean()), frames)
    measures["head_world_cm"] = (float(in_world[:, head].mean()), frames)
    measures["hands_world_cm"] = (float(in_world[:, skeleton.indices(REGIONS["hands_"])].mean()), frames)
    measures["head_far_share"] = (float((in_world[:, head] > HEAD_FAR).mean()), frames)
    measures["hands_far_share"] = (float((in_world[:, skeleton.indices(REGIONS["hands_"])] > HAND_FAR).mean()), frames)
    if motion.rotation is not None and truth.rotation is not None:
        turned = forward_kinematics(Pose(skeleton, motion.position[:, 0], motion.rotation))[1][:, head]
        wanted = forward_kinematics(Pose(skeleton, truth.position[:, 0], truth.rotation))[1][:, head]
        measures["head_world_deg"] = (rotation_error(turned, wanted), frames)
        measures["rotation_deg"] = (rotation_error(motion.rotation[:, body], truth.rotation[:, body]), frames)
        measures["mpjre_component_deg"] = (mpjre_component(motion.rotation[:, body], truth.rotation[:, body]), frames)
    if frames > 1:
        measures["velocity_cm_s"] = (
            velocity_error(motion.position[:, body], truth.position[:, body], RATE),
            frames - 1,
        )
        balls = skeleton.indices(_BALLS)
        standing = float(on_floor(truth.position[:, balls], RATE).sum())
        measures["skate_cm_s"] = (foot_skate(motion.position[:, balls], truth.position[:, balls], RATE), standing)
    if frames > 3:
        measures["jitter"] = (jitter(motion.position[:, body], RATE), frames - 3)
    measures["penetration_cm"] = (floor_penetration(motion.position[:, skeleton.indices(_FEET)]), frames)
    return measures
