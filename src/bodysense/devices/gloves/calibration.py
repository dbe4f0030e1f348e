"""Calibration of a hand and its glove from a few seconds of markers: least squares with the family of hands as prior.

The unknowns are the parameters of the hand (`body.hand_family`), the position of each marker on it, and the pose of
every frame (`least_squares`). Residuals are the distances of markers, the normal parameters, and weak priors of poses.
The priors are usual poses at first. For the standard markers they are then the angles that the joint network predicts
for the hand found so far, because coordinated joints reveal bone lengths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bodysense.body.hands.glove import Glove, glove_of, hand_size, marker_offsets
from bodysense.body.hands.glove_set import GloveSet, standard_set
from bodysense.body.hands.hand import FINGERS, FREEDOMS, hand_skeleton
from bodysense.body.hands.hand_family import SHAPE, GlovedHand, HandShapes, bare_shapes_of
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.hand_model import (
    ANGLES,
    POSE,
    MarkedHand,
    limit_residuals,
    postures,
    usual_residuals,
)
from bodysense.devices.gloves.joints import JointReader
from bodysense.devices.gloves.least_squares import LeastSquares
from bodysense.devices.gloves.networks import HandNetwork, load_joint_network
from bodysense.errors import BodysenseError
from bodysense.geometry.products import exp, to_matrix
from bodysense.geometry.registration import register, to_hand

FRAMES = 32  # frames in the fit, as different as possible
FEWEST = 6  # usable frames, with three quarters of the markers and the back of the hand
_SEEN = 0.75  # share of the markers in a usable frame
_MARKER = 0.0015  # m: standard deviation of a marker from its position on the best hand of the family
_STRAIGHT = 0.12  # rad, standard deviation of a finger's flexion in its straightest frame; three times that at its base
_PREDICTED = 0.2  # rad, standard deviation of an angle from the network's
_ROUNDS, _AGAIN = 2, 12  # runs of the network, and least-squares steps after each
_FAMILY = 0.7  # weight of the family's prior, which comes from few hands; the size has weight 1
_SIZES, _TRIED = (-1.0, 0.5, 2.0), 12  # initial sizes in standard deviations, and steps of each
_STEPS, _DAMPING = 30, 1e-2  # steps of the best size, and Levenberg's initial damping
_SURE = 0.015  # m: markers with a better accuracy than this locate the hand at first
_FITS, _MIRRORED = 0.008, 0.6  # m, largest error of a fitting hand; share of it below which the mirror image fits
_SIZE_PART = 0  # index of the parameter of the hand's size


@dataclass(frozen=True, eq=False)
class HandFit:
    """A calibrated hand."""

    hand: GlovedHand
    error: float  # m, root mean square distance of markers from their positions on the hand
    frames: int  # number of frames in the fit


def fit_hand(markers: np.ndarray, marker_set: GloveSet | None = None, network: HandNetwork | None = None) -> HandFit:
    """Return the most likely hand and glove for markers (T, M, 3) m of a left hand; NaN where missing.

    Needs a flat hand and a fist, or any ten seconds of motion. `marker_set` is the standard one if omitted. `network`
    predicts joints from the standard markers; without it usual poses are assumed. Raises BodysenseError if too few
    markers are seen at once.
    """
    marker_set = standard_set() if marker_set is None else marker_set
    problem = _CalibrationProblem(marker_set, _most_different_frames(markers, marker_set))
    trials = [problem.refine(*problem.start(size), _TRIED) for size in _SIZES]
    theta, pose, _ = problem.refine(*min(trials, key=lambda one: one[2])[:2], _STEPS)
    if network is not None and marker_set.names == standard_set().names:
        for _ in range(_ROUNDS):
            problem = problem.with_network_angles(theta, network)
            theta, pose, _ = problem.refine(theta, pose, _AGAIN)
    residual = (problem.marked.markers(problem.shapes(theta), pose) - problem.seen)[problem.known]
    return HandFit(problem.hand(theta), float(np.sqrt((residual**2).sum(axis=-1).mean())), len(problem.seen))


def enough_frames(markers: np.ndarray, marker_set: GloveSet | None = None) -> bool:
    """Whether `fit_hand` can use enough frames of markers (T, M, 3)."""
    return len(_usable_frames(markers, marker_set or standard_set())) >= FEWEST


def checked_fit(markers: np.ndarray, marker_set: GloveSet, name: str) -> HandFit:
    """Run `fit_hand` on the hand `name`; raise BodysenseError, with the fix, if no hand with this marker set fits."""
    try:
        found = fit_hand(markers, marker_set, load_joint_network())
    except np.linalg.LinAlgError:
        raise BodysenseError(f"the {name} glove: its markers fit no hand; check --marker-set and --unit") from None
    if marker_set.names == standard_set().names or found.error < _FITS:
        return found
    if fit_hand(markers * [-1.0, 1.0, 1.0], marker_set).error < _MIRRORED * found.error:
        raise BodysenseError(
            f"the {name} glove looks like a hand only in a mirror: if the axes are left-handed (Unity, Unreal), give "
            "--left-handed; otherwise left and right are swapped in its --marker-set"
        )
    raise BodysenseError(
        f"the {name} glove: the best hand misses its markers by {100 * found.error:.1f} cm; check that its "
        f"--marker-set ({marker_set.name!r}) has them on the right segments, and check --unit"
    )


@dataclass(frozen=True, eq=False)
class _CalibrationProblem:
    """Cost function; its parameters are `SHAPE` numbers of the hand, then three for every marker."""

    marker_set: GloveSet
    seen: np.ndarray  # (K, M, 3) m, NaN where missing
    predicted: np.ndarray | None = (
        None  # (K, 26) rad, angles predicted by a network; NaN in frames without a prediction
    )

    @cached_property
    def known(self) -> np.ndarray:
        """(K, M) bool: the marker is seen."""
        return ~np.isnan(self.seen[..., 0])

    @cached_property
    def marked(self) -> MarkedHand:
        """Attachments of the markers to the hand."""
        return MarkedHand.of(glove_of(self.marker_set, hand_skeleton(default_skeleton(), "left")))

    @cached_property
    def _marker_priors(self) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (M, 3) m of the markers in the set, and their accuracy (M, 3) m, in the axes of their segments."""
        rows = self.marker_set.markers
        return np.array([row.offset for row in rows]), np.array([row.accuracy for row in rows])

    def shapes(self, theta: np.ndarray) -> HandShapes:
        """Return hands and their marker positions from parameters (..., N)."""
        rest, axes = bare_shapes_of(theta[..., :SHAPE])
        offset, accuracy = self._marker_priors
        size = np.linalg.norm(rest[..., _MIDDLE, :].sum(axis=-2), axis=-1)[..., None, None] / _DEFAULT_SIZE
        own = size * (offset + accuracy * theta[..., SHAPE:].reshape(*theta.shape[:-1], -1, 3))
        return HandShapes(rest, axes, marker_offsets(self.marker_set, rest, axes, own))

    def hand(self, theta: np.ndarray) -> GlovedHand:
        """Return the hand with parameters (N,)."""
        shapes = self.shapes(theta)
        hand = hand_skeleton(default_skeleton(), "left").with_offsets(shapes.rest)
        points, carriers = zip(*((row.near, row.segment) for row in self.marker_set.markers), strict=True)
        return GlovedHand(
            hand, shapes.axes, Glove(self.marker_set.names, points, carriers, shapes.markers, hand_size(hand))
        )

    def start(self, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Return initial parameters (N,) and poses (K, 32).

        Wrists are registered to accurate markers on the back of the hand. Without three of these, the posture that
        fits best decides.
        """
        theta = np.zeros(SHAPE + 3 * len(self.marker_set.markers))
        theta[_SIZE_PART] = size
        sure = np.array([max(row.accuracy) <= _SURE for row in self.marker_set.markers])
        back = self.marked.on_hand
        poses = np.zeros((len(self.seen), len(postures()), POSE))
        poses[..., :ANGLES] = postures()  # the first is relaxed
        if (back & sure).sum() >= 3:
            return theta, self._register(theta, poses[:, :1], back)[:, 0]
        if back.sum() >= 3:
            theta = self._move_plate(theta, self._closest_poses(theta, self._register(theta, poses, sure), sure), sure)
            poses = self._register(theta, poses, back)
        else:
            poses = self._register(theta, poses, sure)
        return theta, self._closest_poses(theta, poses, sure)

    def _register(self, theta: np.ndarray, poses: np.ndarray, by: np.ndarray) -> np.ndarray:
        return self.marked.register_wrists(self.shapes(theta), poses, self.seen, self.known & by)

    def _closest_poses(self, theta: np.ndarray, poses: np.ndarray, by: np.ndarray) -> np.ndarray:
        return self.marked.closest_poses(self.shapes(theta), poses, self.seen, self.known & by)

    def _move_plate(self, theta: np.ndarray, pose: np.ndarray, sure: np.ndarray) -> np.ndarray:
        """Move inaccurate markers to their positions in the frames whose posture fits best; return parameters."""
        far = self.marked.markers(self.shapes(theta), pose) - np.nan_to_num(self.seen)
        use = self.known & sure
        cost = ((far**2).sum(axis=-1) * use).sum(axis=1) / np.maximum(use.sum(axis=1), 1)
        best = np.argsort(cost)[: max(len(cost) // 4, 3)]
        turn = to_matrix(exp(pose[best, -6:-3]))
        own = to_hand(self.seen[best], turn, pose[best, -3:])
        shapes, (offset, accuracy) = self.shapes(theta), self._marker_priors
        after = theta.copy()
        for k in np.flatnonzero(~sure & self.marked.on_hand & self.known[best].any(axis=0)):
            attachment = self.marked.markers(shapes, np.zeros(POSE))[k] - shapes.markers[k]
            place = np.nanmedian(own[:, k], axis=0) - attachment
            size = hand_size(self.hand(theta).skeleton) / _DEFAULT_SIZE
            after[SHAPE + 3 * k : SHAPE + 3 * k + 3] = (place / size - offset[k]) / accuracy[k]
        return after

    @cached_property
    def straight(self) -> np.ndarray:
        """(K, 26) weights of a prior of 0 for the angles of straight fingers, in standard deviations per radian."""
        weight = np.zeros((len(self.seen), ANGLES))
        for number, tip in enumerate(self.marked.farthest):
            if tip is None or not self.known[:, tip].any():
                continue
            frame = int(np.nanargmax(_reach(self.seen, self.marked)[:, number]))
            for place, row in enumerate(FREEDOMS):
                if row.angle == "flexion" and row.joint.startswith(FINGERS[number]) and row.joint != "thumb1":
                    weight[frame, place] = 1 / (_STRAIGHT * (3.0 if row.joint.endswith("1") else 1.0))
        return weight

    @cached_property
    def prior(self) -> np.ndarray:
        """(N,) weights of the parameters' prior, in standard deviations per unit."""
        believed = np.full(SHAPE + 3 * len(self.marker_set.markers), 1.0)
        believed[:SHAPE] = _FAMILY
        believed[_SIZE_PART] = 1.0
        return believed

    def with_network_angles(self, theta: np.ndarray, network: HandNetwork) -> _CalibrationProblem:
        """Return the problem with a network's angles for a hand of these parameters, in frames with all markers."""
        whole, hand = self.known.all(axis=1), self.hand(theta)
        count, predicted = int(whole.sum()), np.full((len(self.seen), ANGLES), np.nan)
        if count:
            axes = np.broadcast_to(hand.axes, (count, *hand.axes.shape))
            reader = JointReader(network, (hand.skeleton,) * count, (hand.glove,) * count, axes=axes)
            predicted[whole] = reader.angles(self.seen[whole])
        return replace(self, predicted=predicted)

    def refine(self, theta: np.ndarray, pose: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Return parameters, poses and their cost after at most `steps` steps."""
        return LeastSquares(self.residuals, self.prior).refine(theta, pose, steps, _DAMPING)

    def residuals(self, theta: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return residuals (..., K, R) of every frame, in standard deviations, without those of the parameters."""
        far = self.marked.markers(self.shapes(theta), pose) - np.nan_to_num(self.seen)
        residual = np.where(self.known[..., None], far, 0.0) / _MARKER
        usual, angles = usual_residuals(pose), pose[..., :ANGLES]
        if self.predicted is not None:
            strange = np.where(np.isnan(self.predicted), 0.0, angles - self.predicted) / _PREDICTED
            usual = np.concatenate([np.where(np.isnan(self.predicted[:, :1]), usual, 0.0), strange], axis=-1)
        prior = np.concatenate([limit_residuals(pose), usual, angles * self.straight], axis=-1)
        prior = np.broadcast_to(prior, (*residual.shape[:-2], prior.shape[-1]))
        return np.concatenate([residual.reshape(*residual.shape[:-2], -1), prior], axis=-1)


_HAND = hand_skeleton(default_skeleton(), "left")
_DEFAULT_SIZE = hand_size(_HAND)
_MIDDLE = _HAND.indices(["middle1", "middle2", "middle3", "middle_tip"])


def _usable_frames(markers: np.ndarray, marker_set: GloveSet) -> np.ndarray:
    """Return the frames with enough markers, enough of them on the back of the hand."""
    known, back = ~np.isnan(markers[..., 0]), list(marker_set.on_hand)
    enough = known.sum(axis=1) >= np.ceil(_SEEN * len(marker_set.markers))
    return np.flatnonzero((known[:, back].sum(axis=1) >= min(3, len(back))) & enough)


def _most_different_frames(markers: np.ndarray, marker_set: GloveSet) -> np.ndarray:
    """Return the frames (K, M, 3) that differ most in shape, among those with enough markers."""
    good = _usable_frames(markers, marker_set)
    if len(good) < FEWEST:
        raise BodysenseError(
            f"gloves: {len(good)} frames have {np.ceil(_SEEN * len(marker_set.markers)):g} markers of a hand, with its "
            f"back; calibrating needs {FEWEST}: hold the hand flat, then make a fist, in view of every camera"
        )
    some = markers[good[np.unique(np.linspace(0, len(good) - 1, 2000).astype(int))]]
    back = np.zeros(some.shape[:2], dtype=bool)
    # the markers that align frames: those on the back of the hand, or all if there are fewer than three
    back[:, list(marker_set.on_hand if len(marker_set.on_hand) >= 3 else range(len(marker_set.markers)))] = True
    back &= ~np.isnan(some[..., 0])
    whole = int((~np.isnan(some[..., 0])).sum(axis=1).argmax())
    use = back & ~np.isnan(some[whole, :, 0])
    own = to_hand(some, *register(np.nan_to_num(some[whole]), some, use))
    own = np.nan_to_num(own).reshape(len(some), -1)
    marked = MarkedHand.of(glove_of(marker_set, _HAND))
    chosen = sorted(set(np.nan_to_num(_reach(some, marked), nan=-1.0).argmax(axis=0).tolist()))
    far = np.min([np.linalg.norm(own - own[one], axis=1) for one in chosen], axis=0)
    while len(chosen) < min(FRAMES, len(some)):
        chosen.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(own - own[chosen[-1]], axis=1))
    return some[chosen]


def _reach(markers: np.ndarray, marked: MarkedHand) -> np.ndarray:
    """Return the distance (K, 5) m of fingers' farthest markers from the back of the hand; NaN if not seen."""
    back = np.nanmean(np.where(marked.on_hand[:, None], markers, np.nan), axis=1)
    away = [np.full(len(markers), np.nan) if k is None else markers[:, k] - back for k in marked.farthest]
    return np.stack([np.linalg.norm(one, axis=-1) if one.ndim == 2 else one for one in away], axis=1)
