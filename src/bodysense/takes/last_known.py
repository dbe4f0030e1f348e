"""Last known positions: the baseline without a network, in which hidden points keep their last measured position."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.geometry.rotation import heading, quaternion_conjugate, quaternion_rotate
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points

KNOWN: tuple[Literal["world", "head", "heading"], ...] = ("world", "head", "heading")  # frames in which points are held


@dataclass(frozen=True)
class HoldState:
    """Last known positions, in the frame in which they are held."""

    place: np.ndarray  # (P, 3) m
    seen: np.ndarray  # (P,) bool: seen in any frame so far
    head_position: np.ndarray  # (3,) m, world
    head_heading: np.ndarray  # (4,) wxyz


@dataclass(frozen=True)
class Hold:
    """Baseline that holds hidden points at their last known position.

    Positions are held in the world ('world'), relative to the head in the world's axes ('head', as in UNOC), or
    relative to the head in the axes of its heading ('heading'). Fingers are held relative to their wrist, in the same
    axes. Points that were never seen have their position in a standing body under the head.
    """

    skeleton: Skeleton
    frame: Literal["world", "head", "heading"] = "heading"

    @cached_property
    def _origin(self) -> np.ndarray:
        """(P,) index of the point relative to which each one is held: the wrist for fingers, else itself."""
        wrist = self.skeleton.wrist_of
        return np.where(wrist >= 0, wrist, np.arange(len(wrist)))

    @cached_property
    def _standing(self) -> np.ndarray:
        """(P, 3) m, positions of a standing body relative to the head, of fingers relative to their wrist."""
        position, _ = forward_kinematics(standing_pose(self.skeleton))
        return np.where(self._is_finger, position - position[self._origin], position - position[self._head])

    @cached_property
    def _is_finger(self) -> np.ndarray:
        return (self.skeleton.wrist_of >= 0)[:, None]

    @cached_property
    def _head(self) -> int:
        return self.skeleton.index("head")

    def start(self) -> HoldState:
        """Return the state before the first frame: a standing body that faces +Z."""
        count = len(self.skeleton.points)
        standing, _ = forward_kinematics(standing_pose(self.skeleton))
        return HoldState(
            place=np.zeros((count, 3)),
            seen=np.zeros(count, dtype=bool),
            head_position=standing[self._head],
            head_heading=np.array([1.0, 0.0, 0.0, 0.0]),
        )

    def step(self, observation: Observation, state: HoldState) -> tuple[PointEstimate, HoldState]:
        """Complete the next T frames."""
        position, rotation, has_position, has_rotation = observed_points(observation, self.skeleton)
        turned = np.where(has_rotation[:, self._head, None], rotation[:, self._head], [1.0, 0.0, 0.0, 0.0])
        head = _hold_values(position[:, self._head], has_position[:, self._head], state.head_position)
        turn = _hold_values(np.asarray(heading(turned)), has_rotation[:, self._head], state.head_heading)
        axes = turn[:, None] if self.frame == "heading" else np.array([1.0, 0.0, 0.0, 0.0])
        middle = np.where(self._is_finger, 0.0, head[:, None])  # of points that are kept with the head
        origin = np.zeros(3) if self.frame == "world" else middle
        base = np.where(self._is_finger, position[:, self._origin], origin)
        measured = has_position & has_position[:, self._origin]
        place = _hold_values(quaternion_rotate(quaternion_conjugate(axes), position - base), measured, state.place)
        seen = np.logical_or.accumulate(np.concatenate([state.seen[None], measured]))[1:]
        standing = quaternion_rotate(turn[:, None], self._standing) + middle
        guess = np.where(seen[..., None], quaternion_rotate(axes, place) + origin, standing)
        now = np.where(has_position[..., None], position, guess)
        # Fingers are relative to the wrist of the output, whether it is measured or held.
        hanging = self._is_finger & ~has_position[..., None]
        estimate = PointEstimate(
            skeleton=self.skeleton,
            position=np.where(hanging, guess + now[:, self._origin], now),
            occluded=(~has_position).astype(float),
            confidence=np.where(has_position, 0.0, 0.1),
        )
        return estimate, HoldState(place[-1], seen[-1], head[-1], turn[-1])


def _hold_values(values: np.ndarray, known: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Replace values (T, …, D) that are not known (T, …) by the last known ones, or by `first` before these."""
    frame = np.arange(len(values)).reshape(-1, *[1] * (known.ndim - 1))
    last = np.maximum.accumulate(np.where(known, frame, -1))[..., None]
    return np.where(last >= 0, np.take_along_axis(values, np.maximum(last, 0), axis=0), first)


def last_known(observation: Observation, skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Return the baselines (T, P, 3) m, world, by the frame of `KNOWN` in which hidden points are held."""
    holds = {frame: Hold(skeleton, frame) for frame in KNOWN}
    return {frame: hold.step(observation, hold.start())[0].position for frame, hold in holds.items()}
