"""Two other networks that fill markers, for comparison: one sees both hands of a person, one remembers.

Both are two-hands' own outlook (section 8): a network of two interacting hands, and a recurrent one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bodysense.body.glove import default_glove, template
from bodysense.body.registration import brought_back, moved, register
from bodysense.body.skeleton import Skeleton
from bodysense.completion.network import Network, NetworkFormat
from bodysense.devices.gloves.fillers import MARKER_COUNT, missing
from bodysense.devices.gloves.networks import known_shapes, size_ratios
from bodysense.errors import BodysenseError

TWO_HANDS_FORMAT = "bodysense glove two hands 1"
MEMORY_FORMAT = "bodysense glove memory 1"
TWO_HANDS_NETWORK, MEMORY_NETWORK = "glove_two_hands.onnx", "glove_recurrent.onnx"
_MIRROR = np.array([-1.0, 1.0, 1.0])  # from one hand's world to the other's (`body.hand`)


class PlacedHands(NamedTuple):
    """Where hands were registered last, and what a network remembers of them."""

    rotation: np.ndarray  # (H, 3, 3)
    translation: np.ndarray  # (H, 3) m
    memory: dict[str, np.ndarray]  # (H, …) by input of the graph; empty for a network that remembers nothing


@dataclass(frozen=True, eq=False)
class _Registered:
    """What both fillers share: hands of known size, registered by the markers that are seen."""

    network: Network
    hands: Sequence[Skeleton]

    @cached_property
    def _template(self) -> np.ndarray:
        """(H, 9, 3) m."""
        return np.stack([template(default_glove(), hand) for hand in self.hands])

    @cached_property
    def _ratio(self) -> np.ndarray:
        return size_ratios(self.hands)[:, None, None]

    @cached_property
    def _shapes(self) -> np.ndarray:
        return known_shapes(self.hands, [default_glove()] * len(self.hands))

    def start(self, hands: int) -> PlacedHands:
        """Registered nowhere, nothing remembered."""
        if hands != len(self.hands):
            raise BodysenseError(f"glove filler: made for {len(self.hands)} hands, started for {hands}; give as many")
        eye = np.broadcast_to(np.eye(3), (hands, 3, 3))
        return PlacedHands(eye, np.zeros((hands, 3)), self.network.start(hands))

    def axes(self, markers: np.ndarray, state: PlacedHands) -> np.ndarray:
        """Those of the registered hand."""
        return state.rotation

    def _placed(self, markers: np.ndarray, state: PlacedHands) -> tuple[np.ndarray, np.ndarray]:
        return register(self._template, markers, ~missing(markers), state[:2])

    def _own(self, markers: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
        """Markers (H, 9, 3) of the world as networks read them: (H, 27), 0 where missing."""
        local = np.nan_to_num(brought_back(markers, rotation, translation) / self._ratio)
        return local.reshape(len(markers), -1).astype(np.float32)

    def _world(
        self, markers: np.ndarray, told: np.ndarray, rotation: np.ndarray, translation: np.ndarray
    ) -> np.ndarray:
        """Markers with what a network told (H, 27) in place of what is missing."""
        guess = moved(told.reshape(-1, MARKER_COUNT, 3) * self._ratio, rotation, translation)
        return np.where(np.isnan(markers), guess, markers)


class TwoHandsFiller(_Registered):
    """Fills a hand's markers from those of both: hands come in pairs, left then right, each in its mirrored world."""

    def fill(self, markers: np.ndarray, interval: float, state: PlacedHands) -> tuple[np.ndarray, PlacedHands]:
        """See `Filler`."""
        rotation, translation = self._placed(markers, state)
        beside = _MIRROR * markers.reshape(-1, 2, MARKER_COUNT, 3)[:, ::-1].reshape(markers.shape)
        own, other = (self._own(points, rotation, translation) for points in (markers, beside))
        (told,) = self.network.run({"markers": own, "hand": self._shapes, "other": other}).values()
        return self._world(markers, told, rotation, translation), PlacedHands(rotation, translation, state.memory)


class MemoryFiller(_Registered):
    """Fills markers from those that are seen and those that were."""

    def fill(self, markers: np.ndarray, interval: float, state: PlacedHands) -> tuple[np.ndarray, PlacedHands]:
        """See `Filler`."""
        rotation, translation = self._placed(markers, state)
        own = self._own(markers, rotation, translation)
        outputs, memory = self.network.step({"markers": own, "hand": self._shapes}, state.memory)
        (told,) = outputs.values()
        return self._world(markers, told, rotation, translation), PlacedHands(rotation, translation, memory)


def load_two_hands(path: str | Path, hands: Sequence[Skeleton]) -> TwoHandsFiller:
    """The filler of a network file for pairs of hands. Raises BodysenseError for a file that is not ours."""
    command = "bodysense train gloves --network two-hands"
    return TwoHandsFiller(Network.open(path, NetworkFormat(TWO_HANDS_FORMAT, "two-hand network", command)), hands)


def load_memory(path: str | Path, hands: Sequence[Skeleton]) -> MemoryFiller:
    """The filler of a recurrent network's file. Raises BodysenseError for a file that is not ours."""
    command = "bodysense train gloves --network recurrent"
    format = NetworkFormat(MEMORY_FORMAT, "recurrent glove network", command, ("memory",))
    return MemoryFiller(Network.open(path, format), hands)
