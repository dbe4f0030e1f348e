"""Jobs and answers: values that pass between a session, the scheduler and the receivers of a body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.geometry.products import world_rotation
from bodysense.io.formats.protocol import PoseFrame, SignalFrame
from bodysense.observing.observation import Observation
from bodysense_live.protocols.webxr import Placement
from bodysense_live.sessions.estimation import Pipeline, PipelineState


@dataclass(frozen=True, eq=False)
class CompletionJob:
    """A frame to complete."""

    pipeline: Pipeline
    observation: Observation  # T = 1
    state: PipelineState
    frame: SignalFrame
    received: float  # s, of the server's clock
    placement: Placement  # of the signal's world


@dataclass(frozen=True, eq=False)
class Answer:
    """The body that answers a frame."""

    signal: SignalFrame
    frame: PoseFrame
    pose: Pose
    moment: float  # s, always increasing
    received: float  # s, of the server's clock
    estimated: np.ndarray | None  # (P, 3) m, the tracker's points; None if the pose was changed after it
    placement: Placement  # of the signal's world in the body's

    @cached_property
    def points(self) -> np.ndarray:
        """Positions of all points in the world, (P, 3) m."""
        return np.asarray(forward_kinematics(self.pose)[0]) if self.estimated is None else self.estimated

    @cached_property
    def turns(self) -> np.ndarray:
        """Rotations of all joints, world ← joint, (J, 4) wxyz."""
        skeleton = self.pose.skeleton
        return world_rotation(skeleton.parents, skeleton.levels, np.asarray(self.pose.rotation))

    @cached_property
    def in_signal(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Positions (3,) m of points and rotations (4,) of joints by name, in the signal's world."""
        skeleton, back = self.pose.skeleton, self.placement.inverse()
        places, turns = back.place(self.points), back.turn(self.turns)
        return dict(zip(skeleton.points, places, strict=True)), dict(zip(skeleton.joints, turns, strict=True))

    @property
    def is_tracked(self) -> bool:
        """Whether any point of the signal is tracked."""
        return bool((self.signal.has != 0).any())
