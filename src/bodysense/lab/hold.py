"""The baseline without a network: a hidden point stays where it was."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.rotation import heading, quaternion_conjugate, quaternion_rotate
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.observation import Observation, observed_points


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
        frames = []
        for t in range(len(observation)):
            if has_position[t, self._head]:
                state = replace(state, head_position=position[t, self._head])
            if has_rotation[t, self._head]:
                state = replace(state, head_heading=heading(rotation[t, self._head]))
            state = self._remember(position[t], has_position[t] & has_position[t, self._origin], state)
            guess = self._recall(state)
            now = np.where(has_position[t][:, None], position[t], guess)
            # Fingers hang on the wrist that is shown, measured or kept.
            frames.append(np.where(self._is_finger & ~has_position[t][:, None], guess + now[self._origin], now))
        estimate = PointEstimate(
            skeleton=self.skeleton,
            position=np.stack(frames),
            occluded=(~has_position).astype(float),
            confidence=np.where(has_position, 0.0, 0.1),
        )
        return estimate, state

    def _remember(self, position: np.ndarray, measured: np.ndarray, state: HoldState) -> HoldState:
        """Take in the measured points of one frame."""
        if self.frame == "world":
            place = np.where(self._is_finger, position - position[self._origin], position)
        else:
            base = np.where(self._is_finger, position[self._origin], state.head_position)
            place = quaternion_rotate(quaternion_conjugate(self._turn(state)), position - base)
        return replace(state, place=np.where(measured[:, None], place, state.place), seen=state.seen | measured)

    def _recall(self, state: HoldState) -> np.ndarray:
        """(P, 3) m: world positions of body points, world offsets from the wrist of fingers."""
        head = np.where(self._is_finger, 0.0, state.head_position)
        standing = quaternion_rotate(state.head_heading, self._standing) + head
        kept = state.place if self.frame == "world" else quaternion_rotate(self._turn(state), state.place) + head
        return np.where(state.seen[:, None], kept, standing)

    def _turn(self, state: HoldState) -> np.ndarray:
        """(4,) world ← the axes in which places are kept."""
        return state.head_heading if self.frame == "heading" else np.array([1.0, 0.0, 0.0, 0.0])
