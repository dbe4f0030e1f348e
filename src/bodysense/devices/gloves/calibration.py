"""A hand and its glove from a few seconds of markers: least squares with the family of hands as prior.

The unknowns are the parameters of the hand (`body.hand_family`) and the position of each marker of its set, common to
all frames, and a pose of every frame (`least_squares`). Residuals are the distances of markers, normal parameters, and
weak priors of poses: usual poses first; then, for the standard markers, the joint network's angles for the hand found
so far, because coordinated joints reveal bone lengths.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bodysense.body.glove import Glove, glove_of, hand_size, worn_offsets
from bodysense.body.glove_set import GloveSet, standard_set
from bodysense.body.hand import FINGERS, FREEDOMS, hand_skeleton
from bodysense.body.hand_family import SHAPE, GlovedHand, HandShapes, bare_shapes_of
from bodysense.body.products import exp, to_matrix
from bodysense.body.registration import brought_back, register
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.hand_model import (
    ANGLES,
    POSE,
    MarkedHand,
    hardly_possible,
    postures,
    unusual,
)
from bodysense.devices.gloves.joints import JointReader
from bodysense.devices.gloves.least_squares import LeastSquares
from bodysense.devices.gloves.networks import HandNetwork, load_joint_network
from bodysense.errors import BodysenseError

FRAMES = 32  # frames in the fit, as different as possible
FEWEST = 6  # usable frames, with three quarters of the markers and the back of the hand
_SEEN = 0.75  # share of the markers in a usable frame
_MARKER = 0.0015  # m: standard deviation of a marker from its position on the best hand of the family
_STRAIGHT = 0.12  # rad, flexion from 0 of a finger where it reaches farthest; three times that at its base
_TOLD = 0.2  # rad: standard deviation of an angle from the network's
_ROUNDS, _AGAIN = 2, 12  # runs of the network, and steps after each
_FAMILY = 0.7  # weight of the family's prior, which comes from few hands; the size has weight 1
_SIZES, _TRIED = (-1.0, 0.5, 2.0), 12  # initial sizes in standard deviations, and steps of each
_STEPS, _DAMPING = 30, 1e-2  # steps of the best one; Levenberg's damping at first
_SURE = 0.015  # m: markers placed more accurately than this locate the hand at first
_FITS, _MIRRORED = 0.008, 0.6  # m: largest error of a fitting hand; its share in a mirror
_SIZE_PART = 0  # the parameter that is the hand's size


@dataclass(frozen=True, eq=False)
class HandFit:
    """A calibrated hand."""

    hand: GlovedHand
    error: float  # m, root mean square distance of markers from their positions on the hand
    frames: int  # in the fit


def fit_hand(markers: np.ndarray, worn: GloveSet | None = None, network: HandNetwork | None = None) -> HandFit:
    """Return the likeliest hand and glove of markers (T, M, 3) m, as of a left hand; NaN where missing.

    Needs a flat hand and a fist, or any ten seconds of motion. `worn` is their set, the standard one if omitted;
    `network` predicts joints from the standard markers; without it usual poses are assumed. Raises BodysenseError if
    too few markers are seen at once.
    """
    problem = _CalibrationProblem(standard_set() if worn is None else worn, _different(markers, worn or standard_set()))
    begun = [problem.refined(*problem.start(size), _TRIED) for size in _SIZES]
    theta, pose, _ = problem.refined(*min(begun, key=lambda one: one[2])[:2], _STEPS)
    if network is not None and problem.worn.names == standard_set().names:
        for _ in range(_ROUNDS):
            problem = problem.with_told(theta, network)
            theta, pose, _ = problem.refined(theta, pose, _AGAIN)
    missed = (problem.marked.markers(problem.shapes(theta), pose) - problem.seen)[problem.known]
    return HandFit(problem.hand(theta), float(np.sqrt((missed**2).sum(axis=-1).mean())), len(problem.seen))


def enough_frames(markers: np.ndarray, worn: GloveSet | None = None) -> bool:
    """Whether `fit_hand` can use enough frames of markers (T, M, 3)."""
    return len(_good(markers, worn or standard_set())) >= FEWEST


def checked_fit(markers: np.ndarray, worn: GloveSet, name: str) -> HandFit:
    """Run `fit_hand` on the hand `name`; raises BodysenseError, with the fix, if no hand of this set fits."""
    try:
        found = fit_hand(markers, worn, load_joint_network())
    except np.linalg.LinAlgError:
        raise BodysenseError(f"the {name} glove: its markers are of no hand; see its --marker-set, --unit") from None
    if worn.names == standard_set().names or found.error < _FITS:
        return found
    if fit_hand(markers * [-1.0, 1.0, 1.0], worn).error < _MIRRORED * found.error:
        raise BodysenseError(
            f"the {name} glove looks like a hand only in a mirror: if the axes are left-handed (Unity, Unreal), give "
            "--left-handed; otherwise its --marker-set takes left for right"
        )
    raise BodysenseError(
        f"the {name} glove: the best hand misses its markers by {100 * found.error:.1f} cm; see that its --marker-set "
        f"({worn.name!r}) has them on the right segments, and --unit"
    )


@dataclass(frozen=True, eq=False)
class _CalibrationProblem:
    """The cost function: parameters are `SHAPE` numbers of the hand, then three of every marker."""

    worn: GloveSet
    seen: np.ndarray  # (K, M, 3) m, NaN where missing
    told: np.ndarray | None = None  # (K, 26) rad, angles predicted by a network; NaN where it has none

    @cached_property
    def known(self) -> np.ndarray:
        """(K, M) bool."""
        return ~np.isnan(self.seen[..., 0])

    @cached_property
    def marked(self) -> MarkedHand:
        """The markers on the hand."""
        return MarkedHand.of(glove_of(self.worn, hand_skeleton(default_skeleton(), "left")))

    @cached_property
    def _given(self) -> tuple[np.ndarray, np.ndarray]:
        """Offsets (M, 3) m of the markers in the set, and their accuracy (M, 3) m, in the axes of their segments."""
        rows = self.worn.markers
        return np.array([row.offset for row in rows]), np.array([row.accuracy for row in rows])

    def shapes(self, theta: np.ndarray) -> HandShapes:
        """Return hands and their marker positions from parameters (..., N)."""
        rest, axes = bare_shapes_of(theta[..., :SHAPE])
        offset, accuracy = self._given
        size = np.linalg.norm(rest[..., _MIDDLE, :].sum(axis=-2), axis=-1)[..., None, None] / _DEFAULT_SIZE
        own = size * (offset + accuracy * theta[..., SHAPE:].reshape(*theta.shape[:-1], -1, 3))
        return HandShapes(rest, axes, worn_offsets(self.worn, rest, axes, own))

    def hand(self, theta: np.ndarray) -> GlovedHand:
        """Return the hand of parameters (N,)."""
        shapes = self.shapes(theta)
        hand = hand_skeleton(default_skeleton(), "left").with_offsets(shapes.rest)
        points, carriers = zip(*((row.near, row.segment) for row in self.worn.markers), strict=True)
        return GlovedHand(hand, shapes.axes, Glove(self.worn.names, points, carriers, shapes.worn, hand_size(hand)))

    def start(self, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Return parameters (N,), and poses (K, 32), placed by accurate markers on the back, else by posture."""
        theta = np.zeros(SHAPE + 3 * len(self.worn.markers))
        theta[_SIZE_PART] = size
        sure = np.array([max(row.accuracy) <= _SURE for row in self.worn.markers])
        back = self.marked.on_hand
        poses = np.zeros((len(self.seen), len(postures()), POSE))
        poses[..., :ANGLES] = postures()  # the first is relaxed
        if (back & sure).sum() >= 3:
            return theta, self._placed(theta, poses[:, :1], back)[:, 0]
        if back.sum() >= 3:
            theta = self._plated(theta, self._best(theta, self._placed(theta, poses, sure), sure), sure)
            poses = self._placed(theta, poses, back)
        else:
            poses = self._placed(theta, poses, sure)
        return theta, self._best(theta, poses, sure)

    def _placed(self, theta: np.ndarray, poses: np.ndarray, by: np.ndarray) -> np.ndarray:
        return self.marked.placed(self.shapes(theta), poses, self.seen, self.known & by)

    def _best(self, theta: np.ndarray, poses: np.ndarray, by: np.ndarray) -> np.ndarray:
        return self.marked.best(self.shapes(theta), poses, self.seen, self.known & by)

    def _plated(self, theta: np.ndarray, pose: np.ndarray, sure: np.ndarray) -> np.ndarray:
        """Move inaccurate markers to their positions in the frames whose posture fits best; return parameters."""
        far = self.marked.markers(self.shapes(theta), pose) - np.nan_to_num(self.seen)
        use = self.known & sure
        cost = ((far**2).sum(axis=-1) * use).sum(axis=1) / np.maximum(use.sum(axis=1), 1)
        best = np.argsort(cost)[: max(len(cost) // 4, 3)]
        turn = to_matrix(exp(pose[best, -6:-3]))
        own = brought_back(self.seen[best], turn, pose[best, -3:])
        shapes, (offset, accuracy) = self.shapes(theta), self._given
        after = theta.copy()
        for k in np.flatnonzero(~sure & self.marked.on_hand & self.known[best].any(axis=0)):
            place = np.nanmedian(own[:, k], axis=0) - (self.marked.markers(shapes, np.zeros(POSE))[k] - shapes.worn[k])
            size = hand_size(self.hand(theta).skeleton) / _DEFAULT_SIZE
            after[SHAPE + 3 * k : SHAPE + 3 * k + 3] = (place / size - offset[k]) / accuracy[k]
        return after

    @cached_property
    def straight(self) -> np.ndarray:
        """(K, 26) weights, in standard deviations a radian, of angles of straight fingers, which are taken as 0."""
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
        """(N,) weights of the parameters' prior, in standard deviations a unit."""
        believed = np.full(SHAPE + 3 * len(self.worn.markers), 1.0)
        believed[:SHAPE] = _FAMILY
        believed[_SIZE_PART] = 1.0
        return believed

    def with_told(self, theta: np.ndarray, network: HandNetwork) -> _CalibrationProblem:
        """Add a network's angles for a hand of these parameters, in frames with all markers."""
        whole, hand = self.known.all(axis=1), self.hand(theta)
        count, told = int(whole.sum()), np.full((len(self.seen), ANGLES), np.nan)
        if count:
            axes = np.broadcast_to(hand.axes, (count, *hand.axes.shape))
            reader = JointReader(network, (hand.skeleton,) * count, (hand.glove,) * count, axes=axes)
            told[whole] = reader.angles(self.seen[whole])
        return replace(self, told=told)

    def refined(self, theta: np.ndarray, pose: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Return parameters, poses and their cost after at most `steps` steps."""
        return LeastSquares(self.residuals, self.prior).refined(theta, pose, steps, _DAMPING)

    def residuals(self, theta: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return residuals (..., K, R) of every frame, in standard deviations, without those of the parameters."""
        far = self.marked.markers(self.shapes(theta), pose) - np.nan_to_num(self.seen)
        missed = np.where(self.known[..., None], far, 0.0) / _MARKER
        usual, angles = unusual(pose), pose[..., :ANGLES]
        if self.told is not None:
            strange = np.where(np.isnan(self.told), 0.0, angles - self.told) / _TOLD
            usual = np.concatenate([np.where(np.isnan(self.told[:, :1]), usual, 0.0), strange], axis=-1)
        prior = np.concatenate([hardly_possible(pose), usual, angles * self.straight], axis=-1)
        prior = np.broadcast_to(prior, (*missed.shape[:-2], prior.shape[-1]))
        return np.concatenate([missed.reshape(*missed.shape[:-2], -1), prior], axis=-1)


_HAND = hand_skeleton(default_skeleton(), "left")
_DEFAULT_SIZE = hand_size(_HAND)
_MIDDLE = _HAND.indices(["middle1", "middle2", "middle3", "middle_tip"])


def _back(worn: GloveSet) -> list[int]:
    """Return the markers that align frames: those of the back of the hand, or all if these are few."""
    return list(worn.on_hand if len(worn.on_hand) >= 3 else range(len(worn.markers)))


def _good(markers: np.ndarray, worn: GloveSet) -> np.ndarray:
    """Return the frames that show a hand well."""
    known, back = ~np.isnan(markers[..., 0]), list(worn.on_hand)
    enough = known.sum(axis=1) >= np.ceil(_SEEN * len(worn.markers))
    return np.flatnonzero((known[:, back].sum(axis=1) >= min(3, len(back))) & enough)


def _different(markers: np.ndarray, worn: GloveSet) -> np.ndarray:
    """Return the frames (K, M, 3) that differ most in shape, among those with enough markers."""
    good = _good(markers, worn)
    if len(good) < FEWEST:
        raise BodysenseError(
            f"gloves: {len(good)} frames show {np.ceil(_SEEN * len(worn.markers)):g} markers of a hand and its back; "
            f"calibrating needs {FEWEST}: hold the hand flat, then make a fist, where every camera sees it"
        )
    some = markers[good[np.unique(np.linspace(0, len(good) - 1, 2000).astype(int))]]
    back = np.zeros(some.shape[:2], dtype=bool)
    back[:, _back(worn)] = True
    back &= ~np.isnan(some[..., 0])
    whole = int((~np.isnan(some[..., 0])).sum(axis=1).argmax())
    use = back & ~np.isnan(some[whole, :, 0])
    own = brought_back(some, *register(np.nan_to_num(some[whole]), some, use))
    own = np.nan_to_num(own).reshape(len(some), -1)
    marked = MarkedHand.of(glove_of(worn, _HAND))
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
