"""Virtual markers: gloves of any marker set give the hand's pose, and from it positions of the standard markers.

The networks, rejection and gap filling support the standard markers only. A calibrated hand (`calibration`) has the
positions of its own markers. In every frame its pose is fitted by least squares, starting from the last one, and
standard markers are computed from it. A standard marker is hidden if too few of the markers near it are seen: a
fingertip's if the nearest marker of its finger is hidden, those on the back of the hand if fewer than three markers
there are seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import MARKERS, glove_of, glove_points, side_of
from bodysense.body.hands.glove_set import standard_set
from bodysense.body.hands.hand import mirrored_vectors
from bodysense.body.hands.hand_family import GlovedHand, HandShapes
from bodysense.devices.gloves.hand_model import MarkedHand, postures, prior_residuals
from bodysense.devices.gloves.least_squares import LeastSquares
from bodysense.io.markers.raw_markers import points_alone
from bodysense.observing.observation import Observation, accuracy_like
from bodysense.observing.points import chosen_points, joined_points

_MARKER = 0.002  # m: standard deviation of a marker from its position on the hand
_WRONG = 0.015  # m: a marker this far from its position on the hand has half weight and does not count as seen
_FIRST, _DAMPING = 30, 1e-3  # steps for a new hand (a followed one takes two), and Levenberg's initial damping
_FEWEST = 3  # markers needed to solve a hand
_FORGOTTEN = 1.0  # s after which an unseen hand is solved from scratch


class SolvedHand(NamedTuple):
    """The last pose of a hand."""

    pose: np.ndarray | None = None  # (32,); None: never seen
    time: float = -np.inf  # s, time of that pose


@dataclass(frozen=True, eq=False)
class VirtualGlove:
    """Standard markers of one left hand from its own markers."""

    hand: GlovedHand  # calibrated, with its own markers

    @cached_property
    def standard(self) -> GlovedHand:
        """The hand with the standard markers."""
        skeleton, axes = self.hand.skeleton, self.hand.axes
        return GlovedHand(skeleton, axes, glove_of(standard_set(), skeleton, axes))

    @cached_property
    def _own(self) -> tuple[MarkedHand, HandShapes]:
        return _numbers(self.hand)

    @cached_property
    def _standard_markers(self) -> tuple[MarkedHand, HandShapes]:
        return _numbers(self.standard)

    @cached_property
    def _evidence(self) -> tuple[np.ndarray, np.ndarray]:
        """Mask (9, M) of own markers that determine each standard one, and how many of them (9,) must be seen."""
        own, standard = self._own[0].attachments, self._standard_markers[0].attachments
        evidence, fewest = np.zeros((len(standard), len(own)), dtype=bool), np.ones(len(standard), dtype=int)
        for row, marker in enumerate(standard):
            if marker.carrier < 0:
                evidence[row] = self._own[0].on_hand
                fewest[row] = min(3, max(int(evidence[row].sum()), 1))
                continue
            near = {k: abs(p.point - marker.point) for k, p in enumerate(own) if p[::2] != (-1, -1)}
            near = {k: far for k, far in near.items() if own[k].finger == marker.finger and own[k].carrier >= 0}
            evidence[row, [k for k, far in near.items() if far == min(near.values())]] = True
        return evidence, fewest

    def step(self, seen: np.ndarray, now: float, state: SolvedHand) -> tuple[np.ndarray, SolvedHand]:
        """Return standard markers (9, 3) m from own markers (M, 3) m at `now` s, and the state; NaN where hidden."""
        known = ~np.isnan(seen[:, 0])
        hidden = np.full((len(MARKERS), 3), np.nan)
        if known.sum() < _FEWEST:
            return hidden, state
        pose, weight = self._solve(seen, known, None if now - state.time > _FORGOTTEN else state.pose)
        evidence, fewest = self._evidence
        determined = (evidence & known & (weight > 0.5)).sum(axis=1) >= fewest
        marked, shapes = self._standard_markers
        return np.where(determined[:, None], marked.markers(shapes, pose), hidden), SolvedHand(pose, now)

    def _solve(self, seen: np.ndarray, known: np.ndarray, last: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Return the pose (32,), and the weight of each marker (M,)."""
        marked, shapes = self._own
        tried = last[None] if last is not None else np.concatenate([postures(), np.zeros((len(postures()), 6))], axis=1)
        back = known & marked.on_hand
        by = back if back.sum() >= 3 else known
        target, use = np.where(known[:, None], seen, 0.0), known.astype(float)
        poses = marked.register_wrists(shapes, tried[None], target[None], by[None])[0]
        if last is None:
            if by is back:  # the wrist is reliable
                poses = marked.closest_poses(shapes, poses[None], target[None], known[None])
            fit = self._fit(target, use)
            fits = [fit.refine(np.zeros(0), pose[None], _FIRST, _DAMPING) for pose in poses]
            pose = min(fits, key=lambda one: one[2])[1][0]
        else:
            pose = self._step(poses[0], target, use)
        pose = self._step(pose, target, self._weights(pose, target, known))
        return pose, self._weights(pose, target, known)

    def _step(self, pose: np.ndarray, target: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Return a pose (32,) after one step."""
        return self._fit(target, weight).step(np.zeros(0), pose[None], _DAMPING)[1][0]

    def _weights(self, pose: np.ndarray, target: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Return weights (M,), smaller for markers far from their positions on the hand."""
        marked, shapes = self._own
        far = np.linalg.norm(marked.markers(shapes, pose) - target, axis=-1)
        return known / (1 + (far / _WRONG) ** 4)

    def _fit(self, target: np.ndarray, weight: np.ndarray) -> LeastSquares:
        """Return the least-squares problem of a frame's pose, without common parameters."""
        marked, shapes = self._own

        def residuals(_: np.ndarray, pose: np.ndarray) -> np.ndarray:
            residual = (marked.markers(shapes, pose) - target) * np.sqrt(weight)[:, None] / _MARKER
            return np.concatenate([residual.reshape(*residual.shape[:-2], -1), prior_residuals(pose)], axis=-1)

        return LeastSquares(residuals, np.zeros(0))


@dataclass(frozen=True, eq=False)
class VirtualMarkers:
    """Replacement of the markers of named hands by standard ones. Immutable; state is an argument."""

    gloves: Mapping[str, VirtualGlove]

    def start(self) -> tuple[SolvedHand, ...]:
        """Return the state before the first frame."""
        return (SolvedHand(),) * len(self.gloves)

    def step(
        self, observation: Observation, state: tuple[SolvedHand, ...]
    ) -> tuple[Observation, tuple[SolvedHand, ...]]:
        """Replace the points '<hand>_glove_…' of these hands by standard ones in T frames; others are unchanged."""
        others = [k for k, name in enumerate(observation.points) if name.partition("_glove_")[0] not in self.gloves]
        after, columns, time = [], [], observation.time
        index = {name: k for k, name in enumerate(observation.points)}
        for (hand, glove), last in zip(self.gloves.items(), state, strict=True):
            place = [index.get(f"{hand}_glove_{name}", -1) for name in glove.hand.glove.markers]
            known = observation.has_position[:, place] & (np.array(place) >= 0)
            seen = mirrored_vectors(np.where(known[..., None], observation.position[:, place], np.nan), side_of(hand))
            virtual, solved = np.empty((len(observation), len(MARKERS), 3)), last
            for frame, now in enumerate(time.tolist()):
                virtual[frame], solved = glove.step(seen[frame], now, solved)
            after.append(solved)
            columns.append(mirrored_vectors(virtual, side_of(hand)))
        points = tuple(point for hand in self.gloves for point in glove_points(hand))
        standard = points_alone(points, np.concatenate(columns, axis=1), time)
        standard = replace(standard, accuracy=accuracy_like(standard.has_position, _MARKER))
        return joined_points(chosen_points(observation, others), standard), tuple(after)


def is_standard(hand: GlovedHand) -> bool:
    """Whether a hand has the standard markers."""
    return hand.glove.markers == MARKERS


def _numbers(hand: GlovedHand) -> tuple[MarkedHand, HandShapes]:
    shapes = HandShapes(hand.skeleton.rest_offset, hand.axes, hand.glove.offset_on(hand.skeleton))
    return MarkedHand.of(hand.glove), shapes
