"""HMD-VAE at run time: bodies from a headset and two hands, several bodies for one signal, bodies from the prior.

One exported network runs in ONNX Runtime on one thread, for every frame. Frames may come at any rate: the inputs are
interpolated at the network's rate from the last half second.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from bodysense.body.body_joints import body_skeleton, whole_pose
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.simulated.sensors import THREE_POINTS
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    normalize,
    quaternion_conjugate,
    quaternion_identity,
    quaternion_multiply,
    slerp,
)
from bodysense.observing.checks import FARTHEST, UNIT_TOLERANCE, check_order
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense.weights.network import Network
from bodysense_lab.papers.formats import BODY_VAE
from bodysense_lab.papers.ik.target_ik import MEASURED_ERROR
from bodysense_lab.papers.unoc.point_model import HeadAndHands

FINGER_ERROR = 0.03  # m: error of a relaxed finger relative to its wrist
_TOLERANCE = 1e-6  # s, or frames; times that differ less are equal


class BodyVaeModel(Network):
    """A body VAE."""

    @property
    def frames(self) -> int:
        """Number of input frames."""
        return int(self.card["frames"])

    @property
    def latent(self) -> int:
        """Length of the latent vector."""
        return int(self.card["latent"])

    @property
    def interval(self) -> float:
        """Interval (s) of the input frames."""
        return 1 / float(self.card["rate"])

    def body(
        self, position: np.ndarray, rotation: np.ndarray, trust: float, noise: np.ndarray, rest_offset: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return root position (3,) m and local rotations (22, 4) of the last of T frames.

        Args:
            position: (T, P, 3) m, world.
            rotation: (T, P, 4) wxyz, world.
            trust: 1 samples the posterior, 0 the prior; between them, mean and deviation of the latent vector are
                interpolated.
            noise: (d,) standard normal; 0 gives the mean.
            rest_offset: (22, 3) m, of the wearer.
        """
        inputs = {
            "position": position,
            "rotation": rotation,
            "trust": np.array([trust]),
            "noise": noise,
            "rest_offset": rest_offset,
        }
        outputs = self.run({name: value[None].astype(np.float32) for name, value in inputs.items()})
        local = np.asarray(normalize(outputs["local_rotation"][0].astype(float)))
        return outputs["root_position"][0].astype(float), local


def load_body_vae(path: str | Path | None = None) -> BodyVaeModel:
    """Load a network from a path, or the packaged one for None. Raises BodysenseError for other files."""
    return BodyVaeModel.open(path, BODY_VAE)


@dataclass(frozen=True, eq=False)
class BodyVaeState:
    """Head and wrists of the last half second, and their last known values."""

    time: np.ndarray  # (N,) s
    position: np.ndarray  # (N, 3, 3) m, world
    rotation: np.ndarray  # (N, 3, 4) wxyz, world
    last: HeadAndHands


@dataclass(frozen=True, eq=False)
class BodyVaeEstimator:
    """Estimator of a skeleton's whole body from `head`, `left_wrist` and `right_wrist`.

    The head is at the measured position, and fingers are relaxed. The paper's network assumes tracked hands, so a lost
    hand keeps its position relative to the head, and a hand that was never seen hangs. A lost head stays in place.
    Positions that are not finite or over 1 km away, and rotations that are not unit quaternions, count as lost. After
    half a second without frames the history is reset.
    """

    skeleton: Skeleton
    model: BodyVaeModel
    noise: np.ndarray | None = field(default=None, repr=False)  # (d,) from N(0, I), constant over time; None: the mean

    def __post_init__(self) -> None:
        if tuple(self.model.card["reads"]) != THREE_POINTS:
            raise BodysenseError(
                f"{self.model.name}: a model 0 reads the whole body, not a device; give a model 1 to 4"
            )
        if self.noise is not None and self.noise.shape != (self.model.latent,):
            raise BodysenseError(f"noise has shape {self.noise.shape}; {self.model.name} needs ({self.model.latent},)")

    @cached_property
    def _places(self) -> np.ndarray:
        return self.skeleton.indices(THREE_POINTS)

    @cached_property
    def _rest_offset(self) -> np.ndarray:
        return body_skeleton(self.skeleton).rest_offset

    @cached_property
    def _noise(self) -> np.ndarray:
        return np.zeros(self.model.latent) if self.noise is None else self.noise

    @cached_property
    def _expected_error(self) -> np.ndarray:
        """(P,) m: the network's error on validation people; points outside the 22 joints have that of their parent."""
        error = dict(zip(BODY, self.model.card["expected_error"], strict=True))
        values: list[float] = []
        for point, name in enumerate(self.skeleton.points):
            if self.skeleton.wrist_of[point] >= 0:
                values.append(values[self.skeleton.wrist_of[point]] + FINGER_ERROR)
            else:
                values.append(error[name] if name in error else values[self.skeleton.parents[point]])
        return np.maximum(values, MEASURED_ERROR)

    def start(self) -> BodyVaeState:
        """Return the initial state: a standing body that faces +Z."""
        return BodyVaeState(np.zeros(0), np.zeros((0, 3, 3)), np.zeros((0, 3, 4)), HeadAndHands.standing(self.skeleton))

    def step(self, observation: Observation, state: BodyVaeState) -> tuple[PointEstimate, BodyVaeState]:
        """Complete T frames in order; return their estimate and the state.

        Raises BodysenseError if time does not increase.
        """
        position, rotation, has_position, has_rotation = observed_points(observation, self.skeleton)
        with np.errstate(over="ignore", invalid="ignore"):
            has_position = has_position & (np.abs(position).max(axis=-1) <= FARTHEST)  # false for NaN
            has_rotation = has_rotation & (np.abs(np.linalg.norm(rotation, axis=-1) - 1) < UNIT_TOLERANCE)
        position = np.where(has_position[..., None], position, 0.0)
        rotation = np.asarray(normalize(np.where(has_rotation[..., None], rotation, quaternion_identity(rotation))))
        places, roots, rotations = self._places, [], []
        for t, time in enumerate(observation.time):
            seen = (values[t, places] for values in (position, rotation, has_position, has_rotation))
            state = self._add_frame(float(time), state.last.updated(*seen), state)
            root, local = self.model.body(*self._window(state), 1.0, self._noise, self._rest_offset)
            roots.append(root)
            rotations.append(local)
        pose = self._with_measured_rotations(
            whole_pose(self.skeleton, np.stack(roots), np.stack(rotations)), rotation, has_rotation
        )
        points = np.where(has_position[..., None], position, forward_kinematics(pose)[0])
        error = np.where(has_position, MEASURED_ERROR, self._expected_error)
        return PointEstimate(self.skeleton, points, (~has_position).astype(float), error, pose), state

    def _with_measured_rotations(self, pose: Pose, rotation: np.ndarray, has_rotation: np.ndarray) -> Pose:
        """Replace the rotations of head and wrists by measured ones, in place; return the pose.

        No other of the 22 joints descends from them.
        """
        world, places = np.asarray(forward_kinematics(pose)[1]), self._places
        above = world[:, [self.skeleton.parents[place] for place in places]]
        local = quaternion_multiply(quaternion_conjugate(above), rotation[:, places])
        pose.rotation[:, places] = np.where(has_rotation[:, places, None], local, pose.rotation[:, places])
        return pose

    def _add_frame(self, time: float, last: HeadAndHands, state: BodyVaeState) -> BodyVaeState:
        """Return the state with head and wrists of one more frame."""
        check_order(time, state.time[-1] if len(state.time) else None, "body VAE")
        places, turns = last.world
        span = (self.model.frames - 1) * self.model.interval
        continues = len(state.time) and time - state.time[-1] <= max(span, self.model.interval)
        # Keep one frame before the window for interpolation.
        first = max(0, int(np.searchsorted(state.time, time - span + _TOLERANCE)) - 1) if continues else len(state.time)
        return BodyVaeState(
            np.append(state.time[first:], time),
            np.concatenate([state.position[first:], places[None]]),
            np.concatenate([state.rotation[first:], turns[None]]),
            last,
        )

    def _window(self, state: BodyVaeState) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (L, 3, 3) and rotations (L, 3, 4) at the network's rate; constant before the first frame."""
        back = np.arange(self.model.frames - 1, -1, -1) * self.model.interval
        place = np.interp(state.time[-1] - back, state.time, np.arange(len(state.time)))
        before = np.floor(place + _TOLERANCE).astype(int)
        after = np.minimum(before + 1, len(state.time) - 1)
        share = np.clip(place - before, 0, 1)[:, None]
        position = state.position[before] + share[..., None] * (state.position[after] - state.position[before])
        share = np.broadcast_to(share, (len(share), len(THREE_POINTS)))
        return position, np.asarray(slerp(state.rotation[before], state.rotation[after], share))


def sample_noise(model: BodyVaeModel, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw `count` latent vectors (N, d) from N(0, I)."""
    if count < 1:
        raise BodysenseError(f"{count} samples; give at least 1")
    return rng.standard_normal((count, model.latent))


def sample_prior(skeleton: Skeleton, model: BodyVaeModel, count: int, rng: np.random.Generator) -> Pose:
    """Draw `count` bodies (N, …) from the prior: they face +Z, the lowest point of each on the floor."""
    rest_offset = body_skeleton(skeleton).rest_offset
    position = np.zeros((model.frames, len(model.card["reads"]), 3))
    rotation = quaternion_identity(np.zeros((*position.shape[:-1], 4)))
    noises = sample_noise(model, count, rng)
    rotations = np.stack([model.body(position, rotation, 0.0, noise, rest_offset)[1] for noise in noises])
    pose = whole_pose(skeleton, np.zeros((count, 3)), rotations)
    lowest = forward_kinematics(pose)[0][..., 1].min(axis=-1)
    return replace(pose, root_position=np.stack([np.zeros(count), -lowest, np.zeros(count)], axis=-1))
