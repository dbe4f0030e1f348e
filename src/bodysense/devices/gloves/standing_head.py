"""Assumed head of a wearer with tracked hands only.

The body is assumed to stand upright behind its hands, with both within reach. It faces where the hands point and at
right angles to the line between them. The head's accuracy marks it as a guess.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import quaternion_exp, quaternion_rotate

ACCURACY = 0.3  # m
_ARM = ("shoulder", "elbow", "wrist")
_FINGERS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])  # direction of fingers at rest, left and right
_HALF_LIFE = 0.7  # s, half-life of a change of heading or position
_AHEAD = 0.2  # distance of the hands in front of the body, as a share of its height
_HANGING = 0.9  # share of that distance by which hanging hands are closer
_REACH = 0.97  # largest distance of a hand from its shoulder, as a share of the arm's length
_ACROSS = 0.7  # weight of the line between both hands for the heading; the fingers have 1
_LONGEST_GAP = 1.0  # s without hands after which everything is reset


@dataclass(frozen=True, eq=False)
class StandingHeadState:
    """Heading and head of the assumed body; None until a hand was seen."""

    time: float | None = None
    heading: np.ndarray | None = None  # (2,) unit, x and z of the direction that the body faces
    position: np.ndarray | None = None  # (3,) m, of the head


@dataclass(frozen=True, eq=False)
class StandingHead:
    """Guess of the head of a `skeleton` from one wrist or both."""

    skeleton: Skeleton

    @cached_property
    def _standing(self) -> tuple[float, np.ndarray, np.ndarray]:
        """For a standing body that faces +Z: the head's height, shoulders (2, 3) from the head, arm lengths (2,), m."""
        points = np.asarray(forward_kinematics(standing_pose(self.skeleton))[0])
        chains = [self.skeleton.indices([f"{side}_{part}" for side in ("left", "right")]) for part in _ARM]
        shoulder, elbow, wrist = (points[chain] for chain in chains)
        length = np.linalg.norm(elbow - shoulder, axis=1) + np.linalg.norm(wrist - elbow, axis=1)
        head = points[self.skeleton.index("head")]
        return float(head[1]), shoulder - head, length

    def follow(
        self, wrist: np.ndarray, turn: np.ndarray, known: np.ndarray, now: float, state: StandingHeadState
    ) -> tuple[np.ndarray, np.ndarray, StandingHeadState]:
        """Return position (3,) m and rotation (4,) of the head in a frame with a hand, and the state after it.

        Args:
            wrist: (2, 3) m, positions of left and right wrist.
            turn: (2, 4) wxyz, world ← wrist.
            known: (2,) bool: the hand is observed.
            now: time of the frame, s.
            state: after the frame before.
        """
        if state.time is not None and now - state.time > _LONGEST_GAP:
            state = StandingHeadState()
        interval = np.inf if state.time is None else now - state.time
        share = 1 - 0.5 ** (interval / _HALF_LIFE)
        heading = self._heading(wrist, turn, known, share, state.heading)
        yaw = quaternion_exp(np.array([0.0, np.arctan2(heading[0], heading[1]), 0.0]))
        height, shoulders, length = self._standing
        shoulders = quaternion_rotate(np.tile(yaw, (2, 1)), shoulders)
        middle = wrist[known].mean(axis=0)
        # Hanging hands are at the body's sides.
        hanging = np.clip((height + shoulders[:, 1].mean() - middle[1]) / length.mean(), 0.0, 1.0)
        ahead = _AHEAD * self.skeleton.extent * (1 - _HANGING * hanging**2)
        target = np.array([middle[0] - ahead * heading[0], height, middle[2] - ahead * heading[1]])
        position = target if state.position is None else state.position + share * (target - state.position)
        position = self._within_reach(position, shoulders, length, wrist, known)
        return position, yaw, replace(state, time=now, heading=heading, position=position)

    def _heading(
        self, wrist: np.ndarray, turn: np.ndarray, known: np.ndarray, share: float, before: np.ndarray | None
    ) -> np.ndarray:
        """Return the body's heading (2,)."""
        target = quaternion_rotate(turn[known], _FINGERS[known])[:, [0, 2]].sum(axis=0)
        if known.all():
            across = (wrist[0] - wrist[1])[[0, 2]]
            target = target + _ACROSS * np.array([-across[1], across[0]]) / max(np.hypot(*across), 0.1)
        length = np.hypot(*target)
        if length < 0.1:
            return np.array([0.0, 1.0]) if before is None else before
        now = target / length
        mixed = now if before is None else before + share * (now - before)
        length = np.hypot(*mixed)
        return mixed / length if length > 1e-3 else now

    def _within_reach(
        self, position: np.ndarray, shoulders: np.ndarray, length: np.ndarray, wrist: np.ndarray, known: np.ndarray
    ) -> np.ndarray:
        """Return the closest position of the head from which the hands are within reach, as far as possible."""
        for _ in range(20):
            away = wrist - position - shoulders
            distance = np.linalg.norm(away, axis=1)
            excess = np.where(known, np.maximum(distance - _REACH * length, 0.0), 0.0)
            if excess.max() < 1e-5:
                break
            position = position + (away * (excess / np.maximum(distance, 1e-9))[:, None])[excess.argmax()]
        return position
