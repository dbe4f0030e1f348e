"""The step without its logic: what the networks read, remember and give, on the bodies that the core outputs."""

from dataclasses import dataclass
from importlib.resources import files
from math import nan
from pathlib import Path

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.geometry.rotation import quaternion_to_matrix
from bodysense.observing.observation import Observation
from bodysense.tracking.estimate import Estimate
from bodysense.tracking.tracker import TrackerSettings

from .body import Body
from .clock import interval_of
from .errors import expected_errors
from .fingers import complete_fingers
from .layers import tables
from .network import Memory, first_memory, predict
from .points import HAND_JOINTS, HEAD, JOINTS, PARENT
from .tracked import choose_base, course_of, find_knuckles, gather, imply_rotations, place_head, read_head

WEIGHTS = Path(str(files("bodysense.weights") / "completion.safetensors"))


@dataclass(frozen=True)
class Read:
    """Outputs of the networks in one frame."""

    contact: np.ndarray  # (4,) probability
    fingers: np.ndarray  # (30, 3, 3) parent ← joint
    confidence: np.ndarray  # (65,) m
    bound: np.ndarray  # (65,) m


class Twin:
    """Evaluates the networks of one person, frame after frame."""

    def __init__(self, settings: TrackerSettings, weights: Path = WEIGHTS) -> None:
        self.settings, self.tables = settings, tables(weights)
        self.time, self.base = nan, np.zeros(3)
        self.memory, self.before, self.course = self._start()

    def _start(self) -> tuple[Memory, np.ndarray | None, np.ndarray]:
        return first_memory(self.tables), None, np.zeros(3)

    def step(
        self,
        observation: Observation,
        t: int,
        person: Person,
        estimate: Estimate,
        core: tuple[list[np.ndarray], np.ndarray],
    ) -> Read:
        """Evaluate frame t.

        The core gives `person` and `estimate` (1 frame), with the bones in use and the output body, and `core`, the
        states of the recurrent layers after it.
        """
        interval, fresh = interval_of(self.settings, float(observation.time[t]), self.time)
        if fresh:
            self.base = choose_base(observation, t, self.settings.floor)
            self.memory, self.before, self.course = self._start()
        self.time, self.memory.core = float(observation.time[t]), core
        seen = gather(observation, t, self.base, interval, self.settings.floor)
        seen.rest_offset, seen.deviation = estimate.rest_offset[0], person.bone_deviation
        find_knuckles(seen)
        imply_rotations(seen)
        place_head(seen, self.before)
        measured = seen.has_rotation[HEAD], seen.rotation[HEAD].copy()
        read_head(seen, self.course)
        predicted, head = predict(self.tables, seen, self.memory)
        seen.has_rotation[HEAD], seen.rotation[HEAD] = measured
        body = Body(
            quaternion_to_matrix(np.asarray(forward_kinematics(estimate.pose)[1])[0]), estimate.points[0] - self.base
        )
        off = np.where(seen.has_position, np.linalg.norm(seen.position - body.point, axis=-1), 0)
        velocity = np.zeros(3) if self.before is None else (body.point - self.before)[HEAD] / interval
        self.course, self.before = course_of(seen, velocity, self.course), body.point.copy()
        finger_error = complete_fingers(self.tables, seen, head, body, self.memory)
        confidence, bound = expected_errors(self.tables, seen, predicted, finger_error, off)
        joints = np.concatenate(HAND_JOINTS)
        local = body.rotation[PARENT[:JOINTS][joints]].transpose(0, 2, 1) @ body.rotation[joints]
        return Read(predicted.contact, local, confidence, bound)
