"""A network at run time: one exported file, carried state, ONNX Runtime on one thread."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.observation import Estimate, Observation, observed_points

FORMAT = "bodysense body 1"
MEASURED_ERROR = 0.002  # m: what is expected of a tracked point


@dataclass(frozen=True)
class LearnedState:
    """What the network remembers, and when it last took a frame in."""

    network: dict[str, np.ndarray]
    time: float | None
    head_position: np.ndarray  # (3,) m
    head_rotation: np.ndarray  # (4,) wxyz


@dataclass(frozen=True)
class Model:
    """A loaded network file: its session and what it says of itself."""

    session: Any  # onnxruntime.InferenceSession
    card: dict[str, Any]
    name: str


def load_model(path: str | Path | None = None) -> Model:
    """Load a network: a path, or None for the packaged one. Raises BodysenseError for a file that is not ours."""
    if path is None:
        with as_file(files("bodysense.weights").joinpath("body_gru.onnx")) as packaged:
            return load_model(packaged)
    import onnxruntime

    path = Path(path)
    if not path.is_file():
        raise BodysenseError(f"{path}: no such model file; give the .onnx that `bodysense train` wrote")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime raises classes of its own for every way a file can be wrong
        raise BodysenseError(f"{path}: not a readable ONNX model ({str(error).splitlines()[0][:120]})") from None
    card = session.get_modelmeta().custom_metadata_map
    if card.get("format") != FORMAT:
        raise BodysenseError(
            f"{path}: not a bodysense body network (format {card.get('format', 'not given')!r}, wanted {FORMAT!r}); "
            "give the .onnx that `bodysense train body-gru` wrote"
        )
    missing = [key for key in ("points", "rate", "fastest_rate", "state") if key not in card]
    if missing:
        raise BodysenseError(f"{path}: its card has no {missing[0]!r}; export the network again")
    return Model(session, {key: card_field(value) for key, value in card.items() if key != "format"}, path.name)


def card_field(text: str) -> Any:
    """A field of a card: JSON where we wrote it, plain text where another tool did."""
    try:
        return json.loads(text)
    except ValueError:
        return text


@dataclass(frozen=True)
class Learned:
    """A trained network on the wearer's skeleton, which must have the points that the network was trained on.

    The network steps at its own rate. A frame that comes sooner is completed from the state of the last step and does
    not advance it, so that any input rate, also an irregular one, is answered at once and at every frame.
    """

    model: Model
    skeleton: Skeleton

    def __post_init__(self) -> None:
        wanted = tuple(self.model.card["points"])
        if self.skeleton.points != wanted:
            odd = sorted(set(wanted) ^ set(self.skeleton.points)) or ["their order"]
            raise BodysenseError(
                f"{self.model.name} completes a skeleton of {len(wanted)} points; the one given has "
                f"{len(self.skeleton.points)} (differs in {', '.join(odd[:3])}): bring the motion to the default "
                "skeleton with `bodysense.data.canonical`"
            )

    @cached_property
    def _constants(self) -> dict[str, np.ndarray]:
        return {
            "bone_length": self.skeleton.bone_length.astype(np.float32)[None],
            "height": np.array([self.skeleton.height], dtype=np.float32),
        }

    @cached_property
    def _step_interval(self) -> float:
        """s between steps of the network; a frame a little early still counts."""
        return 0.8 / float(self.model.card["fastest_rate"])

    @cached_property
    def _outputs(self) -> list[str]:
        return [output.name for output in self.model.session.get_outputs()]

    def start(self) -> LearnedState:
        """Nothing seen yet: a standing body that faces +Z."""
        standing, _ = forward_kinematics(standing_pose(self.skeleton))
        state = {
            name.removeprefix("state_"): np.array(row["values"], dtype=row["dtype"]).reshape(row["shape"])
            if "values" in row
            else np.zeros(row["shape"], dtype=row["dtype"])
            for name, row in self.model.card["state"].items()
        }
        identity = np.array([1.0, 0.0, 0.0, 0.0])
        return LearnedState(state, None, standing[self.skeleton.index("head")], identity)

    def step(self, observation: Observation, state: LearnedState) -> tuple[Estimate, LearnedState]:
        """Complete T frames, one after the other."""
        position, rotation, has_position, has_rotation = observed_points(observation, self.skeleton)
        head = self.skeleton.index("head")
        guesses, hidden, errors = [], [], []
        for t, time in enumerate(observation.time):
            state = LearnedState(
                state.network,
                state.time,
                position[t, head] if has_position[t, head] else state.head_position,
                rotation[t, head] if has_rotation[t, head] else state.head_rotation,
            )
            answer, state = self._run(position[t], has_position[t], float(time), state)
            for row, name in ((guesses, "completed"), (hidden, "occluded"), (errors, "error")):
                row.append(answer[name][0, 0])
        seen = has_position[..., None]
        estimate = Estimate(
            skeleton=self.skeleton,
            position=np.where(seen, position, np.stack(guesses)),
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
        feed = {
            "position": position[None, None].astype(np.float32),
            "visible": visible[None, None],
            "head_position": state.head_position[None, None].astype(np.float32),
            "head_rotation": state.head_rotation[None, None].astype(np.float32),
            "interval": np.array([[elapsed]], dtype=np.float32),
            **self._constants,
        }
        feed |= {f"state_{name}": value for name, value in state.network.items()}
        answer = dict(zip(self._outputs, self.model.session.run(None, feed), strict=True))
        if state.time is None or elapsed >= self._step_interval:
            after = {name: answer[f"next_{name}"] for name in state.network}
            state = replace(state, network=after, time=time)
        return answer, state
