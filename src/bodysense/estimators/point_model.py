"""A network that places points, at run time: one exported file, carried state, ONNX Runtime on one thread."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bodysense.body.resting import resting_offset
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.estimators.network_file import open_network, open_packaged

FORMAT = "bodysense points 1"
Task = Literal["fingers", "upper-body"]
PACKAGED: dict[Task, str] = {"fingers": "fingers.onnx", "upper-body": "upper_body.onnx"}
WARM_UP = 15  # steps on the first frame, so that the answer does not move while the memory fills
_FIELDS = ("task", "reads", "places", "rate", "state")


@dataclass(frozen=True)
class PointModel:
    """A loaded network file: its session and what it says of itself."""

    session: Any  # onnxruntime.InferenceSession
    card: dict[str, Any]
    name: str

    @cached_property
    def reads(self) -> tuple[str, ...]:
        """The points whose position it reads."""
        return tuple(self.card["reads"])

    @cached_property
    def places(self) -> tuple[str, ...]:
        """The points that it places."""
        return tuple(self.card["places"])

    @cached_property
    def inputs(self) -> frozenset[str]:
        """What the exported graph takes; an input that the network does not need is not in it."""
        return frozenset(value.name for value in self.session.get_inputs())

    @cached_property
    def step_interval(self) -> float:
        """s between steps of the network; a frame a little early still counts."""
        return 0.8 / float(self.card["rate"])


@dataclass(frozen=True)
class PointState:
    """What the network remembers, and when it last took a frame in."""

    memory: np.ndarray
    time: float | None = None


def load_point_model(task: Task, path: str | Path | None = None) -> PointModel:
    """Load the network of a task: a path, or None for the packaged one.

    Raises BodysenseError for a file that is not ours, or of another task.
    """
    command = f"bodysense train {task}"
    wanted: dict[str, Any] = {"format": FORMAT, "kind": "network of points", "fields": _FIELDS, "command": command}
    name = PACKAGED[task] if path is None else Path(path).name
    session, card = open_packaged(name, **wanted) if path is None else open_network(path, **wanted)
    if card["task"] != task:
        raise BodysenseError(
            f"{path or name}: a network for {card['task']}, not {task}; give the .onnx that `{command}` wrote"
        )
    return PointModel(session, card, name)


@dataclass(frozen=True)
class PointRunner:
    """A loaded network on one wearer's skeleton. Raises BodysenseError where that lacks a point of the network's."""

    model: PointModel
    skeleton: Skeleton

    def __post_init__(self) -> None:
        wanted = (*self.model.reads, *self.model.places)
        missing = [name for name in wanted if name not in self.skeleton.points]
        if missing or len(self.skeleton.points) != int(self.model.card["points"]):
            raise BodysenseError(
                f"{self.model.name} needs a skeleton of {self.model.card['points']} points; the one given has "
                f"{len(self.skeleton.points)}{f' and no {missing[0]}' if missing else ''}: bring the motion to the "
                "default skeleton with `bodysense.data.canonical`"
            )

    @cached_property
    def _constants(self) -> dict[str, np.ndarray]:
        rest = resting_offset(self.skeleton)[self.skeleton.indices(self.model.places)]
        return {
            "rest": rest.astype(np.float32)[None],
            "bone_length": self.skeleton.bone_length.astype(np.float32)[None],
            "height": np.array([self.skeleton.height], dtype=np.float32),
        }

    def start(self) -> PointState:
        """The state before the first frame."""
        row = self.model.card["state"]
        return PointState(np.zeros(row["shape"], dtype=row["dtype"]))

    def step(
        self, position: np.ndarray, rotation: np.ndarray, time: float, state: PointState
    ) -> tuple[np.ndarray, np.ndarray, PointState]:
        """One frame: positions (R, 3) m of the points that are read, rotations (3, 4) of head and wrists, all world.

        Returns positions (O, 3) m, expected errors (O,) m, and the state, which advances only when a step is due.
        """
        feed = {
            "position": position[None, None].astype(np.float32),
            "rotation": rotation[None, None].astype(np.float32),
            **self._constants,
        }
        feed = {name: value for name, value in feed.items() if name in self.model.inputs}
        memory = state.memory
        if state.time is None:
            for _ in range(WARM_UP):
                memory = self.model.session.run(["next_memory"], feed | {"state_memory": memory})[0]
        answer = self.model.session.run(["placed", "error", "next_memory"], feed | {"state_memory": memory})
        placed, error, memory = answer
        if state.time is None or time - state.time >= self.model.step_interval:
            state = replace(state, memory=memory, time=time)
        return placed[0, 0].astype(float), error[0, 0].astype(float), state
