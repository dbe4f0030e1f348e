"""Tracker: estimator → inverse kinematics → smoothing → Pose, one `step` a frame, no I/O."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from bodysense.body.ik import IkSettings, IkState, InverseKinematics
from bodysense.body.pose import Pose
from bodysense.body.rotation import quaternion_canonical, quaternion_exp, quaternion_log, quaternion_multiply
from bodysense.errors import BodysenseError
from bodysense.observation import Estimate, Estimator, Observation, observed_points

_HALF = 1.6783469900166605  # y·t at which (1 + y t) e^(−y t), the critically damped response, is one half


@dataclass(frozen=True)
class TrackerSettings:
    """How an estimate becomes motion."""

    half_life: float = 0.02  # s until the smoother has closed half of a jump; 0 does not smooth
    guessed_arm_factor: float = 5.0  # on the half-life of arm and hand joints below which nothing is tracked
    doubt: float = 0.03  # m of expected error at which a guessed point pulls half as much in IK
    measured_weight: float = 10.0  # pull of a tracked point in IK, beside a certain guess's 1
    finger_weight: float = 0.05  # factor on the pull of every point of a finger
    head_weight: float = 0.05  # m²/rad²: pull of the measured head orientation in IK
    longest_gap: float = 1.0  # s without frames after which motion starts afresh
    ik: IkSettings = IkSettings()

    def __post_init__(self) -> None:
        for name in ("half_life", "head_weight"):
            if not 0 <= getattr(self, name) < math.inf:
                raise BodysenseError(f"tracker settings: {name} is {getattr(self, name):g}; it must be 0 or more")
        for name in ("guessed_arm_factor", "doubt", "measured_weight", "finger_weight", "longest_gap"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"tracker settings: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True)
class TrackerState:
    """Everything that the next frame depends on."""

    estimator: Any
    ik: IkState | None = None
    missed: np.ndarray | None = None  # (P, 3) m: how far IK left each guessed finger's wrist from where it was wanted
    time: float | None = None
    root_position: np.ndarray | None = None  # (3,) m, smoothed
    rotation: np.ndarray | None = None  # (J, 4) wxyz, smoothed, parent ← joint
    root_velocity: np.ndarray | None = None  # (3,) m/s
    spin: np.ndarray | None = None  # (J, 3) rad/s


@dataclass(frozen=True)
class Tracker:
    """Turns observations into poses of the estimator's skeleton at any input rate. Immutable; state is an argument."""

    estimator: Estimator
    settings: TrackerSettings = TrackerSettings()

    @cached_property
    def _ik(self) -> InverseKinematics:
        return InverseKinematics(self.estimator.skeleton, self.settings.ik)

    @cached_property
    def _below(self) -> np.ndarray:
        """(J, P) 1 where a point hangs below a joint of an arm or hand, 0 for every other joint."""
        skeleton = self.estimator.skeleton
        below = skeleton.path.T[: len(skeleton.joints)].copy()
        wrists = np.unique(skeleton.wrist_of[skeleton.wrist_of >= 0])
        arm = (below[:, wrists].sum(axis=1) == 1) | (skeleton.wrist_of[: len(below)] >= 0)
        np.fill_diagonal(below, 0)
        return below * arm[:, None]

    def start(self) -> TrackerState:
        """The state before the first frame."""
        return TrackerState(self.estimator.start())

    def step(self, observation: Observation, state: TrackerState) -> tuple[Pose, Estimate, TrackerState]:
        """Track the next T ≥ 1 frames: poses (T, …), what the estimator said, and the state after them.

        Raises BodysenseError when time does not increase.
        """
        estimate, estimator_state = self.estimator.step(observation, state.estimator)
        _, rotation, has_position, has_rotation = observed_points(observation, self.estimator.skeleton)
        head = self.estimator.skeleton.index("head")
        aims = np.where(has_rotation[:, head, None], rotation[:, head], np.nan)
        weight = self._weight(estimate.confidence, has_position)
        roots, rotations = [], []
        for t, time in enumerate(observation.time):
            state = self._pose(estimate.position[t], weight[t], aims[t], has_position[t], float(time), state)
            roots.append(state.root_position)
            rotations.append(state.rotation)
        pose = Pose(self.estimator.skeleton, np.stack(roots), np.stack(rotations))
        return pose, estimate, replace(state, estimator=estimator_state)

    def _missed(self, reached: np.ndarray, target: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """(P, 3) by how much each guessed finger's wrist missed its target; 0 for every other point."""
        wrist = self.estimator.skeleton.wrist_of
        guessed = (wrist >= 0) & ~measured
        return np.where(guessed[:, None], (reached - target)[wrist], 0.0)

    def _weight(self, expected_error: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Pull of every point in IK, (T, P)."""
        wrist = self.estimator.skeleton.wrist_of
        fingers = np.flatnonzero(wrist >= 0)
        error = expected_error.copy()
        # A finger's own error is that of its offset; it is misplaced by its wrist's as well.
        error[:, fingers] = np.hypot(error[:, fingers], error[:, wrist[fingers]])
        weight = np.where(measured, self.settings.measured_weight, 1 / (1 + (error / self.settings.doubt) ** 2))
        # The twenty points of a hand turn it about its wrist; together they must not outvote where the wrist is.
        weight[:, fingers] *= self.settings.finger_weight
        return weight

    def _pose(
        self,
        target: np.ndarray,
        weight: np.ndarray,
        head_rotation: np.ndarray,
        measured: np.ndarray,
        time: float,
        state: TrackerState,
    ) -> TrackerState:
        """One frame: IK from the frame before, then smoothing."""
        if state.time is not None and not time > state.time:  # so that what is no number is refused as well
            raise BodysenseError(
                f"tracker: a frame at {time:g} s came after one at {state.time:g} s; give frames in order of time"
            )
        gap = math.inf if state.time is None else time - state.time
        rotation_target = rotation_weight = None
        if np.isfinite(head_rotation).all():
            joints, head = len(self.estimator.skeleton.joints), self.estimator.skeleton.index("head")
            rotation_target = np.full((joints, 4), np.nan)
            rotation_target[head] = head_rotation
            rotation_weight = np.zeros(joints)
            rotation_weight[head] = self.settings.head_weight
        start = state.ik if gap <= self.settings.longest_gap else None
        if start is not None and state.missed is not None:
            # A guessed hand keeps its shape and direction about the wrist as it is, not as it was wanted.
            target = target + state.missed
        solved, ik = self._ik.solve(target, weight, rotation_target, rotation_weight, start)
        missed = self._missed(ik.position, target, measured)
        if start is None or self.settings.half_life == 0:
            zero = np.zeros((len(self.estimator.skeleton.joints), 3))
            return TrackerState(
                state.estimator, ik, missed, time, solved.root_position, solved.rotation, np.zeros(3), zero
            )
        lost = self._below.any(axis=1) & ~(self._below @ measured).astype(bool)
        slower = np.where(lost, self.settings.guessed_arm_factor, 1.0)
        root, root_velocity, rotation, spin = smooth(solved, state, gap, self.settings.half_life, slower[:, None])
        return TrackerState(state.estimator, ik, missed, time, root, rotation, root_velocity, spin)


def smooth(
    target: Pose, state: TrackerState, interval: float, half_life: float, slower: np.ndarray | float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Critically damped motion of the state toward a pose for `interval` seconds, solved exactly.

    A jump is half closed after `half_life` seconds, a joint's after `slower` (J, 1) times that, at any frame rate.
    Returns root position, root velocity, local rotations and their angular velocities.
    """
    assert state.root_position is not None and state.root_velocity is not None
    assert state.rotation is not None and state.spin is not None

    def settle(offset: np.ndarray, velocity: np.ndarray, slower: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        y = _HALF / (half_life * slower)
        fade = np.exp(-y * interval)
        pull = velocity + offset * y
        return fade * (offset + pull * interval), fade * (velocity - pull * y * interval)

    root, root_velocity = settle(state.root_position - target.root_position, state.root_velocity, 1.0)
    inverse = target.rotation * _CONJUGATE
    offset, spin = settle(quaternion_log(quaternion_multiply(state.rotation, inverse)), state.spin, slower)
    rotation = quaternion_canonical(quaternion_multiply(quaternion_exp(offset), target.rotation))
    return target.root_position + root, root_velocity, rotation, spin


_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])
