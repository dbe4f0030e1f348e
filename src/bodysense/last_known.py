"""Last known places: the baseline without a network, in which a hidden point stays where it was."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.rotation import heading, quaternion_conjugate, quaternion_rotate
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.observation import Observation, observed_points

KNOWN: tuple[Literal["world", "head", "heading"], ...] = ("world", "head", "heading")  # frames in which points stay


@dataclass(frozen=True)
class HoldState:
    """The last known place of every point, in the frame in which it is kept."""

    place: np.ndarray  # (P, 3) m
    seen: np.ndarray  # (P,) bool, whether ever
    head_position: np.ndarray  # (3,) m, world
    head_heading: np.ndarray  # (4,) wxyz


@dataclass(frozen=True)
class Hold:
    """Last known position.

    Kept in the world, with the head in the world's axes ('head', as in UNOC), or turning with the head's heading.

    Fingers are kept relative to their wrist, in the same axes. A point that was never seen is where a standing body
    under the head has it.
    """

    skeleton: Skeleton
    frame: Literal["world", "head", "heading"] = "heading"

    @cached_property
    def _origin(self) -> np.ndarray:
        """(P,) the point that each one is kept relative to: the wrist for fingers, itself where none."""
        wrist = self.skeleton.wrist_of
        return np.where(wrist >= 0, wrist, np.arange(len(wrist)))

    @cached_property
    def _standing(self) -> np.ndarray:
        """(P, 3) where points stand relative to the head, fingers relative to their wrist."""
        position, _ = forward_kinematics(standing_pose(self.skeleton))
        return np.where(self._is_finger, position - position[self._origin], position - position[self._head])

    @cached_property
    def _is_finger(self) -> np.ndarray:
        return (self.skeleton.wrist_of >= 0)[:, None]

    @cached_property
    def _head(self) -> int:
        return self.skeleton.index("head")

    def start(self) -> HoldState:
        """Nothing seen yet: a standing body that faces +Z."""
        count = len(self.skeleton.points)
        standing, _ = forward_kinematics(standing_pose(self.skeleton))
        return HoldState(
            place=np.zeros((count, 3)),
            seen=np.zeros(count, dtype=bool),
            head_position=standing[self._head],
            head_heading=np.array([1.0, 0.0, 0.0, 0.0]),
        )

    def step(self, observation: Observation, state: HoldState) -> tuple[PointEstimate, HoldState]:
        """Complete T frames, one after the other."""
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
        # Fingers hang on the wrist that is output, measured or kept.
        hanging = self._is_finger & ~has_position[..., None]
        estimate = PointEstimate(
            skeleton=self.skeleton,
            position=np.where(hanging, guess + now[:, self._origin], now),
            occluded=(~has_position).astype(float),
            confidence=np.where(has_position, 0.0, 0.1),
        )
        return estimate, HoldState(place[-1], seen[-1], head[-1], turn[-1])


def _hold_values(values: np.ndarray, known: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Return values (T, …, D) in which those that are not known (T, …) are the last known ones, before them `first`."""
    frame = np.arange(len(values)).reshape(-1, *[1] * (known.ndim - 1))
    last = np.maximum.accumulate(np.where(known, frame, -1))[..., None]
    return np.where(last >= 0, np.take_along_axis(values, np.maximum(last, 0), axis=0), first)


def last_known(observation: Observation, skeleton: Skeleton) -> dict[str, np.ndarray]:
    """The baselines: the frame of `KNOWN` in which hidden points stay → (T, P, 3) m, world."""
    holds = {frame: Hold(skeleton, frame) for frame in KNOWN}
    return {frame: hold.step(observation, hold.start())[0].position for frame, hold in holds.items()}
