"""The three-point network's file, and what it answers of a frame, at any frame rate.

It learned time steps down to a shortest one. Where frames come faster, each goes on from the newest memory that is so
old: at 90 Hz, with a network for 45, from that of the second last frame. Such sequences take turns and differ a little,
so the answers of the frames in between are averaged.

Many wearers are asked about in one run: the weights are read once for all, and each answer is the one it has alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.completion.network import Network, NetworkFormat
from bodysense.errors import BodysenseError
from bodysense.estimators.whole_body import WholeBody

FORMAT = "bodysense three-point 1"
PACKAGED = "three_point.onnx"
NETWORK = NetworkFormat(
    name=FORMAT,
    kind="three-point network",
    command="bodysense train three-point",
    fields=("joints", "contact", "fastest_rate", "state"),
    packaged=PACKAGED,
)
FIRST_INTERVAL = 1 / 60  # s: the time step of a frame that has none before it
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
_HEAD = BODY.index("head")


@dataclass(frozen=True)
class ThreePointModel:
    """A network that completes a body of head and hands."""

    network: Network  # for one wearer
    path: Path | None = None  # None: the packaged file

    @cached_property
    def network_of_many(self) -> Network:
        """The network for any number of wearers. Raises BodysenseError for a file that is for one alone."""
        network = Network.open(self.path, NETWORK)
        if not network.batched:
            raise BodysenseError(
                f"{self.name} answers one wearer at a time; free its batch axis with `scripts/free_batch_axis.py`"
            )
        return network

    @property
    def name(self) -> str:
        """Its file's name."""
        return self.network.name

    @property
    def card(self) -> Mapping[str, Any]:
        """What its file says of it."""
        return self.network.card

    @cached_property
    def shortest(self) -> float:
        """The shortest time step that it takes, s: a little shorter than it learned, for clocks that tremble."""
        return 0.9 / float(self.card["fastest_rate"])

    @cached_property
    def unknowing(self) -> dict[str, np.ndarray]:
        """Its state before the first frame."""
        return self.network.start()


def load_three_point(path: str | Path | None = None) -> ThreePointModel:
    """Load a network: a path, or None for the packaged one. Raises BodysenseError for a file that is not ours."""
    place = None if path is None else Path(path)
    return ThreePointModel(Network.open(place, NETWORK, batch=1), place)


@dataclass(frozen=True, eq=False)
class Answer:
    """The network's answer of one frame, in the world; of one wearer, or of many (…)."""

    rotation: np.ndarray  # (…, 22, 4) wxyz, world ← joint
    position: np.ndarray  # (…, 22, 3) m
    error: np.ndarray  # (…, 22) m
    contact: np.ndarray  # (…, 2, 2) probability: of ankle and ball of left and right foot

    def __getitem__(self, key: int) -> Answer:
        """That of one wearer among many."""
        return Answer(self.rotation[key], self.position[key], self.error[key], self.contact[key])


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
    wearers: dict[str, np.ndarray],
    position: np.ndarray,
    rotation: np.ndarray,
    measured: np.ndarray,
    now: Sequence[float],
    memories: Sequence[tuple[Memory, ...]],
) -> tuple[Answer, list[Memory]]:
    """The network on one frame of each of B wearers.

    Args:
        model: The network.
        wearers: Its inputs that never change: rest offsets (B, 22, 3) m and height (B,) m.
        position, rotation: (B, 3, 3) m and (B, 3, 4) wxyz of head and hands, finite.
        measured: (B, 2, 2) bool: of each hand, position and rotation.
        now: s, B of them.
        memories: The first of them is gone on from; none before the first frame. Of every wearer.

    Returns the answers (B, …) and every wearer's memory of it.
    """
    networks = [before[0].network if before else model.unknowing for before in memories]
    elapsed = [t - before[0].time if before else FIRST_INTERVAL for t, before in zip(now, memories, strict=True)]
    place, turn = position.astype(np.float32), rotation.astype(np.float32)
    place[:, 1:][~measured[..., 0]] = 0.0
    turn[:, 1:][~measured[..., 1]] = UPRIGHT
    inputs = {
        "position": place[:, None],
        "rotation": turn[:, None],
        "has_position": measured[:, None, :, 0],
        "has_rotation": measured[:, None, :, 1],
        "interval": np.array(elapsed, dtype=np.float32)[:, None],
        **wearers,
    }
    state = {name: np.concatenate([network[name] for network in networks]) for name in model.unknowing}
    network = model.network if len(memories) == 1 else model.network_of_many
    said, after = network.step(inputs, state)
    answer = Answer(
        rotation=said["body_rotation"][:, 0].astype(float),
        position=said["body_position"][:, 0].astype(float),
        error=said["body_error"][:, 0].astype(float),
        contact=said["body_contact"][:, 0].astype(float).reshape(-1, 2, 2).transpose(0, 2, 1),
    )
    kept = [Memory(t, {name: rows[k : k + 1] for name, rows in after.items()}, answer[k]) for k, t in enumerate(now)]
    return answer, kept


def steadied(answer: Answer, before: Sequence[tuple[Memory, ...]], head: np.ndarray, body: WholeBody) -> Answer:
    """The mean of answers (B, …) and those of the frames just before, of bodies whose heads are at `head` (B, 3) m."""
    longest = max(map(len, before))
    if not longest:
        return answer
    count = np.ones(len(before))
    rotation, contact = answer.rotation.copy(), answer.contact.copy()
    for age in range(longest):
        earlier = [memories[age].answer for memories in before if len(memories) > age]
        everybody = len(earlier) == len(before)
        rows = slice(None) if everybody else [k for k, memories in enumerate(before) if len(memories) > age]
        others = np.array([one.rotation for one in earlier])
        sign = np.copysign(1.0, np.einsum("kji,kji->kj", others, answer.rotation[rows]))
        rotation[rows] += others * sign[..., None]
        contact[rows] += np.array([one.contact for one in earlier])
        count[rows] += 1
    rotation /= np.sqrt(np.einsum("kji,kji->kj", rotation, rotation))[..., None]
    position = body.placed_joints(rotation)
    position += (head - position[:, _HEAD])[:, None]
    alone = count == 1
    if alone.any():  # they stay as they are, to the bit
        rotation[alone], position[alone] = answer.rotation[alone], answer.position[alone]
    return Answer(rotation, position, answer.error, contact / count[:, None, None])


def without_head(memory: Memory) -> Memory:
    """The memory of a head that leapt: its way from there is no velocity."""
    fresh = memory.network["state_fresh"].copy()
    fresh[:, 0] = False
    return memory._replace(network=memory.network | {"state_fresh": fresh})
