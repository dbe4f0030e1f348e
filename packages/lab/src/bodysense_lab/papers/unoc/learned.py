"""The learned estimator of UNOC, a network file on a wearer's skeleton, and clips tracked with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.takes.last_known import last_known
from bodysense.weights.network import Network
from bodysense_lab.core.scoring import RATE, TrackedClip
from bodysense_lab.papers.formats import BODY
from bodysense_lab.papers.ik.target_ik import MEASURED_ERROR
from bodysense_lab.papers.unoc.ik_tracker import IkTracker, IkTrackerSettings
from bodysense_lab.weights import packaged

PACKAGED = "body_gru.onnx"
_DUE = 0.8  # share of the time between two steps after which a frame advances the state


@dataclass(frozen=True)
class LearnedState:
    """State of the network, time of its last step, and the last known headset pose."""

    network: dict[str, np.ndarray]
    time: float | None
    head_position: np.ndarray  # (3,) m
    head_rotation: np.ndarray  # (4,) wxyz


def load_model(path: str | Path | None = None) -> Network:
    """Load a network: a path, or None for the packaged one. Raises BodysenseError for a file that is not ours."""
    return Network.open(packaged(PACKAGED) if path is None else path, BODY)


@dataclass(frozen=True)
class Learned:
    """A trained network on the wearer's skeleton, which must have the points that the network was trained on.

    The network steps at its own rate. A frame that comes sooner is completed from the state of the last step and does
    not advance it, so that any input rate, also an irregular one, is answered at once and at every frame.
    """

    model: Network
    skeleton: Skeleton

    def __post_init__(self) -> None:
        wanted = tuple(self.model.card["points"])
        if self.skeleton.points != wanted:
            odd = sorted(set(wanted) ^ set(self.skeleton.points)) or ["their order"]
            raise BodysenseError(
                f"{self.model.name} completes a skeleton of {len(wanted)} points; the one given has "
                f"{len(self.skeleton.points)} (differs in {', '.join(odd[:3])}): bring the motion to the default "
                "skeleton with `bodysense.io.rigs.canonical`"
            )

    @cached_property
    def _constants(self) -> dict[str, np.ndarray]:
        return {
            "bone_length": self.skeleton.bone_length.astype(np.float32)[None],
            "height": np.array([self.skeleton.extent], dtype=np.float32),
        }

    def start(self) -> LearnedState:
        """Return the first state: a standing body that faces +Z."""
        standing, _ = forward_kinematics(standing_pose(self.skeleton))
        identity = np.array([1.0, 0.0, 0.0, 0.0])
        return LearnedState(self.model.start(), None, standing[self.skeleton.index("head")], identity)

    def step(self, observation: Observation, state: LearnedState) -> tuple[PointEstimate, LearnedState]:
        """Complete T frames, one after the other."""
        position, rotation, has_position, has_rotation = observed_points(observation, self.skeleton)
        head = self.skeleton.index("head")
        predictions, hidden, errors = [], [], []
        for t, time in enumerate(observation.time):
            state = LearnedState(
                state.network,
                state.time,
                position[t, head] if has_position[t, head] else state.head_position,
                rotation[t, head] if has_rotation[t, head] else state.head_rotation,
            )
            answer, state = self._run(position[t], has_position[t], float(time), state)
            for row, name in ((predictions, "completed"), (hidden, "occluded"), (errors, "error")):
                row.append(answer[name][0, 0])
        seen = has_position[..., None]
        estimate = PointEstimate(
            skeleton=self.skeleton,
            position=np.where(seen, position, np.stack(predictions)),
            occluded=np.stack(hidden),
            confidence=np.where(has_position, MEASURED_ERROR, np.stack(errors)),
        )
        return estimate, state

    def _run(
        self, position: np.ndarray, visible: np.ndarray, time: float, state: LearnedState
    ) -> tuple[dict[str, np.ndarray], LearnedState]:
        """One frame through the network; the state advances only when a step is due."""
        head = self.skeleton.index("head")
        nominal = 1 / float(self.model.card["rate"])
        elapsed = nominal if state.time is None else time - state.time
        position = np.where(visible[:, None], position, 0.0)
        position[head] = state.head_position
        visible = visible.copy()
        visible[head] = True
        inputs = {
            "position": position[None, None].astype(np.float32),
            "visible": visible[None, None],
            "head_position": state.head_position[None, None].astype(np.float32),
            "head_rotation": state.head_rotation[None, None].astype(np.float32),
            "interval": np.array([[elapsed]], dtype=np.float32),
            **self._constants,
        }
        answer, after = self.model.step(inputs, state.network)
        if state.time is None or elapsed >= _DUE / float(self.model.card["fastest_rate"]):
            state = replace(state, network=after, time=time)
        return answer, state


def track_clip(clip: Clip, model: Path | None, settings: IkTrackerSettings) -> TrackedClip:
    """Run the tracker and the baselines on what a headset sees of a canonical clip."""
    clip = resample(clip, RATE)
    skeleton = clip.pose.skeleton
    observation = observe(clip.pose, clip.time, HEADSET_CAMERA)
    tracker = IkTracker(Learned(load_model(model), skeleton), settings)
    pose, estimate, _ = tracker.step(observation, tracker.start())
    position = {"bodysense": np.asarray(forward_kinematics(pose)[0]), "network": estimate.position}
    return TrackedClip(clip, observation, position | last_known(observation, skeleton))
