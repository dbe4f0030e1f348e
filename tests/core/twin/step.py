"""The step: frames of one person in, whole bodies out."""

from dataclasses import dataclass
from importlib.resources import files
from math import nan
from pathlib import Path

import numpy as np

from bodysense.body.person import Person
from bodysense.geometry.rotation import matrix_to_quaternion
from bodysense.observing.observation import Observation
from bodysense.tracking.tracker import TrackerSettings

from . import mounts, proportions
from .clock import interval_of
from .errors import expected_errors
from .fingers import complete_fingers
from .layers import tables
from .network import Memory, first_memory, predict
from .points import PARENT, PELVIS
from .pose import pose_body, pose_finish, pose_read
from .state import PoseState
from .tracked import choose_base, gather

WEIGHTS = Path(str(files("bodysense.weights") / "completion.safetensors"))


@dataclass(frozen=True)
class Completed:
    """A completed body in one frame."""

    rotation: np.ndarray  # (52, 4) parent ← joint; the root's is world ← root
    points: np.ndarray  # (65, 3) m, world
    measured: np.ndarray  # (65,) bool
    confidence: np.ndarray  # (65,) m
    bound: np.ndarray  # (65,) m
    contact: np.ndarray  # (4,) probability
    rest_offset: np.ndarray  # (65, 3) m


class Twin:
    """Completes the body of one person, frame after frame."""

    def __init__(self, person: Person, settings: TrackerSettings, weights: Path = WEIGHTS) -> None:
        self.person, self.settings, self.tables = person, settings, tables(weights)
        self.time, self.base = nan, np.zeros(3)
        self.proportions = proportions.first_proportions(person)
        self.mounts = mounts.first_mounts(person)
        self.memory, self.pose = self._start()

    def _start(self) -> tuple[Memory, PoseState]:
        return first_memory(self.tables), PoseState()

    def step(self, observation: Observation, t: int, core: tuple[list[np.ndarray], np.ndarray]) -> Completed:
        """Complete frame t of an observation; `core`: the states of the core's recurrent layers after it."""
        settings, own, floor = self.settings, self.proportions, self.settings.floor
        interval, fresh = interval_of(settings, float(observation.time[t]), self.time)
        if fresh:  # after a gap forget the motion, but keep the person
            self.base = choose_base(observation, t, floor)
            self.memory, self.pose = self._start()
        self.time, self.memory.core = float(observation.time[t]), core
        seen = gather(observation, t, self.base, interval, floor)
        mounts.apply(self.person, seen)
        if settings.infer:
            mounts.step(self.person, interval, self.mounts, seen)
            proportions.step(self.person, seen, interval, own)
        seen.rest_offset, seen.deviation = own.current, own.deviation
        pose_read(settings, seen, self.pose)

        predicted, head = predict(self.tables, seen, self.memory)
        body = pose_body(settings, seen, predicted, self.pose)
        finger_error = complete_fingers(self.tables, seen, head, body, self.memory)
        off = pose_finish(seen, self.pose, body)
        confidence, bound = expected_errors(self.tables, seen, predicted, finger_error, off)
        local = body.rotation[PARENT[: len(body.rotation)]].transpose(0, 2, 1) @ body.rotation
        local[PELVIS] = body.rotation[PELVIS]
        return Completed(
            rotation=matrix_to_quaternion(local),
            points=seen.base + body.point,
            measured=seen.has_position,
            confidence=confidence,
            bound=bound,
            contact=predicted.contact,
            rest_offset=own.current,
        )
