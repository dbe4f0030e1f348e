"""The headset table: what cameras on a head do not see, completed by the tracker that users run (papers.md 1.10)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import TESTED, Skeleton
from bodysense.data.clip import Clip
from bodysense.data.resample import resample
from bodysense.lab.metrics import joint_error
from bodysense.lab.spread import spread
from bodysense.lab.unoc.hold import Hold
from bodysense.lab.unoc.ik_tracker import IkTracker, IkTrackerSettings
from bodysense.lab.unoc.learned import Learned, load_model
from bodysense.observation import Observation
from bodysense.occlusion.headset_camera import HeadsetCamera, observe

RATE = 30.0
KNOWN: tuple[Literal["world", "head", "heading"], ...] = (
    "world",
    "head",
    "heading",
)  # frames of the last-known baselines
MAIN = ("sit", "talk_gesture", "conversation", "everyday", "locomotion")  # what a headset's wearer does
GROUPS = ("main", "sport", "dance", "other")  # the categories that are scored together


@dataclass
class Tally:
    """Running sums of errors (cm), so that averages are over frames, not over clips."""

    count: float = 0.0
    total: float = 0.0
    squared: float = 0.0

    def add(self, error: np.ndarray) -> None:
        """Count errors of any shape."""
        self.count += error.size
        self.total += float(error.sum())
        self.squared += float((error * error).sum())

    def merge(self, other: Tally) -> None:
        """Count what another has counted."""
        self.count += other.count
        self.total += other.total
        self.squared += other.squared

    @property
    def mpjpe(self) -> float:
        """Mean, cm."""
        return self.total / self.count if self.count else math.nan

    @property
    def rmsjpe(self) -> float:
        """Root of the mean square, cm."""
        return math.sqrt(self.squared / self.count) if self.count else math.nan


Tallies = dict[tuple[str, str, str, str], Tally]  # by category group, part, share of joints, method


@dataclass(frozen=True)
class HeadsetTable:
    """Errors of every method by category group, part of the body, and occluded or all joints."""

    tallies: Tallies = field(repr=False)
    clips: int
    seconds: float

    def numbers(self) -> dict[str, float]:
        """One flat object; keys without a suffix are over the main categories."""
        result: dict[str, float] = {"clips": self.clips, "seconds": round(self.seconds, 1)}
        for group in GROUPS:
            suffix = "" if group == "main" else f"_{group}"
            for part in ("body", "finger", "body_and_finger", "every_point"):
                for share in ("occluded", "known", "all"):
                    ours = self.get(group, part, share, "bodysense")
                    if not ours.count:
                        continue
                    network = self.get(group, part, share, "network")
                    known = [self.get(group, part, share, frame) for frame in KNOWN]
                    for measure in ("rmsjpe", "mpjpe"):
                        value, base = getattr(ours, measure), min(getattr(tally, measure) for tally in known)
                        key = f"{part}_{share}_{measure}"
                        result[f"{key}_cm{suffix}"] = value
                        result[f"baseline_{key}_cm{suffix}"] = base
                        result[f"network_{key}_cm{suffix}"] = getattr(network, measure)
                        result[f"{key}_ratio{suffix}"] = value / base if base else math.nan
        return result

    def get(self, group: str, part: str, share: str, method: str) -> Tally:
        """One cell; empty where nothing was counted."""
        return self.tallies.get((group, part, share, method), Tally())


def evaluate_headset(
    clips: Iterable[Clip],
    model: Path | None,
    settings: IkTrackerSettings,
    jobs: int,
    advance: Callable[[Clip], None],
) -> HeadsetTable:
    """Score the tracker on canonical clips, in `jobs` processes. `advance` is told of every clip that is done."""
    tallies: Tallies = {}
    count, seconds = 0, 0.0
    for clip, one in spread(partial(score_clip, model=model, settings=settings), clips, jobs):
        for key, tally in one.items():
            tallies.setdefault(key, Tally()).merge(tally)
        count, seconds = count + 1, seconds + clip.seconds
        advance(clip)
    return HeadsetTable(tallies, count, seconds)


@dataclass(frozen=True, eq=False)
class Tracked:
    """A clip, what the headset saw of it, and what every method made of that."""

    clip: Clip  # the truth, at 30 Hz
    observation: Observation
    pose: Pose  # of the tracker
    position: dict[str, np.ndarray]  # method → (T, P, 3) m
    latency: np.ndarray  # (T,) s, the tracker's whole step


def track_clip(clip: Clip, model: Path | None, settings: IkTrackerSettings) -> Tracked:
    """Run the tracker, frame by frame, and the baselines on what a headset sees of a canonical clip."""
    clip = resample(clip, RATE)
    skeleton = clip.pose.skeleton
    observation = observe(clip.pose, clip.time, HeadsetCamera())
    tracker = IkTracker(Learned(load_model(model), skeleton), settings)
    state, poses, positions, latency = tracker.start(), [], [], np.zeros(len(clip))
    for frame in range(len(clip)):
        seen = observation[frame : frame + 1]
        begun = time.perf_counter()
        pose, estimate, state = tracker.step(seen, state)
        latency[frame] = time.perf_counter() - begun
        poses.append(pose)
        positions.append(estimate.position)
    pose = Pose(skeleton, np.concatenate([p.root_position for p in poses]), np.concatenate([p.rotation for p in poses]))
    position = {"bodysense": np.asarray(forward_kinematics(pose)[0]), "network": np.concatenate(positions)}
    return Tracked(clip, observation, pose, position | last_known(observation, skeleton), latency)


def last_known(observation: Observation, skeleton: Skeleton) -> dict[str, np.ndarray]:
    """The baselines: the frame of `KNOWN` in which hidden points stay → (T, P, 3) m, world."""
    holds = {frame: Hold(skeleton, frame) for frame in KNOWN}
    return {frame: hold.step(observation, hold.start())[0].position for frame, hold in holds.items()}


def score_clip(clip: Clip, model: Path | None, settings: IkTrackerSettings) -> Tallies:
    """Errors of every method on one clip."""
    return score(track_clip(clip, model, settings))


def score(tracked: Tracked) -> Tallies:
    """Errors of every method, by part of the body and share of the joints."""
    clip, skeleton = tracked.clip, tracked.clip.pose.skeleton
    truth = np.asarray(forward_kinematics(clip.pose)[0])
    hidden = ~tracked.observation.has_position
    # Hidden now but seen earlier in the clip: where a last known position exists at all.
    known = hidden & (np.cumsum(~hidden, axis=0) > 0)
    tallies: Tallies = {}
    for method, position in tracked.position.items():
        for part, (values, chosen) in part_errors(position, truth, skeleton, clip.has_fingers).items():
            shares = {"occluded": hidden[:, chosen], "known": known[:, chosen], "all": np.full(values.shape, True)}
            for share, mask in shares.items():
                tallies.setdefault((group_of(clip), part, share, method), Tally()).add(values[mask])
    return tallies


def part_errors(
    position: np.ndarray, truth: np.ndarray, skeleton: Skeleton, fingers: bool
) -> dict[str, tuple[np.ndarray, list[int]]]:
    """Errors (T, N), cm, of every part of the body, and which N points it has: positions (T, P, 3) m in one frame.

    Fingers are measured from their wrist, but where they count together with the body; where there are none they and
    what has them are left out.
    """
    finger, tested = np.flatnonzero(skeleton.wrist_of >= 0).tolist(), scored_points(skeleton)
    wrist = skeleton.wrist_of[finger]
    every = [p for p, name in enumerate(skeleton.points) if p not in finger and name != "head"]
    error = joint_error(position, truth)
    parts = {"body": (error[:, tested], tested), "every_point": (error[:, every], every)}
    if fingers:
        local = joint_error(position[:, finger] - position[:, wrist], truth[:, finger] - truth[:, wrist])
        both = tested + finger
        parts |= {"finger": (local, finger), "body_and_finger": (error[:, both], both)}
    return parts


def scored_points(skeleton: Skeleton) -> list[int]:
    """The points that UNOC's tables test, of either side."""
    return [p for p, name in enumerate(skeleton.points) if name.partition("_")[2] in TESTED]


def group_of(clip: Clip) -> str:
    """The one of `GROUPS` with which a clip is scored."""
    return group_named(clip.category)


def group_named(category: str) -> str:
    """The one of `GROUPS` with which clips of a category are scored."""
    return "main" if category in (*MAIN, "") else category if category in GROUPS else "other"
