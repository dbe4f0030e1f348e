"""What is measured beside head and hands, put on a body that was completed without it: trackers pull, fingers bend.

A tracker or a hand's fingers that are lost for a moment stay where they were, from the head and in the hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.measured_fingers import MeasuredFingers
from bodysense.estimators.pulled import TRACKER_ERROR, Pulled
from bodysense.observation import Observation
from bodysense.occlusion.three_point import POINTS

FINGER_ERROR = 0.008  # m: of a finger that is laid along its measured bones, with the wearer's lengths
FARTHEST = 1.2  # of the wearer's height, from the head: no tracker that is worn is farther
_NEVER = -np.inf


@dataclass(frozen=True, eq=False)
class MoreState:
    """Where trackers and fingers were last."""

    offset: np.ndarray  # (P, 3) m, of trackers from the head
    worn: np.ndarray  # (P,) s, when
    fingers: np.ndarray | None  # (30, 4) local rotations
    bent: np.ndarray  # (2,) s, when the fingers of either hand were there


@dataclass(frozen=True)
class MorePoints:
    """Adds measured points to bodies of one skeleton."""

    skeleton: Skeleton

    @cached_property
    def _fingers(self) -> MeasuredFingers:
        return MeasuredFingers(self.skeleton)

    @cached_property
    def _pulled(self) -> Pulled:
        return Pulled(self.skeleton)

    @cached_property
    def _held(self) -> np.ndarray:
        return self.skeleton.indices(POINTS)

    @cached_property
    def _wearable(self) -> np.ndarray:
        """(P,) the joints of the body but head and hands."""
        names = [name for name in BODY if name not in POINTS]
        return np.isin(np.arange(len(self.skeleton.points)), self.skeleton.indices(names))

    def start(self) -> MoreState:
        """Nothing seen yet."""
        count = len(self.skeleton.points)
        return MoreState(np.zeros((count, 3)), np.full(count, _NEVER), None, np.full(2, _NEVER))

    def add(
        self, observation: Observation, estimate: PointEstimate, trackers: bool, holds: float, state: MoreState
    ) -> tuple[PointEstimate, MoreState, bytes]:
        """An estimate, of one frame, with what else was observed; which trackers and fingers that were, as a key.

        Args:
            observation: One frame.
            estimate: With a pose, one frame.
            trackers: Whether they pull; fingers bend in any case.
            holds: s for which what is lost stays.
            state: Of the frame before.
        """
        assert estimate.pose is not None
        now, known = float(observation.time[0]), np.zeros(len(self.skeleton.points), dtype=bool)
        here, there = _places(observation.points, self.skeleton.points)
        known[there] = observation.has_position[0, here]
        place = np.full((len(known), 3), np.nan)
        place[there] = observation.position[0, here]
        turned = [k for k, name in enumerate(observation.points) if observation.has_rotation[0, k] and name in POINTS]
        steady = np.isin(POINTS[1:], [observation.points[k] for k in turned])

        pose, position = estimate.pose[0], estimate.position[0]
        error, hidden = estimate.confidence[0].copy(), estimate.occluded[0].copy()
        measured = np.zeros(len(known), dtype=bool)
        measured[self._held] = hidden[self._held] < 0.5

        head = position[self._held[0]]
        away = place - head
        near = np.einsum("ij,ij->i", away, away) <= (FARTHEST * self.skeleton.height) ** 2  # false for what is hidden
        seen = known & self._wearable & near
        offset = np.where(seen[:, None], away, state.offset)
        worn = np.where(seen, now, state.worn)
        pulls = (now - worn <= holds) & trackers
        if pulls.any():
            pose, position = self._pulled.pull(pose, position, error, measured, pulls, head + offset)
            error[pulls], hidden[pulls & seen] = TRACKER_ERROR, 0.0

        shown = self._fingers.hands_known(known) & steady
        bent, fingers = np.where(shown, now, state.bent), state.fingers
        bends = now - bent <= holds
        if bends.any():
            pose, position, fingers = self._bent(pose, position, place, known, shown, bends, fingers)
            points = self._fingers.points[np.repeat(bends, 5)]
            error[points], hidden[points] = FINGER_ERROR, ~known[points]
        added = PointEstimate(
            self.skeleton,
            position[None],
            hidden[None],
            error[None],
            Pose(self.skeleton, pose.root_position[None], pose.rotation[None]),
        )
        there = np.concatenate([pulls, bends])
        return added, MoreState(offset, worn, fingers, bent), there.tobytes() if there.any() else b""

    def _bent(
        self,
        pose: Pose,
        position: np.ndarray,
        place: np.ndarray,
        known: np.ndarray,
        shown: np.ndarray,
        bends: np.ndarray,
        before: np.ndarray | None,
    ) -> tuple[Pose, np.ndarray, np.ndarray]:
        """Pose and points with the fingers of the hands (2,) that bend, from those that are shown now; the fingers."""
        chains = self._fingers
        _, world = forward_kinematics(pose)
        last = np.asarray(pose.rotation)[chains.joints] if before is None else before
        known = known.copy()
        known[chains.points[~np.repeat(shown, 5)]] = False
        local = chains.bent(place, known, np.asarray(world)[chains.wrists], last)
        rotation = np.array(pose.rotation)
        which = np.repeat(bends, 15)
        rotation[chains.joints[which]] = local[which]
        rotation *= np.copysign(1.0, rotation[:, :1])
        pose = Pose(self.skeleton, pose.root_position, rotation)
        placed, position = np.asarray(forward_kinematics(pose)[0]), position.copy()
        for points, wrist in zip(chains.points, chains.wrists, strict=True):
            position[points] = placed[points] + (position[wrist] - placed[wrist])
        return pose, position, local


@lru_cache(maxsize=64)
def _places(points: tuple[str, ...], ours: tuple[str, ...]) -> tuple[list[int], list[int]]:
    """Which points of an observation are points of a skeleton, and which of its they are."""
    here = [k for k, name in enumerate(points) if name in ours]
    return here, [ours.index(points[k]) for k in here]
