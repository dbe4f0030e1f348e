"""Inputs of an earlier version's ONNX graph of the tracker's step, to compare its time with the core's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bodysense.body.person import Person
from bodysense.body.skeleton import default_skeleton
from bodysense.observing.observation import INERTIAL_POINTS, Observation
from bodysense.weights.network import Network, NetworkFormat

POINTS, JOINTS = len(default_skeleton().points), len(default_skeleton().joints)
_FIRST, _LONGEST = 1 / 30, 0.1  # s, interval before the first frame, and the longest interval
_ABSENT = 0.001  # m, accuracy of untracked points; any positive number will do

FORMAT = "bodysense-completion-1"
GRAPH = NetworkFormat(
    name=FORMAT,
    kind="completion graph",
    command="git show 1d879b8:src/bodysense/weights/completion.onnx > completion.onnx",
)


def open_graph(path: Path) -> Network:
    """Open a graph's file. Raises BodysenseError for any other file."""
    return Network.open(path, GRAPH)


def graph_inputs(observation: Observation, people: Sequence[Person]) -> Iterator[dict[str, np.ndarray]]:
    """Yield the graph's inputs for each frame of an observation (B, T, P) of people with constant proportions."""
    count = len(people)
    place = default_skeleton().indices(observation.points)
    joint = np.flatnonzero(place < JOINTS)
    fixed = {
        "rest_offset": np.array([person.skeleton.rest_offset for person in people], np.float32),
        "certainty": np.array([person.bone_deviation for person in people], np.float32),
        "floor": np.zeros(count, np.float32),
        "hold": np.ones(count, np.float32),
    }
    intervals = np.minimum(np.diff(observation.time, prepend=observation.time[0] - _FIRST), _LONGEST)
    for t in range(len(observation)):
        seen, turned = observation.has_position[:, t], observation.has_rotation[:, t][:, joint]
        position, rotation = np.zeros((count, POINTS, 3), np.float32), np.zeros((count, JOINTS, 4), np.float32)
        has_position, has_rotation = np.zeros((count, POINTS), bool), np.zeros((count, JOINTS), bool)
        accuracy = np.full((count, POINTS), _ABSENT, np.float32)
        rotation[..., 0] = 1.0
        position[:, place] = np.where(seen[..., None], observation.position[:, t], 0.0)
        rotation[:, place[joint]] = np.where(turned[..., None], observation.rotation[:, t][:, joint], [1.0, 0, 0, 0])
        has_position[:, place], has_rotation[:, place[joint]] = seen, turned
        accuracy[:, place] = np.where(seen, observation.accuracy[:, t], _ABSENT)
        strapped = [observation.points.index(name) for name in INERTIAL_POINTS if name in observation.points]
        sensor_rows = [INERTIAL_POINTS.index(observation.points[point]) for point in strapped]
        acceleration = np.zeros((count, len(INERTIAL_POINTS), 3), np.float32)
        has_acceleration = np.zeros((count, len(INERTIAL_POINTS)), bool)
        if observation.acceleration is not None and strapped:
            acceleration_rows = observation.acceleration[:, t][:, strapped]
            has_acceleration[:, sensor_rows] = np.isfinite(acceleration_rows).all(axis=-1)
            acceleration[:, sensor_rows] = np.nan_to_num(acceleration_rows)
        yield {
            "acceleration": acceleration,
            "has_acceleration": has_acceleration,
            "position": position,
            "rotation": rotation,
            "has_position": has_position,
            "has_rotation": has_rotation,
            "accuracy": accuracy,
            "interval": np.full(count, intervals[t], np.float32),
            **fixed,
        }
