"""Finger synthesis by a network (UNOC, section 5.3) for motions without fingers; the body is unchanged.

The network predicts finger joints and fingertips in their wrist's axes. A critically damped filter smooths them.
Then every finger is turned from the wrist outward: each joint turns by the shortest arc that points its rigid bone at
the predicted position of the next joint. This is exact if the positions belong to the same hand. It adds no twist about
bones, because positions do not define it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.resting import local_offset
from bodysense.body.skeleton import Skeleton
from bodysense.devices.simulated.sensors import THREE_POINTS
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
    shortest_arc,
)
from bodysense.geometry.spring import spring_step
from bodysense.io.clip import Clip
from bodysense.observing.checks import check_order
from bodysense_lab.papers.unoc.point_model import PointModel, PointRunner, PointState, load_point_model

HALF_LIFE = 0.05  # s, half-life of a jump in the smoother


@dataclass(frozen=True, eq=False)
class FingerState:
    """State of the network, and of the smoothed fingers."""

    network: PointState
    time: float | None = None
    offset: np.ndarray | None = None  # (O, 3) m
    velocity: np.ndarray | None = None  # (O, 3) m/s


@dataclass(frozen=True)
class FingerSynthesis:
    """Synthesis of a skeleton's fingers from its body's motion. Immutable; state is an argument."""

    skeleton: Skeleton
    model: PointModel
    half_life: float = HALF_LIFE

    def __post_init__(self) -> None:
        if not self.half_life >= 0:
            raise BodysenseError(f"half-life {self.half_life:g} s: give 0 or more seconds")

    @cached_property
    def _runner(self) -> PointRunner:
        return PointRunner(self.model, self.skeleton)

    @cached_property
    def places(self) -> np.ndarray:
        """(O,) indices of the predicted points."""
        return self.skeleton.indices(self.model.places)

    def start(self) -> FingerState:
        """Return the state before the first frame."""
        return FingerState(self._runner.start())

    def step(self, pose: Pose, time: np.ndarray, state: FingerState) -> tuple[np.ndarray, FingerState]:
        """Return offsets (T, O, 3) m of finger points from their wrist, in its axes, and the state after T frames.

        Only the body of `pose` is used. `time` (T,) is in seconds. One call with T frames equals T calls with one.
        Raises BodysenseError if time does not increase.
        """
        position, rotation = forward_kinematics(pose)
        reads, oriented = self.skeleton.indices(self.model.reads), self.skeleton.indices(THREE_POINTS)
        offsets = []
        for t, now in enumerate(np.asarray(time, dtype=float).tolist()):
            check_order(now, state.time, "finger synthesis")
            predicted, _, network = self._runner.step(position[t, reads], rotation[t, oriented], now, state.network)
            whole = position[t].copy()
            whole[self.places] = predicted
            offset = local_offset(self.skeleton, whole, rotation[t])[self.places]
            state = self._smoothed(offset, now, replace(state, network=network))
            assert state.offset is not None
            offsets.append(state.offset)
        return np.stack(offsets), state

    def _smoothed(self, target: np.ndarray, time: float, state: FingerState) -> FingerState:
        """Return the state after one step of critically damped motion toward `target` (O, 3) m."""
        if state.offset is None or state.velocity is None or state.time is None or self.half_life == 0:
            return replace(state, time=time, offset=target, velocity=np.zeros_like(target))
        away, velocity = spring_step(state.offset - target, state.velocity, self.half_life, time - state.time)
        return replace(state, time=time, offset=target + away, velocity=velocity)


def finger_rotations(skeleton: Skeleton, offset: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return finger joints (F,) and local rotations (T, F, 4) that point a rigid hand's bones at `offset` (T, O, 3) m.

    Offsets are those of the points `places` (O,) from their wrist, in its axes.
    """
    wanted = dict(zip(places.tolist(), np.moveaxis(offset, -2, 0), strict=True))
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(offset), 1))
    joints = np.flatnonzero(skeleton.wrist_of[: len(skeleton.joints)] >= 0)
    reached: dict[int, np.ndarray] = {}  # positions from the wrist, in its axes
    turned: dict[int, np.ndarray] = {}  # rotations, wrist ← joint
    local = {}
    for joint in joints.tolist():
        parent = skeleton.parents[joint]
        above = turned.get(parent, still)
        base = reached.get(parent, np.zeros((len(offset), 3)))
        reached[joint] = base + quaternion_rotate(above, np.broadcast_to(skeleton.rest_offset[joint], base.shape))
        child = skeleton.parents.index(joint)  # joints of fingers have one
        toward = quaternion_rotate(quaternion_conjugate(above), wanted[child] - reached[joint])
        local[joint] = shortest_arc(np.broadcast_to(skeleton.rest_offset[child], toward.shape), toward)
        turned[joint] = quaternion_multiply(above, local[joint])
    return joints, quaternion_canonical(np.stack([local[joint] for joint in joints.tolist()], axis=1))


def synthesize(clip: Clip, model: PointModel | None = None, half_life: float = HALF_LIFE) -> Clip:
    """Replace the fingers of a clip by synthesised ones; its body is unchanged.

    `model` is the packaged network if None. Raises BodysenseError if the clip lacks points of the default skeleton.
    """
    method = FingerSynthesis(clip.pose.skeleton, load_point_model("fingers") if model is None else model, half_life)
    offset, _ = method.step(clip.pose, clip.time, method.start())
    joints, local = finger_rotations(clip.pose.skeleton, offset, method.places)
    rotation = clip.pose.rotation.copy()
    rotation[:, joints] = local
    return replace(clip, pose=Pose(clip.pose.skeleton, clip.pose.root_position, rotation), has_fingers=True)
