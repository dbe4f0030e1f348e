"""Scores of scripted wearers and of recorded headsets, for `bodysense evaluate sight`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.body.shape import stature
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.devices.simulated.sensors import SENSOR_SETS, observe
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.quality.metrics import joint_error, vector_length
from bodysense.tracking.estimate import Estimate
from bodysense.tracking.model import CompletionModel
from bodysense.tracking.tracker import Tracker
from bodysense_lab.completion.score.rare_poses import HELD, RARE, rare_pose
from bodysense_lab.completion.score.scenes import stack_observations
from bodysense_lab.completion.score.sight import sight
from bodysense_lab.completion.score.sight.wearers import (
    HEIGHT,
    PALMS,
    RAISES,
    arms_raised,
    head_paths,
    known_body,
    rest_heights,
    seated,
    standing_head,
    with_hands,
)
from bodysense_lab.core.scoring import RATE
from bodysense_lab.core.table import Cell, Report

SEATED_HEIGHTS = (1.55, 1.74, 1.88)  # m
SEATED_SETS = ("head", "three_point")
RARE_SETS = ("three_point", "headset_camera", "head", "six_point")  # sensor sets that track the poses of `RARE`
STANDING_HEIGHTS = (1.55, 1.70, 1.85)  # m
LOWERED = (0.0, 0.05, 0.10, 0.15)  # m by which a standing head is lowered
STANDS = 0.85  # of its standing height; a higher head is that of a standing wearer
SETTLED_AFTER, HEIGHT_SETTLED_AFTER = 3.0, 10.0  # s; earlier errors and inferred heights do not count
_RAISED_FOR = 1.0  # s between the loss of raised arms and their measurement
_PAIR = ("left", "right")
_PALM_TITLES = {palms: f"palms {palms}" if palms != "none" else "head alone" for palms in PALMS}


@dataclass(frozen=True)
class SightScore:
    """A figure of the table."""

    scene: str
    what: str
    key: str
    value: float
    unit: str


def score_wearers(network: CompletionModel | None = None, headset: Path | None = None) -> list[SightScore]:
    """Return all figures of a network (None: the packaged one).

    `headset` is a folder of recorded headsets (None: left out).
    """
    scores = [one for part in (_standing, _seated, _raised, _rare) for one in part(network)]
    return scores if headset is None else [*scores, *_headsets(network, headset)]


def sight_report(scores: list[SightScore]) -> Report:
    """Return the table of the figures."""
    rows: list[tuple[Cell, ...]] = [(one.scene, one.what, one.value, one.unit) for one in scores]
    return Report(
        name="sight",
        title="Scripted wearers and real headsets",
        columns=("wearer", "measure", "value", "unit"),
        rows=tuple(rows),
        numbers={one.key: one.value for one in scores},
        caption="docs/evaluation.md defines the measures.",
        digits=2,
    )


def _track(people: Sequence[Person], seen: Sequence[Observation], network: CompletionModel | None) -> Estimate:
    """Track all people in one call, (B, T); shorter observations repeat their last frame."""
    tracker = Tracker(people, network)
    return tracker.step(stack_observations(seen), tracker.start())[0]


def _points(skeleton: Skeleton, *names: str) -> np.ndarray:
    return skeleton.indices([f"{side}_{name}" for name in names for side in _PAIR])


def _lower_ball(skeleton: Skeleton, position: np.ndarray) -> np.ndarray:
    """Return the height (T,) of the lower ball of the feet over its rest height, m."""
    balls = _points(skeleton, "foot")
    return position[:, balls, 1].min(axis=-1) - rest_heights(skeleton)[balls[0]]


def _bent(skeleton: Skeleton, position: np.ndarray) -> np.ndarray:
    """Return the flexion of the knees (T, 2), degrees."""
    hip, knee, ankle = (position[:, _points(skeleton, name)] for name in ("hip", "knee", "ankle"))
    return sight.knee_flexion(hip, knee, ankle)


def _standing(network: CompletionModel | None) -> Iterator[SightScore]:
    """Score still standing at known height: height of the feet and flexion of the knees."""
    bodies = [(known_body(height), lowered) for height in STANDING_HEIGHTS for lowered in LOWERED]
    people = [Person(height=height) for height in STANDING_HEIGHTS for _ in LOWERED]
    for palms in PALMS:
        seen = [with_hands(standing_head(skeleton, lowered), palms, skeleton) for skeleton, lowered in bodies]
        position = _track(people, seen, network).points[:, -round(RATE) :]
        balls = [_lower_ball(body, one).mean() for (body, _), one in zip(bodies, position, strict=True)]
        knees = [
            _bent(body, one).mean() for (body, lowered), one in zip(bodies, position, strict=True) if lowered == 0.0
        ]
        scene, key = f"stands, {_PALM_TITLES[palms]}", f"standing_{palms}"
        yield SightScore(scene, "lower ball over rest, worst", f"{key}_ball_cm", 100 * float(max(balls)), "cm")
        yield SightScore(scene, "knees, head at its height", f"{key}_knee_deg", float(np.mean(knees)), "°")


def _seated(network: CompletionModel | None) -> Iterator[SightScore]:
    """Score an unknown body that sits from the first frame on."""
    bodies = [known_body(height) for height in SEATED_HEIGHTS]
    poses = [seated(skeleton) for skeleton in bodies]
    time = np.arange(len(poses[0].root_position)) / RATE
    settled = time >= SETTLED_AFTER
    for sensors in SEATED_SETS:
        seen = [observe(pose, time, SENSOR_SETS[sensors]) for pose in poses]
        estimate = _track([Person()] * len(bodies), seen, network)
        for k, (height, skeleton, pose) in enumerate(zip(SEATED_HEIGHTS, bodies, poses, strict=True)):
            truth = np.asarray(forward_kinematics(pose)[0])
            error = joint_error(estimate.points[k], truth)[settled]
            believed = np.asarray(stature(estimate.rest_offset[k]))[time >= HEIGHT_SETTLED_AFTER].min()
            scene, key = f"sits, {height:g} m, {sensors.replace('_', ' ')}", f"seated_{round(100 * height)}_{sensors}"
            yield SightScore(scene, "pelvis after 3 s", f"{key}_pelvis_cm", float(error[:, 0].mean()), "cm")
            body = skeleton.indices(BODY)
            yield SightScore(scene, "mean error after 3 s", f"{key}_error_cm", float(error[:, body].mean()), "cm")
            height_error = 100 * float(believed - stature(skeleton.rest_offset))
            yield SightScore(
                scene, "shortest believed height after 10 s", f"{key}_height_cm", height_error, "cm from true"
            )


def _raised(network: CompletionModel | None) -> Iterator[SightScore]:
    """Score arms raised out of the cameras' view: elevation of the wrists 1 s after both are lost."""
    skeleton = known_body(HEIGHT)
    for way in RAISES:
        pose = arms_raised(skeleton, way)
        time = np.arange(len(pose.root_position)) / RATE
        seen = observe(pose, time, SENSOR_SETS["headset_camera"])
        wrists = seen.has_position[:, _points(skeleton, "wrist")]
        lost = int(np.flatnonzero(wrists.any(axis=-1)).max(initial=0)) + 1
        frame = min(lost + round(_RAISED_FOR * RATE), len(time) - 1)
        truth = np.asarray(forward_kinematics(pose)[0])
        estimate = _track([Person(skeleton)], [seen], network)
        for what, key, position in (("truth", "truth_", truth), ("output", "", estimate.points[0])):
            shoulder, wrist = (position[frame, _points(skeleton, name)] for name in ("shoulder", "wrist"))
            arm = wrist - shoulder
            angle = np.degrees(np.arctan2(arm[:, 1], np.hypot(arm[:, 0], arm[:, 2]))).min()
            scene, measure = f"arms raised out of view, {way}", f"{what}: over the shoulder, 1 s after"
            yield SightScore(scene, measure, f"raised_{way}_{key}deg", float(angle), "°")


def _rare(network: CompletionModel | None) -> Iterator[SightScore]:
    """Score poses of `RARE` of a known body: bounds of untracked joints, and knees that bend backward."""
    skeleton = known_body(HEIGHT)
    poses = [rare_pose(skeleton, name) for name in RARE]
    time = np.arange(len(poses[0].root_position)) / RATE
    held = time >= HELD
    body, knees = skeleton.indices(BODY), _points(skeleton, "knee")
    truth = np.stack([np.asarray(forward_kinematics(pose)[0]) for pose in poses])[:, held][..., body, :]
    truly = sight.backward_knees(np.stack([pose.rotation for pose in poses])[:, held][..., knees, :])
    for sensors in RARE_SETS:
        seen = [observe(pose, time, SENSOR_SETS[sensors]) for pose in poses]
        estimate = _track([Person(skeleton)] * len(poses), seen, network)
        hidden = ~observed_points(stack_observations(seen), skeleton)[2][:, held][..., body]
        off = vector_length(estimate.points[:, held][..., body, :] - truth)
        within = off <= estimate.bound[:, held][..., body]
        by_pose = [float(one[counted].mean()) for one, counted in zip(within, hidden, strict=True)]
        back = sight.backward_knees(estimate.pose.rotation[:, held][..., knees, :]) & ~truly
        scene, key = f"rare poses, {sensors.replace('_', ' ')}", f"rare_{sensors}"
        least = list(RARE)[int(np.argmin(by_pose))].replace("_", " ")
        yield SightScore(scene, "within the 90 % bound", f"{key}_covered", float(within[hidden].mean()), "of joints")
        yield SightScore(scene, f"the same, {least}", f"{key}_least_covered", min(by_pose), "of joints")
        yield SightScore(
            scene, "knees that bend backward", f"{key}_backward_knee_share", float(back.mean()), "of knees"
        )


def _headsets(network: CompletionModel | None, folder: Path) -> Iterator[SightScore]:
    """Score recorded heads of people who stand and play: share of frames in which both feet float."""
    skeleton = known_body(HEIGHT)
    standing = rest_heights(skeleton)[skeleton.index("head")]
    paths = list(head_paths(folder, skeleton))
    for palms in PALMS:
        seen = [with_hands(path, palms, skeleton) for path in paths]
        position = _track([Person(height=HEIGHT)] * len(paths), seen, network).points
        floats = [
            (_lower_ball(skeleton, one[: len(path.position)]) > sight.FLOATING)[path.position[:, 1] > STANDS * standing]
            for path, one in zip(paths, position, strict=True)
        ]
        share = float(np.concatenate(floats).mean())
        key = f"headset_{palms}_float_share"
        yield SightScore(f"real headsets, {_PALM_TITLES[palms]}", "float share", key, share, "of frames")
