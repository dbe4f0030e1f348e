"""Gap fillers for hidden markers: one interface, and they stack (two-hands, section 3.2; reproduce.md 4.5, 4.6).

A gap filler works in the frame of its markers and replaces NaN in its input. NaN remains if it cannot fill a marker.
State is an argument. The paper's baselines are in `bodysense_lab.papers.two_hands.score.baselines`. Filled markers do
not jump when they become hidden; `blending` handles jumps when they are found again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from bodysense.body.hands.glove import Glove, default_glove, template
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.networks import HandNetwork, known_shapes, size_ratios
from bodysense.errors import BodysenseError
from bodysense.geometry.registration import register, to_hand, to_world
from bodysense.geometry.rotation import smooth_step

MARKER_COUNT = 9
# s, half-life of a network's error. Values hardly differ on drawn hands: the mean error is 0.70 cm at 1 s, 0.68 at 2
# and 4 s, 0.69 at 8 s, 0.71 without fading (docs/gloves.md). This is the longest within 2 % of the best, because
# recorded hands differ more from the training hands than drawn ones.
FADING = 8.0


class GapFiller(Protocol):
    """A method that fills hidden markers."""

    def start(self, hands: int) -> Any:
        """Return the state of this many hands before the first frame."""
        ...

    def fill(self, markers: np.ndarray, interval: float, state: Any) -> tuple[np.ndarray, Any]:
        """Fill markers (H, 9, 3) m, NaN where missing, `interval` s after the last frame; return them and the state."""
        ...


def missing(markers: np.ndarray) -> np.ndarray:
    """Return (H, 9) bool: the marker is missing."""
    return np.isnan(markers[..., 0])


class NetworkState(NamedTuple):
    """The last registration of the hand, the last frame, and the network's errors of hidden markers."""

    rotation: np.ndarray  # (H, 3, 3)
    translation: np.ndarray  # (H, 3) m
    known: np.ndarray  # (H, 9) bool
    filled: np.ndarray  # (H, 9, 3) m
    error: np.ndarray  # (H, 9, 3) m, on the registered hand; 0 for known markers


@dataclass(frozen=True, eq=False)
class NetworkGapFiller:
    """Gap filler by a network that predicts all markers of the registered hand from the known ones (4.6, 3.2.2).

    `hands` are left-model hands, one for each hand of a batch or one for all. `gloves` are their gloves, the default
    one if omitted. Fills hands with at least `fewest` known markers. When a marker becomes hidden, the network's error
    there is subtracted from later predictions, so that the marker does not jump (Figure 8). Half of the error fades in
    `fading` s; the paper keeps all of it (None).
    """

    model: HandNetwork
    hands: Sequence[Skeleton]
    gloves: Sequence[Glove] = ()
    fading: float | None = FADING
    fewest: int = 3

    def __post_init__(self) -> None:
        if self.fading is not None and not self.fading > 0:
            raise BodysenseError(f"network gap filler: fading is {self.fading:g}; it must be positive, or None")
        if not 1 <= self.fewest <= 4:
            raise BodysenseError(f"network gap filler: fewest is {self.fewest}; give 1, 2, 3 or 4 markers")
        if len(self.gloves) not in (0, len(self.hands)):
            raise BodysenseError(
                f"network gap filler: {len(self.hands)} hands and {len(self.gloves)} gloves; give one for each hand, "
                "or none"
            )

    @cached_property
    def _gloves(self) -> Sequence[Glove]:
        return self.gloves or (default_glove(),) * len(self.hands)

    @cached_property
    def _template(self) -> np.ndarray:
        """Markers (H, 9, 3) m of the flat hands."""
        return np.stack([template(glove, hand) for glove, hand in zip(self._gloves, self.hands, strict=True)])

    @cached_property
    def _ratio(self) -> np.ndarray:
        """(H, 1, 1) sizes of the hands relative to the default one."""
        return size_ratios(self.hands)[:, None, None]

    @cached_property
    def _shapes(self) -> np.ndarray:
        return known_shapes(self.hands, self._gloves)

    def start(self, hands: int) -> NetworkState:
        """Return the state without registration. Raises BodysenseError for another number of hands than `hands`."""
        if len(self.hands) not in (1, hands):
            raise BodysenseError(
                f"network gap filler: made for {len(self.hands)} hands, started for {hands}; give the same number"
            )
        nothing = np.full((hands, MARKER_COUNT, 3), np.nan)
        turn = np.broadcast_to(np.eye(3), (hands, 3, 3))
        return NetworkState(turn, np.zeros((hands, 3)), ~missing(nothing), nothing, np.zeros_like(nothing))

    def fill(self, markers: np.ndarray, interval: float, state: NetworkState) -> tuple[np.ndarray, NetworkState]:
        """See `GapFiller`."""
        known = ~missing(markers)
        if known.all():
            return markers, NetworkState(*state[:2], known, markers, np.zeros_like(markers))
        error = state.error if self.fading is None else state.error * 0.5 ** (interval / self.fading)
        common, lost = known & state.known, state.known & ~known
        if lost.any():  # fill lost markers where they were
            guess, at = self._predict(state.filled, common, state[:2])
            previous_error = to_hand(state.filled, *at) - guess
            error = np.where((self._enough(common) & lost.any(axis=1))[:, None, None], previous_error, error)
        guess, at = self._predict(markers, known, state[:2])
        if error.any() and (common != known).any():  # found markers must not move the filled ones
            fewer, from_common = self._predict(markers, common, state[:2])
            kept = to_hand(to_world(fewer + error, *from_common), *at) - guess
            kept *= self._enough(common)[:, None, None]
            shorter = np.linalg.norm(kept, axis=-1) < np.linalg.norm(error, axis=-1)
            error = np.where(shorter[..., None], kept, error)
        error = np.where(known[..., None] | np.isnan(error), 0.0, error)
        enough = self._enough(known)[:, None, None]
        filled = np.where(known[..., None], markers, np.where(enough, to_world(guess + error, *at), np.nan))
        return filled, NetworkState(*at, known, filled, error)

    def _enough(self, known: np.ndarray) -> np.ndarray:
        """Return (H,) whether enough of the markers (H, 9) are known."""
        return known.sum(axis=1) >= self.fewest

    def _predict(
        self, markers: np.ndarray, known: np.ndarray, last: tuple[np.ndarray, np.ndarray]
    ) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Return the network's markers (H, 9, 3) m on the registered hand, and that hand's rotation and translation."""
        at = register(self._template, markers, known, last)
        local = np.where(known[..., None], to_hand(markers, *at) / self._ratio, 0.0)
        shapes = self._shapes.repeat(len(markers) // len(self._shapes), axis=0)
        answer = self.model.run(local.astype(np.float32).reshape(len(markers), -1), shapes)
        return answer.reshape(-1, MARKER_COUNT, 3) * self._ratio, at


class ShapeState(NamedTuple):
    """The last complete frame, the last frame with a seen marker, and the time since then."""

    shape: np.ndarray  # (H, 9, 3) m
    lost: np.ndarray  # (H, 9, 3) m
    unseen: np.ndarray  # (H,) s


@dataclass(frozen=True, eq=False)
class RigidGapFiller:
    """Gap filler that keeps the hand's last shape and moves it rigidly onto the known markers.

    A hand without any seen marker stays in place for `hold` s, then relaxes to its `natural` shape (H, 9, 3) m within
    `relaxing` s while the back of the hand stays in place. A hand that was never seen has the natural shape, at the
    origin.
    """

    natural: np.ndarray
    hold: float = 0.5
    relaxing: float = 1.0

    def start(self, hands: int) -> ShapeState:
        """Return the natural shape as the state."""
        shape = np.array(np.broadcast_to(self.natural, (hands, MARKER_COUNT, 3)))
        return ShapeState(shape, shape, np.zeros(hands))

    def fill(self, markers: np.ndarray, interval: float, state: ShapeState) -> tuple[np.ndarray, ShapeState]:
        """See `GapFiller`."""
        hidden = missing(markers)
        if not hidden.any():
            return markers, ShapeState(markers, markers, np.zeros(len(markers)))
        known = ~hidden
        rotation, translation = register(state.shape, markers, known)
        guess = to_world(state.shape, rotation, translation)
        unseen = np.where(known.any(axis=1), 0.0, state.unseen + interval)
        lost = np.where(unseen[:, None, None] > 0, state.lost, guess)
        if (unseen > self.hold).any():
            guess = np.where(unseen[:, None, None] > 0, self._relax(lost, unseen), guess)
        filled = np.where(known[..., None], markers, guess)
        return filled, ShapeState(filled, np.where(unseen[:, None, None] > 0, lost, filled), unseen)

    def _relax(self, lost: np.ndarray, unseen: np.ndarray) -> np.ndarray:
        """Return markers (H, 9, 3) m, interpolated between the lost shape and the natural one."""
        back = np.zeros(lost.shape[:2], dtype=bool)
        back[:, :3] = True  # the alignment markers
        natural = np.broadcast_to(self.natural, lost.shape)
        rest = to_world(natural, *register(natural, lost, back))
        share = np.clip((unseen - self.hold) / self.relaxing, 0.0, 1.0)
        return lost + smooth_step(share)[:, None, None] * (rest - lost)


@dataclass(frozen=True)
class GapFillerStack:
    """Gap fillers in sequence: each fills markers that are still missing."""

    gap_fillers: tuple[GapFiller, ...]

    def start(self, hands: int) -> tuple[Any, ...]:
        """Return the state of each gap filler."""
        return tuple(gap_filler.start(hands) for gap_filler in self.gap_fillers)

    def fill(self, markers: np.ndarray, interval: float, state: tuple[Any, ...]) -> tuple[np.ndarray, tuple[Any, ...]]:
        """See `GapFiller`."""
        after = []
        for gap_filler, one in zip(self.gap_fillers, state, strict=True):
            markers, new = gap_filler.fill(markers, interval, one)
            after.append(new)
        return markers, tuple(after)
