"""The three-point network's file, and what it answers of a frame, at any frame rate.

It learned time steps down to a shortest one. Where frames come faster, each goes on from the newest memory that is so
old: at 90 Hz, with a network for 45, from that of the second last frame. Such sequences take turns and differ a little,
so the answers of the frames in between are averaged.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.estimators.network_file import open_network, open_packaged
from bodysense.estimators.whole_body import WholeBody

FORMAT = "bodysense three-point 1"
PACKAGED = "three_point.onnx"
FIRST_INTERVAL = 1 / 60  # s: the time step of a frame that has none before it
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
_HEAD = BODY.index("head")


@dataclass(frozen=True)
class ThreePointModel:
    """A loaded network file: its session and what it says of itself."""

    session: Any  # onnxruntime.InferenceSession
    card: dict[str, Any]
    name: str

    @cached_property
    def outputs(self) -> list[str]:
        """Names of what it answers."""
        return [output.name for output in self.session.get_outputs()]

    @cached_property
    def shortest(self) -> float:
        """The shortest time step that it takes, s: a little shorter than it learned, for clocks that tremble."""
        return 0.9 / float(self.card["fastest_rate"])

    @cached_property
    def unknowing(self) -> dict[str, np.ndarray]:
        """Its state before the first frame."""
        return {
            name: np.array(row["values"], dtype=row["dtype"]).reshape(row["shape"])
            if "values" in row
            else np.zeros(row["shape"], dtype=row["dtype"])
            for name, row in self.card["state"].items()
        }


def load_three_point(path: str | Path | None = None) -> ThreePointModel:
    """Load a network: a path, or None for the packaged one. Raises BodysenseError for a file that is not ours."""
    wanted: dict[str, Any] = {
        "format": FORMAT,
        "kind": "three-point network",
        "fields": ("joints", "contact", "fastest_rate", "state"),
        "command": "bodysense train three-point",
    }
    if path is None:
        return ThreePointModel(*open_packaged(PACKAGED, **wanted), PACKAGED)
    return ThreePointModel(*open_network(path, **wanted), Path(path).name)


@dataclass(frozen=True, eq=False)
class Answer:
    """The network's answer of one frame, in the world."""

    rotation: np.ndarray  # (22, 4) wxyz, world ← joint
    position: np.ndarray  # (22, 3) m
    error: np.ndarray  # (22,) m
    contact: np.ndarray  # (2, 2) probability: of ankle and ball of left and right foot


class Memory(NamedTuple):
    """What the network knew after a frame, and what it said."""

    time: float  # s, of that frame
    network: dict[str, np.ndarray]
    answer: Answer


def recalled(model: ThreePointModel, memories: tuple[Memory, ...], now: float) -> tuple[Memory, ...]:
    """Of memories, oldest first, the one that a frame at `now` s goes on from, and those that are too new for that."""
    while len(memories) > 1 and now - memories[1].time >= model.shortest:
        memories = memories[1:]
    return memories


def ask(
    model: ThreePointModel,
    wearer: dict[str, np.ndarray],
    head: tuple[np.ndarray, np.ndarray],
    position: np.ndarray,
    rotation: np.ndarray,
    measured: np.ndarray,
    now: float,
    memories: tuple[Memory, ...],
) -> tuple[Answer, Memory]:
    """The network on one frame.

    Args:
        model: The network.
        wearer: Its inputs that never change: rest offsets and height.
        head: (3,) m and (4,) wxyz.
        position, rotation: (2, 3) m and (2, 4) wxyz of the hands, finite.
        measured: (2, 2) bool: of each hand, position and rotation.
        now: s.
        memories: The first of them is gone on from; none before the first frame.
    """
    network = memories[0].network if memories else model.unknowing
    elapsed = now - memories[0].time if memories else FIRST_INTERVAL
    place, turn = np.zeros((1, 1, 3, 3), dtype=np.float32), np.zeros((1, 1, 3, 4), dtype=np.float32)
    place[0, 0, 0], turn[0, 0, 0] = head
    place[0, 0, 1:] = np.where(measured[:, :1], position, 0.0)
    turn[0, 0, 1:] = np.where(measured[:, 1:], rotation, UPRIGHT)
    feed = {
        "position": place,
        "rotation": turn,
        "has_position": measured[None, None, :, 0],
        "has_rotation": measured[None, None, :, 1],
        "interval": np.array([[elapsed]], dtype=np.float32),
        **wearer,
        **{f"state_{name}": value for name, value in network.items()},
    }
    said = dict(zip(model.outputs, model.session.run(None, feed), strict=True))
    answer = Answer(
        rotation=said["body_rotation"][0, 0].astype(float),
        position=said["body_position"][0, 0].astype(float),
        error=said["body_error"][0, 0].astype(float),
        contact=said["body_contact"][0, 0].astype(float).reshape(2, 2).T,
    )
    return answer, Memory(now, {name: said[f"next_{name}"] for name in network}, answer)


def steadied(answer: Answer, before: tuple[Memory, ...], head: np.ndarray, body: WholeBody) -> Answer:
    """The mean of an answer and those of the frames just before, of a body whose head is at `head` (3,) m."""
    if not before:
        return answer
    rotations = np.stack([answer.rotation, *(memory.answer.rotation for memory in before)])
    rotations *= np.copysign(1.0, np.einsum("kji,ji->kj", rotations, answer.rotation))[..., None]
    mean = rotations.sum(axis=0)
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    position = body.placed(np.zeros(3), mean)[0][body.joints]
    contact = np.mean([answer.contact, *(memory.answer.contact for memory in before)], axis=0)
    return Answer(mean, position + (head - position[_HEAD]), answer.error, contact)


def without_head(memory: Memory) -> Memory:
    """The memory of a head that leapt: its way from there is no velocity."""
    fresh = memory.network["fresh"].copy()
    fresh[:, 0] = False
    return memory._replace(network=memory.network | {"fresh": fresh})
