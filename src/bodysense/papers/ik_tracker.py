"""IkTracker: estimator → inverse kinematics → smoothing → Pose, one `step` a frame, no I/O.

An estimator with rotations keeps them in all freedoms of inverse kinematics, such as twists and the spine. Its motion
is not smoothed: it is smooth already, and measured points must not lag.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from bodysense.body.ik import IkSettings, IkState, InverseKinematics
from bodysense.body.pose import Pose
from bodysense.body.products import CONJUGATE, exp, log, multiply, world_rotation
from bodysense.body.spring import spring_step
from bodysense.devices.estimate import Estimator, PointEstimate
from bodysense.errors import BodysenseError
from bodysense.observation import Observation, check_order, observed_points

MEASURED_ERROR = 0.002  # m: expected error of a tracked point
_GUESSED_ARM_FACTOR = 5.0  # factor on the half-life of arm and hand joints without tracked points below them
_DOUBT = 0.03  # m, expected error at which a predicted point pulls half as much in IK
_MEASURED_WEIGHT = 10.0  # pull of a tracked point in IK, relative to a certain prediction's 1
_FINGER_WEIGHT = 0.05  # factor on the pull of every point of a finger
_HEAD_WEIGHT = 0.05  # m²/rad²: pull of the measured head orientation in IK
_POSE_WEIGHT = 1e-3  # m²/rad²: pull of each rotation of the estimator
_LONGEST_GAP = 1.0  # s without frames after which motion is reset


@dataclass(frozen=True)
class IkTrackerSettings:
    """Settings of the conversion of an estimate to motion."""

    # s in which the smoother closes half of a jump; 0 disables it. For estimators without rotations.
    half_life: float = 0.03
    # Predictions are centimetres off: IK need not place them to hundredths of a millimetre.
    ik: IkSettings = IkSettings(tolerance=1e-4)

    def __post_init__(self) -> None:
        if not 0 <= self.half_life < math.inf:
            raise BodysenseError(f"tracker settings: half_life is {self.half_life:g}; it must be 0 or more")


@dataclass(frozen=True)
class IkTrackerState:
    """State for the next frame."""

    estimator: Any
    ik: IkState | None = None
    missed: np.ndarray | None = None  # (P, 3) m: IK's offset of each predicted finger's wrist from its target
    time: float | None = None
    root_position: np.ndarray | None = None  # (3,) m, smoothed
    rotation: np.ndarray | None = None  # (J, 4) wxyz, smoothed, parent ← joint
    root_velocity: np.ndarray | None = None  # (3,) m/s
    spin: np.ndarray | None = None  # (J, 3) rad/s


@dataclass(frozen=True)
class IkTracker:
    """Turns observations into poses of the estimator's skeleton at any input rate. Immutable; state is an argument."""

    estimator: Estimator
    settings: IkTrackerSettings = IkTrackerSettings()

    @cached_property
    def _ik(self) -> InverseKinematics:
        return InverseKinematics(self.estimator.skeleton, self.settings.ik)

    @cached_property
    def _is_finger(self) -> np.ndarray:
        """(P,) bool."""
        return self.estimator.skeleton.wrist_of >= 0

    @cached_property
    def _wrist_or_self(self) -> np.ndarray:
        """(P,) the wrist of a finger's point; any other point itself."""
        return np.where(self._is_finger, self.estimator.skeleton.wrist_of, np.arange(len(self._is_finger)))

    @cached_property
    def _below(self) -> np.ndarray:
        """(J, P) 1 if a point is below a joint of an arm or hand, 0 for every other joint."""
        skeleton = self.estimator.skeleton
        below = skeleton.path.T[: len(skeleton.joints)].copy()
        wrists = np.unique(skeleton.wrist_of[skeleton.wrist_of >= 0])
        arm = (below[:, wrists].sum(axis=1) == 1) | (skeleton.wrist_of[: len(below)] >= 0)
        np.fill_diagonal(below, 0)
        return below * arm[:, None]

    @cached_property
    def _arm(self) -> np.ndarray:
        """(J,) 1 for a joint of an arm or hand with points below it, 0 for every other joint."""
        return self._below.any(axis=1).astype(float)

    def start(self) -> IkTrackerState:
        """The state before the first frame."""
        return IkTrackerState(self.estimator.start())

    def step(self, observation: Observation, state: IkTrackerState) -> tuple[Pose, PointEstimate, IkTrackerState]:
        """Track the next T ≥ 1 frames: poses (T, …), the estimator's result, and the state.

        Raises BodysenseError when time does not increase.
        """
        estimate, estimator_state = self.estimator.step(observation, state.estimator)
        _, rotation, has_position, has_rotation = observed_points(observation, self.estimator.skeleton)
        aims, aim_weight = self._aims(estimate, rotation, has_rotation)
        if estimate.pose is not None:  # such an estimator reports what it took as tracked, by gloves too
            has_position = estimate.occluded < 0.5
        weight = self._weight(estimate.confidence, has_position)
        roots, rotations = [], []
        for t, time in enumerate(observation.time):
            root = None if estimate.pose is None else estimate.pose.root_position[t]
            state = self._pose(
                *(estimate.position[t], weight[t], aims[t], aim_weight[t], has_position[t], root, float(time), state)
            )
            roots.append(state.root_position)
            rotations.append(state.rotation)
        pose = Pose(self.estimator.skeleton, np.stack(roots), np.stack(rotations))
        return pose, estimate, replace(state, estimator=estimator_state)

    def _aims(
        self, estimate: PointEstimate, rotation: np.ndarray, has_rotation: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return wanted world rotations (T, J, 4) of joints, and their pull (T, J).

        The measured head's; if the estimator gives rotations, all of them, with more weight for measured head and
        wrists, which it may have moved slightly when one was lost or found again.
        """
        skeleton = self.estimator.skeleton
        joints, head = len(skeleton.joints), skeleton.index("head")
        if estimate.pose is None:
            aims, weight = np.full((len(rotation), joints, 4), np.nan), np.zeros((len(rotation), joints))
            aims[:, head] = rotation[:, head]
            weight[:, head] = np.where(has_rotation[:, head], _HEAD_WEIGHT, 0.0)
            return aims, weight
        aims = np.stack([world_rotation(skeleton, local) for local in estimate.pose.rotation])
        weight = np.where(has_rotation[:, :joints], _HEAD_WEIGHT, _POSE_WEIGHT)
        return aims, weight

    def _missed(self, reached: np.ndarray, target: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Return the distance (P, 3) of each predicted finger's wrist from its target; 0 for every other point."""
        guessed = self._is_finger & ~measured
        return (reached - target).take(self._wrist_or_self, axis=0) * guessed[:, None]

    def _weight(self, expected_error: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Return the pull of every point in IK, (T, P)."""
        # A finger's own error is that of its offset; its wrist's error is added.
        squared = (expected_error / _DOUBT) ** 2
        squared = squared + squared.take(self._wrist_or_self, axis=1) * self._is_finger
        weight = np.where(measured, _MEASURED_WEIGHT, 1 / (1 + squared))
        # The twenty points of a hand rotate it about its wrist; together they must not outweigh the wrist's position.
        return np.where(self._is_finger, weight * _FINGER_WEIGHT, weight)

    def _pose(
        self,
        target: np.ndarray,
        weight: np.ndarray,
        aim: np.ndarray,
        aim_weight: np.ndarray,
        measured: np.ndarray,
        root: np.ndarray | None,
        time: float,
        state: IkTrackerState,
    ) -> IkTrackerState:
        """Solve one frame: IK from the frame before, then smoothing; with a `root`, IK from the estimator's pose."""
        check_order(time, state.time, "tracker")
        gap = math.inf if state.time is None else time - state.time
        if root is not None:
            solved, ik = self._ik.solve(target, weight, aim, aim_weight, self._ik.at(root, aim))
            return self._at_once(solved, ik, None, time, state)
        start = state.ik if gap <= _LONGEST_GAP else None
        if start is not None and state.missed is not None:
            # A predicted hand keeps its shape and direction relative to the actual wrist, not the wanted one.
            target = target + state.missed
        solved, ik = self._ik.solve(target, weight, aim, aim_weight, start)
        missed = self._missed(ik.position, target, measured)
        if start is None or self.settings.half_life == 0:
            return self._at_once(solved, ik, missed, time, state)
        slower = np.where(self._below @ measured < self._arm, _GUESSED_ARM_FACTOR, 1.0)
        root, root_velocity, rotation, spin = smooth(solved, state, gap, self.settings.half_life, slower)
        return IkTrackerState(state.estimator, ik, missed, time, root, rotation, root_velocity, spin)

    def _at_once(
        self, pose: Pose, ik: IkState, missed: np.ndarray | None, time: float, state: IkTrackerState
    ) -> IkTrackerState:
        """Return the state of a body that is output without smoothing."""
        still = np.zeros((len(self.estimator.skeleton.joints), 3))
        return IkTrackerState(state.estimator, ik, missed, time, pose.root_position, pose.rotation, np.zeros(3), still)


def smooth(
    target: Pose, state: IkTrackerState, interval: float, half_life: float, slower: np.ndarray | float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the critically damped motion of the state toward a pose for `interval` seconds, solved exactly.

    A jump is half closed after `half_life` seconds, a joint's after `slower` (J,) times that, at any frame rate.
    Returns root position, root velocity, local rotations and their angular velocities.
    """
    assert state.root_position is not None and state.root_velocity is not None
    assert state.rotation is not None and state.spin is not None

    # Joints, then the root, as rows that all settle alike.
    offset = np.concatenate([log(multiply(state.rotation, target.rotation * CONJUGATE)), [state.root_position]])
    offset[-1] -= target.root_position
    velocity = np.concatenate([state.spin, [state.root_velocity]])
    lives = np.full((len(offset), 1), half_life)
    lives[:-1, 0] *= slower
    offset, velocity = spring_step(offset, velocity, lives, interval)
    rotation = multiply(exp(offset[:-1]), target.rotation)
    rotation *= np.copysign(1.0, rotation[:, :1])
    return target.root_position + offset[-1], velocity[-1], rotation, velocity[:-1]
