"""A body from whatever arrives: the method follows the signal, and what is shown passes from one to the next.

Head alone, head and hands: the three-point network. Fingers that are measured are bent to it, extra trackers pull the
body. Gloves, and what a headset's cameras see, have estimators of their own. `docs/profiles.md` says which is when.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from bodysense.body.glove import glove_hands, side_of
from bodysense.body.hand import hand_skeleton
from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.estimators.carried import Carried
from bodysense.estimators.estimate import Estimator, PointEstimate
from bodysense.estimators.gloved import SIDES, Gloved
from bodysense.estimators.gloves.hands import GloveModels, Hands, load_glove_models
from bodysense.estimators.more_points import MorePoints, MoreState
from bodysense.estimators.passage import Passage, PassageSettings, begun, passed
from bodysense.estimators.profiles import (
    PROFILES,
    Arrivals,
    Profile,
    ProfileSettings,
    arrived,
    profile_of,
)
from bodysense.estimators.three_point import ThreePoint
from bodysense.estimators.three_point_answers import ThreePointModel, load_three_point
from bodysense.estimators.three_point_many import step_together
from bodysense.observation import Observation
from bodysense.occlusion.three_point import POINTS

__all__ = ["PROFILES", "Adaptive", "AdaptiveSettings", "AdaptiveState", "Profile", "step_many"]

Method = tuple[str, ...]  # what completes the body, and the hands that have gloves
_POINTS: Method = ("points",)
_CAMERAS: Method = ("cameras",)


@lru_cache(maxsize=1)
def shared_three_point() -> ThreePointModel:
    """The packaged network, loaded once: sessions that share it share a batch."""
    return load_three_point()


@lru_cache(maxsize=1)
def shared_gloves() -> GloveModels:
    """The packaged networks of gloves, loaded once."""
    return load_glove_models()


@dataclass(frozen=True)
class AdaptiveSettings:
    """How the method follows the signal."""

    profile: ProfileSettings = ProfileSettings()
    passage: PassageSettings = PassageSettings()
    longest_gap: float = 1.0  # s without frames after which everything starts afresh

    def __post_init__(self) -> None:
        if not self.longest_gap > 0:
            raise BodysenseError(f"adaptive settings: longest_gap is {self.longest_gap:g}; it must be positive")


@dataclass(frozen=True, eq=False)
class AdaptiveState:
    """Everything that the next frame depends on."""

    profile: Profile
    arrivals: Arrivals
    method: Method | None = None  # None before the first frame
    inner: Any = None  # the state of that method
    more: MoreState | None = None  # of trackers and fingers
    sources: bytes = b""  # which of those are there
    held: np.ndarray | None = None  # (3, 3) m: head and hands in the last frame, NaN where they were not measured
    turned: np.ndarray | None = None  # (3,) whether their rotations were
    shown: Pose | None = None  # of the last frame, without batch axes
    passage: Passage | None = None


@dataclass(frozen=True)
class Adaptive:
    """An estimator of a whole body whose profile follows what arrives; its estimates have a pose.

    `camera` completes what a headset's cameras see, with a pose of its own (`ik_tracker.IkTracked` around an estimator
    of positions); without it such points are taken for trackers. Raises BodysenseError for a skeleton that the
    three-point network does not know.
    """

    skeleton: Skeleton
    camera: Estimator | None = None
    model: ThreePointModel = field(default_factory=shared_three_point)
    settings: AdaptiveSettings = AdaptiveSettings()

    @cached_property
    def three_point(self) -> ThreePoint:
        """What completes a body from head and hands."""
        return ThreePoint(self.skeleton, self.model)

    @cached_property
    def _more(self) -> MorePoints:
        return MorePoints(self.skeleton)

    @cached_property
    def _gloved(self) -> dict[Method, Gloved]:
        return {}

    def start(self) -> AdaptiveState:
        """Nothing seen yet."""
        return AdaptiveState("head", Arrivals())

    def step(self, observation: Observation, state: AdaptiveState) -> tuple[PointEstimate, AdaptiveState]:
        """Complete T frames, one after the other. Raises BodysenseError when time does not increase."""
        frames: list[PointEstimate] = []
        for t in range(len(observation)):
            ((estimate, state),) = step_many([(self, observation[t : t + 1], state)])
            frames.append(estimate)
        if len(frames) == 1:
            return frames[0], state
        poses = [estimate.pose for estimate in frames if estimate.pose is not None]
        joined = PointEstimate(
            self.skeleton,
            np.concatenate([estimate.position for estimate in frames]),
            np.concatenate([estimate.occluded for estimate in frames]),
            np.concatenate([estimate.confidence for estimate in frames]),
            Pose(
                self.skeleton,
                np.concatenate([pose.root_position for pose in poses]),
                np.concatenate([pose.rotation for pose in poses]),
            ),
        )
        return joined, state

    def judged(self, observation: Observation, state: AdaptiveState) -> AdaptiveState:
        """The state in which a frame is completed: its profile and method, begun anew where they changed."""
        now = float(observation.time[0])
        before = state.arrivals.time
        if not now > (-np.inf if before is None else before) or now == np.inf:
            raise BodysenseError(
                f"adaptive body: a frame at {now:g} s"
                + (f" came after one at {before:g} s" if before is not None else "")
                + "; give frames in order of time, in seconds"
            )
        if before is not None and now - before > self.settings.longest_gap:
            state = self.start()
        arrivals = arrived(observation, state.arrivals, self.settings.profile)
        profile = profile_of(arrivals, self.settings.profile)
        method: Method = _POINTS
        if profile == "gloves":
            sides = (side for side in glove_hands(observation.points) if side in SIDES)
            method = ("gloves" if "head" in observation.points else "gloves alone", *sides)
        elif profile == "headset-camera":
            method, profile = (_CAMERAS, profile) if self.camera is not None else (method, "trackers")
        inner = state.inner if method == state.method else self.method(method).start()
        # Written out: `dataclasses.replace` takes several times as long, and this is done for every frame.
        return AdaptiveState(
            profile=profile,
            arrivals=arrivals,
            method=method,
            inner=inner,
            more=state.more,
            sources=state.sources,
            held=state.held,
            turned=state.turned,
            shown=state.shown,
            passage=state.passage,
        )

    def method(self, method: Method) -> Estimator:
        """The estimator of a method."""
        if method == _POINTS:
            return self.three_point
        if method == _CAMERAS:
            assert self.camera is not None
            return self.camera
        if method not in self._gloved:
            hands = {side: hand_skeleton(self.skeleton, side_of(side)) for side in method[1:]}
            body = self.three_point if method[0] == "gloves" else Carried(self.skeleton)
            self._gloved[method] = Gloved(Hands(hands, shared_gloves()), body)
        return self._gloved[method]

    def finished(
        self,
        observation: Observation,
        estimate: PointEstimate,
        before: AdaptiveState,
        judged: AdaptiveState,
        inner: Any,
    ) -> tuple[PointEstimate, AdaptiveState]:
        """What is shown of a method's estimate, one frame, and the state after it."""
        assert estimate.pose is not None
        more, sources, now = None, b"", judged.arrivals.time
        if judged.profile in ("hands", "trackers"):
            trackers, holds = judged.profile == "trackers", self.settings.profile.holds
            more = judged.more or self._more.start()
            estimate, more, sources = self._more.add(observation, estimate, trackers, holds, more)
        assert estimate.pose is not None and now is not None
        pose, (held, turned), passage = estimate.pose[0], _held(observation), judged.passage
        if judged.shown is not None and before.arrivals.time is not None:
            if (judged.method, sources) != (before.method, before.sources):
                assert judged.held is not None and judged.turned is not None
                moved = held - judged.held
                moved[0] = np.nan_to_num(moved[0])
                moved = np.where(np.isnan(moved), moved[0], moved)  # a hand that is not measured goes with the head
                both = turned & judged.turned
                passage = begun(self.three_point.body, judged.shown, pose, moved, both, self.settings.passage)
            if passage is not None:
                interval = now - before.arrivals.time
                pose, position, passage = passed(self.three_point.body, pose, interval, self.settings.passage, passage)
                shown = Pose(self.skeleton, pose.root_position[None], pose.rotation[None])
                estimate = replace(estimate, position=position[None], pose=shown)
        if sources or passage is not None:  # hands are where they are measured, also where an arm is too short
            place = estimate.position[0].copy()
            for points, hand in zip(self.three_point.body.hands, held[1:], strict=True):
                place[points] += np.nan_to_num(hand - place[points[0]])
            estimate = replace(estimate, position=place[None])
        return estimate, AdaptiveState(
            profile=judged.profile,
            arrivals=judged.arrivals,
            method=judged.method,
            inner=inner,
            more=more,
            sources=sources,
            held=held,
            turned=turned,
            shown=pose,
            passage=passage,
        )


def step_many(jobs: Sequence[tuple[Adaptive, Observation, AdaptiveState]]) -> list[tuple[PointEstimate, AdaptiveState]]:
    """Complete one frame of each of many: what each one's own `step` gives; those of head and hands share a batch."""
    judged = [one.judged(observation, state) for one, observation, state in jobs]
    points = [k for k, state in enumerate(judged) if state.method == _POINTS]
    together = step_together([(jobs[k][0].three_point, jobs[k][1], judged[k].inner) for k in points])
    answers: dict[int, tuple[PointEstimate, Any]] = dict(zip(points, together, strict=True))
    for k, (one, observation, _) in enumerate(jobs):
        if k not in answers:
            answers[k] = one.method(judged[k].method or _POINTS).step(observation, judged[k].inner)
    return [
        one.finished(observation, answers[k][0], before, judged[k], answers[k][1])
        for k, (one, observation, before) in enumerate(jobs)
    ]


def _held(observation: Observation) -> tuple[np.ndarray, np.ndarray]:
    """Where head and hands (3, 3) are measured, NaN where not, and whether their rotations (3,) are."""
    if observation.points == POINTS:
        known = observation.has_position[0, :, None]
        return np.where(known, observation.position[0], np.nan), observation.has_rotation[0]
    held, turned = np.full((3, 3), np.nan), np.zeros(3, dtype=bool)
    for row, name in enumerate(POINTS):
        if name in observation.points:
            k = observation.points.index(name)
            if observation.has_position[0, k]:
                held[row] = observation.position[0, k]
            turned[row] = observation.has_rotation[0, k]
    return held, turned
