"""IkTracker: estimator → inverse kinematics → smoothing → Pose, one `step` a frame, no I/O.

An estimator with rotations keeps them in all freedoms of inverse kinematics, such as twists and the spine. Its motion
is not smoothed: it is smooth already, and measured points must not lag.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.errors import BodysenseError
from bodysense.geometry.products import CONJUGATE, exp, log, multiply
from bodysense.geometry.spring import spring_step
from bodysense.observing.checks import check_order
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense_lab.papers.ik.ik import IkSettings, IkState
from bodysense_lab.papers.ik.target_ik import COARSE, HEAD_WEIGHT, TargetIk

_GUESSED_ARM_FACTOR = 5.0  # factor on the half-life of arm and hand joints without tracked points below them
_LONGEST_GAP = 1.0  # s without frames after which motion is reset
# Joints inside the trunk. No camera of a headset sees them, so the network's errors there are never corrected, and a
# predicted spine that is longer than the wearer's folds hard bones. Their weight in inverse kinematics is multiplied by
# `_INSIDE_FACTOR`: chosen on the demo's body, on which 1 turns the pelvis by over
# 90° in 34 of 750 frames, and 0.02 in none.
_INSIDE = ("pelvis", "spine1", "spine2", "spine3")
_INSIDE_FACTOR = 0.02
_FASTEST_TURN = 20.0  # rad/s; a body turns with a common share of its change if a joint would turn faster


class Estimator(Protocol):
    """A method that completes a body. State is an argument, so streaming, batches and replay are the same code."""

    @property
    def skeleton(self) -> Skeleton:
        """The body that is completed."""
        ...

    def start(self) -> Any:
        """The state before the first frame."""
        ...

    def step(self, observation: Observation, state: Any) -> tuple[PointEstimate, Any]:
        """Complete the next T ≥ 1 frames: one call with T frames equals T calls with one."""
        ...


@dataclass(frozen=True)
class IkTrackerSettings:
    """Settings of the conversion of an estimate to motion."""

    # s in which the smoother closes half of a jump; 0 disables it. For estimators without rotations.
    half_life: float = 0.03
    ik: IkSettings = COARSE

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
    def _solver(self) -> TargetIk:
        return TargetIk(self.estimator.skeleton, self.settings.ik)

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
    def _inside(self) -> np.ndarray:
        """(P,) factor on the weight of a predicted point: `_INSIDE_FACTOR` for joints that no camera ever sees."""
        factor = np.ones(len(self.estimator.skeleton.points))
        factor[self.estimator.skeleton.indices(_INSIDE)] = _INSIDE_FACTOR
        return factor

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
        skeleton, head = self.estimator.skeleton, self.estimator.skeleton.index("head")
        _, rotation, has_position, has_rotation = observed_points(observation, skeleton)
        if estimate.pose is not None:
            pose, times = self._solver.bend(estimate, estimate.pose, observation), observation.time.tolist()
            for before, time in zip((state.time, *times), times, strict=False):
                check_order(time, before, "tracker")
            return pose, estimate, IkTrackerState(estimator_state, time=times[-1])
        aims = np.full((len(rotation), len(skeleton.joints), 4), np.nan)
        aims[:, head] = rotation[:, head]
        aim_weight = np.zeros(aims.shape[:2])
        aim_weight[:, head] = np.where(has_rotation[:, head], HEAD_WEIGHT, 0.0)
        weight = self._solver.weight(estimate.confidence, has_position)
        weight = np.where(has_position, weight, weight * self._inside)
        roots, rotations = [], []
        for t, time in enumerate(observation.time):
            state = self._pose(
                estimate.position[t], weight[t], aims[t], aim_weight[t], has_position[t], float(time), state
            )
            roots.append(state.root_position)
            rotations.append(state.rotation)
        pose = Pose(skeleton, np.stack(roots), np.stack(rotations))
        return pose, estimate, replace(state, estimator=estimator_state)

    def _pose(
        self,
        target: np.ndarray,
        weight: np.ndarray,
        aim: np.ndarray,
        aim_weight: np.ndarray,
        measured: np.ndarray,
        time: float,
        state: IkTrackerState,
    ) -> IkTrackerState:
        """Solve one frame: IK from the frame before, then smoothing."""
        check_order(time, state.time, "tracker")
        gap = math.inf if state.time is None else time - state.time
        start = state.ik if gap <= _LONGEST_GAP else None
        if start is not None and state.missed is not None:
            # A predicted hand keeps its shape and direction relative to the actual wrist, not the wanted one.
            target = target + state.missed
        solved, ik = self._solver.ik.solve(target, weight, aim, aim_weight, start)
        off = (ik.position - target).take(self._solver.wrist_or_self, axis=0)
        missed = off * (self._solver.is_finger & ~measured)[:, None]  # of each predicted finger's wrist
        if start is None or self.settings.half_life == 0:
            still = np.zeros((len(self.estimator.skeleton.joints), 3))
            root, turns = solved.root_position, solved.rotation
            return IkTrackerState(state.estimator, ik, missed, time, root, turns, np.zeros(3), still)
        slower = np.where(self._below @ measured < self._arm, _GUESSED_ARM_FACTOR, 1.0)
        root, root_velocity, rotation, spin = smooth(solved, state, gap, self.settings.half_life, slower)
        root, rotation, share = limited(state, root, rotation, gap)
        return IkTrackerState(state.estimator, ik, missed, time, root, rotation, share * root_velocity, share * spin)


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


def limited(
    before: IkTrackerState, root: np.ndarray, rotation: np.ndarray, interval: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return root and rotations at which no joint has turned faster than `_FASTEST_TURN`, and the share of the change.

    All joints take one share of their change, because a joint that turns on its own swings its limb through the body.
    """
    assert before.root_position is not None and before.rotation is not None
    change = log(multiply(rotation, before.rotation * CONJUGATE))
    fastest = float(np.sqrt(np.einsum("jk,jk->j", change, change)).max())
    share = min(1.0, _FASTEST_TURN * interval / max(fastest, 1e-9))
    if share == 1:
        return root, rotation, share
    turned = multiply(exp(share * change), before.rotation)
    turned *= np.copysign(1.0, turned[:, :1])
    return before.root_position + share * (root - before.root_position), turned, share
