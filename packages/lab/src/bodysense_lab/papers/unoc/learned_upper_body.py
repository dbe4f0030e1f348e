"""The upper body from a headset and two controllers by a network (UNOC, section 5.2); legs stand under it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.resting import resting_offset
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.simulated.sensors import THREE_POINTS
from bodysense.geometry.rotation import quaternion_exp, quaternion_rotate
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense_lab.papers.ik.target_ik import MEASURED_ERROR
from bodysense_lab.papers.unoc.point_model import HeadAndHands, PointModel, PointRunner, PointState, load_point_model
from bodysense_lab.weights import packaged

LOST_ERROR = 0.15  # m: of a hand that is not tracked now
FINGER_ERROR = 0.03  # m: of a relaxed finger about its wrist
LEG_ERROR = 0.5  # m: of legs, of which nothing is known
_FITS = 3  # rounds in which an arm is fitted to its bones


def load_upper_body(path: Path | None = None) -> PointModel:
    """Load a network of the upper body: a path, or None for the packaged one. Raises as `load_point_model` does."""
    return load_point_model("upper-body", path or packaged("upper_body.onnx"))


@dataclass(frozen=True, eq=False)
class LearnedUpperBodyState:
    """State of the network, and the last poses of head and hands."""

    network: PointState
    last: HeadAndHands


@dataclass(frozen=True)
class LearnedUpperBody:
    """Upper body of a skeleton from `head`, `left_wrist` and `right_wrist`, each where tracked.

    A hand that is lost stays where it was relative to the head; one that was never seen hangs. Fingers are relaxed. The
    legs stand under the pelvis, turned as the shoulders are, with a large expected error. What the network says of the
    arms is fitted to their bones and the measured hands.
    """

    skeleton: Skeleton
    model: PointModel

    @cached_property
    def _runner(self) -> PointRunner:
        return PointRunner(self.model, self.skeleton)

    @cached_property
    def _places(self) -> np.ndarray:
        return self.skeleton.indices(self.model.places)

    @cached_property
    def _oriented(self) -> np.ndarray:
        return self.skeleton.indices(THREE_POINTS)

    @cached_property
    def _order(self) -> list[int]:
        return [THREE_POINTS.index(name) for name in self.model.reads]

    @cached_property
    def _expected_error(self) -> np.ndarray:
        """(P,) m, of points that neither the device nor the network gives."""
        error = np.where(self.skeleton.wrist_of >= 0, FINGER_ERROR, LEG_ERROR)
        error[self._oriented] = LOST_ERROR
        error[self.skeleton.index("head_top")] = MEASURED_ERROR
        return error

    def start(self) -> LearnedUpperBodyState:
        """Nothing seen yet: a standing body that faces +Z."""
        return LearnedUpperBodyState(self._runner.start(), HeadAndHands.standing(self.skeleton))

    def step(
        self, observation: Observation, state: LearnedUpperBodyState
    ) -> tuple[PointEstimate, LearnedUpperBodyState]:
        """Complete T frames, one after the other."""
        position, rotation, has_position, has_rotation = observed_points(observation, self.skeleton)
        known = self._oriented
        positions, errors = [], []
        for t, time in enumerate(observation.time):
            seen = (values[t, known] for values in (position, rotation, has_position, has_rotation))
            whole, error, state = self._complete(float(time), replace(state, last=state.last.updated(*seen)))
            positions.append(np.where(has_position[t, :, None], position[t], whole))
            errors.append(np.where(has_position[t], MEASURED_ERROR, error))
        estimate = PointEstimate(self.skeleton, np.stack(positions), (~has_position).astype(float), np.stack(errors))
        return estimate, state

    def _complete(
        self, time: float, state: LearnedUpperBodyState
    ) -> tuple[np.ndarray, np.ndarray, LearnedUpperBodyState]:
        """Positions (P, 3) m and expected errors (P,) m of the whole body in one frame."""
        skeleton = self.skeleton
        position, rotation = state.last.world
        predicted, expected, network = self._runner.step(position[self._order], rotation, time, state.network)

        whole = np.zeros((len(skeleton.points), 3))
        whole[self._places], whole[self._oriented] = predicted, position
        shoulders, elbows, wrists = self._arms
        upper, fore = self.skeleton.bone_length[elbows, None], self.skeleton.bone_length[wrists, None]
        whole[shoulders], whole[elbows] = fitted_arms(whole[shoulders], whole[elbows], whole[wrists], upper, fore)
        left, right, pelvis = skeleton.indices(["left_shoulder", "right_shoulder", "pelvis"])
        across = whole[left] - whole[right]
        turn = quaternion_exp(np.array([0.0, np.arctan2(-across[2], across[0]), 0.0]))
        legs = self._legs
        whole[legs] = whole[pelvis] + quaternion_rotate(np.tile(turn, (len(legs), 1)), self._standing[legs])
        head_top = skeleton.index("head_top")
        whole[head_top] = position[0] + quaternion_rotate(rotation[0], skeleton.rest_offset[head_top])
        for k, finger in enumerate(self._fingers):
            about = np.tile(rotation[k + 1], (len(finger), 1))
            whole[finger] = position[k + 1] + quaternion_rotate(about, self._relaxed[finger])
        error = self._expected_error.copy()
        error[self._places] = expected
        return whole, error, replace(state, network=network)

    @cached_property
    def _arms(self) -> list[np.ndarray]:
        """Left and right shoulder, elbow, wrist."""
        parts = ("shoulder", "elbow", "wrist")
        return [self.skeleton.indices([f"left_{part}", f"right_{part}"]) for part in parts]

    @cached_property
    def _standing(self) -> np.ndarray:
        """(P, 3) m from the pelvis of a standing body."""
        position, _ = forward_kinematics(standing_pose(self.skeleton))
        return position - position[self.skeleton.index("pelvis")]

    @cached_property
    def _relaxed(self) -> np.ndarray:
        return resting_offset(self.skeleton)

    @cached_property
    def _fingers(self) -> list[np.ndarray]:
        """Points of the left and the right hand's fingers."""
        return [np.flatnonzero(self.skeleton.wrist_of == wrist) for wrist in self._oriented[1:]]

    @cached_property
    def _legs(self) -> np.ndarray:
        """Every point that nothing else gives."""
        other = {*self._places.tolist(), *self._oriented.tolist(), self.skeleton.index("head_top")}
        other |= set(np.flatnonzero(self.skeleton.wrist_of >= 0).tolist())
        return np.array([point for point in range(len(self.skeleton.points)) if point not in other])


def fitted_arms(
    shoulder: np.ndarray, elbow: np.ndarray, wrist: np.ndarray, upper: np.ndarray, fore: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Shoulders and elbows (N, 3) moved a little so that bones (N, 1) fit measured wrists (N, 3), all metres.

    The forearm has its length; the upper arm nearly, its error shared by both ends (after FABRIK, Aristidou 2011).
    """
    elbow = wrist + _with_length(elbow - wrist, fore)
    for _ in range(_FITS):
        bone = elbow - shoulder
        change = (_with_length(bone, upper) - bone) / 2
        shoulder = shoulder - change
        elbow = wrist + _with_length(elbow + change - wrist, fore)
    return shoulder, elbow


def _with_length(vector: np.ndarray, length: np.ndarray) -> np.ndarray:
    return vector * (length / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9))
