"""An assumed head for hands that are tracked alone: the person is assumed to stand behind their hands.

Hands alone say little about the body. It is assumed to stand upright, to face where the hands point, perpendicular to
the line between them, with both within reach. The head's accuracy marks it as a guess.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.rotation import quaternion_rotate
from bodysense.body.skeleton import Skeleton

ACCURACY = 0.3  # m
_ARM = ("shoulder", "elbow", "wrist")
_FINGERS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])  # direction of fingers at rest, left and right
_HALF_LIFE = 0.7  # s in which half of the change of heading or position is made
_AHEAD = 0.2  # of the body's height: distance of the hands in front of it
_BESIDE = 0.9  # share of that distance by which hanging hands are closer
_REACH = 0.97  # of an arm's length: largest distance of hands from their shoulder
_ACROSS = 0.7  # weight of the line between both hands for the heading; the fingers have 1
_LONGEST_GAP = 1.0  # s without hands after which everything is reset


@dataclass(frozen=True, eq=False)
class StandingHeadState:
    """Position of the body; None until a hand was seen."""

    time: float | None = None
    heading: np.ndarray | None = None  # (2,) unit, x and z of its direction
    place: np.ndarray | None = None  # (3,) m, of the head


@dataclass(frozen=True, eq=False)
class StandingHead:
    """Guesses the head of a `skeleton` from the wrists of one hand or both."""

    skeleton: Skeleton

    @cached_property
    def _standing(self) -> tuple[float, np.ndarray, np.ndarray]:
        """A standing body that faces +Z: height of the head, shoulders (2, 3) from it, lengths of arms (2,), m."""
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
            wrist: (2, 3) m, left and right.
            turn: (2, 4) wxyz, world ← wrist.
            known: (2,) which hands are observed.
            now: s.
            state: after the frame before.
        """
        if state.time is not None and now - state.time > _LONGEST_GAP:
            state = StandingHeadState()
        interval = np.inf if state.time is None else now - state.time
        share = 1 - 0.5 ** (interval / _HALF_LIFE)
        heading = self._heading(wrist, turn, known, share, state.heading)
        yaw = _yaw(heading)
        height, shoulders, length = self._standing
        shoulders = quaternion_rotate(np.tile(yaw, (2, 1)), shoulders)
        middle = wrist[known].mean(axis=0)
        # Hanging hands are at the body's sides.
        hanging = np.clip((height + shoulders[:, 1].mean() - middle[1]) / length.mean(), 0.0, 1.0)
        ahead = _AHEAD * self.skeleton.height * (1 - _BESIDE * hanging**2)
        wanted = np.array([middle[0] - ahead * heading[0], height, middle[2] - ahead * heading[1]])
        place = wanted if state.place is None else state.place + share * (wanted - state.place)
        place = self._within_reach(place, shoulders, length, wrist, known)
        return place, yaw, replace(state, time=now, heading=heading, place=place)

    def _heading(
        self, wrist: np.ndarray, turn: np.ndarray, known: np.ndarray, share: float, before: np.ndarray | None
    ) -> np.ndarray:
        """Return the body's heading (2,)."""
        wanted = quaternion_rotate(turn[known], _FINGERS[known])[:, [0, 2]].sum(axis=0)
        if known.all():
            across = (wrist[0] - wrist[1])[[0, 2]]
            wanted = wanted + _ACROSS * np.array([-across[1], across[0]]) / max(np.hypot(*across), 0.1)
        length = np.hypot(*wanted)
        if length < 0.1:
            return np.array([0.0, 1.0]) if before is None else before
        now = wanted / length
        mixed = now if before is None else before + share * (now - before)
        length = np.hypot(*mixed)
        return mixed / length if length > 1e-3 else now

    def _within_reach(
        self, place: np.ndarray, shoulders: np.ndarray, length: np.ndarray, wrist: np.ndarray, known: np.ndarray
    ) -> np.ndarray:
        """Return the closest position of the head with the hands within reach, as far as possible."""
        for _ in range(20):
            away = wrist - place - shoulders
            distance = np.linalg.norm(away, axis=1)
            excess = np.where(known, np.maximum(distance - _REACH * length, 0.0), 0.0)
            if excess.max() < 1e-5:
                break
            place = place + (away * (excess / np.maximum(distance, 1e-9))[:, None])[excess.argmax()]
        return place


def _yaw(heading: np.ndarray) -> np.ndarray:
    """Return the rotation (4,) about +Y from +Z to a heading (2,)."""
    half = np.arctan2(heading[0], heading[1]) / 2
    return np.array([np.cos(half), 0.0, np.sin(half), 0.0])
