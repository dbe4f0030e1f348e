"""Networks that predict points, at run time: one exported file with recurrent state, ONNX Runtime on one thread."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.resting import resting_offset
from bodysense.body.skeleton import Skeleton
from bodysense.devices.simulated.sensors import THREE_POINTS
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import heading, quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense.weights.network import Network
from bodysense_lab.papers.formats import POINTS, PointNetworkTask

WARM_UP = 15  # steps on the first frame, so that the output does not drift while the recurrent state settles


class PointModel(Network):
    """A network that predicts points."""

    @cached_property
    def reads(self) -> tuple[str, ...]:
        """Names of the points whose positions are inputs."""
        return tuple(self.card["reads"])

    @cached_property
    def places(self) -> tuple[str, ...]:
        """Names of the predicted points."""
        return tuple(self.card["places"])

    @cached_property
    def step_interval(self) -> float:
        """Least time (s) between steps of the network; frames may be a little early."""
        return 0.8 / float(self.card["rate"])


@dataclass(frozen=True, eq=False)
class HeadAndHands:
    """Last known head and wrists; a lost wrist keeps its position relative to the head."""

    head_position: np.ndarray  # (3,) m, world
    head_rotation: np.ndarray  # (4,) wxyz, world ← head
    wrist_offset: np.ndarray  # (2, 3) m, left and right, from the head in its heading's axes
    wrist_rotation: np.ndarray  # (2, 4) wxyz, the head's heading ← wrist

    @classmethod
    def standing(cls, skeleton: Skeleton) -> Self:
        """Return head and wrists of a standing body that faces +Z."""
        places = skeleton.indices(THREE_POINTS)
        position, rotation = (values[places] for values in forward_kinematics(standing_pose(skeleton)))
        return cls(position[0], rotation[0], position[1:] - position[0], rotation[1:])

    def updated(
        self, position: np.ndarray, rotation: np.ndarray, has_position: np.ndarray, has_rotation: np.ndarray
    ) -> Self:
        """Return head and wrists after one frame (3, …) of measured values and their masks."""
        head = position[0] if has_position[0] else self.head_position
        turn = rotation[0] if has_rotation[0] else self.head_rotation
        away = quaternion_conjugate(np.tile(heading(turn), (2, 1)))
        offset, turned = quaternion_rotate(away, position[1:] - head), quaternion_multiply(away, rotation[1:])
        return replace(
            self,
            head_position=head,
            head_rotation=turn,
            wrist_offset=np.where(has_position[1:, None], offset, self.wrist_offset),
            wrist_rotation=np.where(has_rotation[1:, None], turned, self.wrist_rotation),
        )

    @property
    def world(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (3, 3) m and rotations (3, 4) of head and wrists in the world."""
        front = np.tile(heading(self.head_rotation), (2, 1))
        wrists = self.head_position + quaternion_rotate(front, self.wrist_offset)
        turned = quaternion_multiply(front, self.wrist_rotation)
        return np.vstack([self.head_position, wrists]), np.vstack([self.head_rotation, turned])


@dataclass(frozen=True)
class PointState:
    """State of the network, and time of its last update."""

    network: dict[str, np.ndarray]
    time: float | None = None


def load_point_model(task: PointNetworkTask, path: str | Path | None = None) -> PointModel:
    """Load the network of a task from a path, or the packaged one for None, which exists for fingers only.

    Raises BodysenseError for other files, and for a network of another task.
    """
    network = PointModel.open(path, POINTS[task])
    if network.card["task"] != task:
        raise BodysenseError(
            f"{path or network.name}: a network for {network.card['task']}, not {task}; give the .onnx that "
            f"`{POINTS[task].command}` wrote"
        )
    return network


@dataclass(frozen=True)
class PointRunner:
    """A loaded network for one wearer. Raises BodysenseError if the skeleton lacks a point of the network."""

    model: PointModel
    skeleton: Skeleton

    def __post_init__(self) -> None:
        wanted = (*self.model.reads, *self.model.places)
        missing = [name for name in wanted if name not in self.skeleton.points]
        if missing or len(self.skeleton.points) != int(self.model.card["points"]):
            raise BodysenseError(
                f"{self.model.name} needs a skeleton of {self.model.card['points']} points; the one given has "
                f"{len(self.skeleton.points)}{f' and no {missing[0]}' if missing else ''}: bring the motion to the "
                "default skeleton with `bodysense.io.rigs.canonical`"
            )

    @cached_property
    def _constants(self) -> dict[str, np.ndarray]:
        rest = resting_offset(self.skeleton)[self.skeleton.indices(self.model.places)]
        return {
            "rest": rest.astype(np.float32)[None],
            "bone_length": self.skeleton.bone_length.astype(np.float32)[None],
            "height": np.array([self.skeleton.extent], dtype=np.float32),
        }

    def start(self) -> PointState:
        """Return the state before the first frame."""
        return PointState(self.model.start())

    def step(
        self, position: np.ndarray, rotation: np.ndarray, time: float, state: PointState
    ) -> tuple[np.ndarray, np.ndarray, PointState]:
        """Run one frame.

        Args:
            position: (R, 3) m, input points in the world.
            rotation: (3, 4) wxyz, of head and wrists in the world.
            time: s.
            state: after the frame before.

        Returns:
            Positions (O, 3) m in the world, expected errors (O,) m, and the state, which advances if a step is due.
        """
        inputs = {
            "position": position[None, None].astype(np.float32),
            "rotation": rotation[None, None].astype(np.float32),
            **self._constants,
        }
        before = state.network
        if state.time is None:
            for _ in range(WARM_UP):
                _, before = self.model.step(inputs, before)
        outputs, after = self.model.step(inputs, before)
        if state.time is None or time - state.time >= self.model.step_interval:
            state = PointState(after, time)
        return outputs["placed"][0, 0].astype(float), outputs["error"][0, 0].astype(float), state
