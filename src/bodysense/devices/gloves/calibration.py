"""A hand and its glove from a few seconds of markers: least squares with the family of hands as prior.

Unknown are the parameters of the hand (`body.hand_family`) and where each marker of its set sits, common to all frames,
and of every frame a pose (`hand_model`). Markers must be where they are seen, parameters are normal, and poses are
likely ones, loosely: usual ones, then, of the standard markers, those that the joint network tells of the hand found so
far, for how joints bend together says how long bones are. Gauss-Newton with Levenberg's damping; what belongs to one
frame is eliminated (Schur).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bodysense.body.glove import Glove, glove_of, hand_size
from bodysense.body.glove_set import GloveSet, standard_set
from bodysense.body.hand import FINGERS, FREEDOMS, hand_skeleton, joint_bases
from bodysense.body.hand_family import SHAPE, GlovedHand, HandShapes, bare_shapes_of
from bodysense.body.registration import brought_back, register, to_matrix
from bodysense.body.rotation import quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.hand_model import (
    ANGLES,
    POSE,
    MarkedHand,
    hardly_possible,
    moved,
    postures,
    unusual,
)
from bodysense.devices.gloves.joints import JointReader
from bodysense.devices.gloves.networks import HandNetwork, load_joint_network
from bodysense.errors import BodysenseError

FRAMES = 32  # that are looked at, as different as there are
FEWEST = 6  # of them, with three quarters of the markers and the back of the hand
_SEEN = 0.75  # of the markers, in a frame
_MARKER = 0.0015  # m: standard deviation of a marker, from where the best hand of the family has it
_STRAIGHT = 0.12  # rad, of the flexion of a finger where it reaches farthest, from 0; its base's, three times that
_TOLD = 0.2  # rad: standard deviation of an angle from what the network tells
_ROUNDS, _AGAIN = 2, 12  # how often the network is asked, and steps after each
_FAMILY = 0.7  # how far the family is believed, which was made of few hands; its size is wholly
_SIZES, _TRIED = (-1.0, 0.5, 2.0), 12  # standard deviations from which it starts, and steps of each
_STEPS, _STEP = 30, 1e-4  # of the best one; of the numerical derivative, of a parameter or rad
_SURE = 0.015  # m: markers whose place is known better say where a hand is before anything is known of it
_FITS, _MIRRORED = 0.008, 0.6  # m: an error that a hand has at most; its share of that in a mirror
_SIZE_PART = 0  # the parameter that is the hand's size


@dataclass(frozen=True, eq=False)
class HandFit:
    """A calibrated hand."""

    hand: GlovedHand
    error: float  # m, root mean square of markers from where the hand has them
    frames: int  # that were looked at


def fit_hand(markers: np.ndarray, worn: GloveSet | None = None, network: HandNetwork | None = None) -> HandFit:
    """The likeliest hand and glove of markers (T, M, 3) m, as of a left hand; NaN where missing.

    A flat hand and a fist, or any ten seconds of motion. `worn` is their set, the standard one if omitted; `network`
    tells joints, of the standard markers alone, and without it postures are usual ones. Raises BodysenseError where too
    few markers are seen at once.
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
    """Whether `fit_hand` has enough of markers (T, M, 3) to look at."""
    return len(_good(markers, worn or standard_set())) >= FEWEST


def checked_fit(markers: np.ndarray, worn: GloveSet, name: str) -> HandFit:
    """`fit_hand` of the hand `name`; raises BodysenseError, with the fix, where it finds no hand of this set."""
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
    """What is minimised: parameters are `SHAPE` numbers of the hand, then three of every marker."""

    worn: GloveSet
    seen: np.ndarray  # (K, M, 3) m, NaN where missing
    told: np.ndarray | None = None  # (K, 26) rad, what a network tells of frames; NaN where it tells nothing

    @cached_property
    def known(self) -> np.ndarray:
        """(K, M) bool."""
        return ~np.isnan(self.seen[..., 0])

    @cached_property
    def marked(self) -> MarkedHand:
        """Which markers there are."""
        return MarkedHand.of(glove_of(self.worn, hand_skeleton(default_skeleton(), "left")))

    @cached_property
    def _sitting(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of every marker its carrier, the end of that bone, and what its set says: along, offset, accuracy."""
        rows, hand = self.worn.markers, hand_skeleton(default_skeleton(), "left")
        carrier = hand.indices([row.segment for row in rows])
        bone = np.array([hand.parents.index(k) for k in carrier])
        along = np.array([row.along for row in rows])
        return carrier, bone, along, np.array([row.offset for row in rows]), np.array([row.accuracy for row in rows])

    def shapes(self, theta: np.ndarray) -> HandShapes:
        """Hands and where their markers sit, of parameters (..., N)."""
        rest, axes = bare_shapes_of(theta[..., :SHAPE])
        carrier, bone, along, offset, accuracy = self._sitting
        size = np.linalg.norm(rest[..., _MIDDLE, :].sum(axis=-2), axis=-1)[..., None, None] / _DEFAULT_SIZE
        own = size * (offset + accuracy * theta[..., SHAPE:].reshape(*theta.shape[:-1], -1, 3))
        bases = np.concatenate([np.eye(4)[:1], np.asarray(joint_bases())])
        whole = np.concatenate([np.broadcast_to(np.eye(4)[:1], (*axes.shape[:-2], 1, 4)), axes], axis=-2)
        turn = np.asarray(quaternion_multiply(whole, bases))[..., carrier, :]
        return HandShapes(rest, axes, along[:, None] * rest[..., bone, :] + np.asarray(quaternion_rotate(turn, own)))

    def hand(self, theta: np.ndarray) -> GlovedHand:
        """The hand of parameters (N,)."""
        shapes = self.shapes(theta)
        hand = hand_skeleton(default_skeleton(), "left").with_offsets(shapes.rest)
        points, carriers = zip(*((row.near, row.segment) for row in self.worn.markers), strict=True)
        return GlovedHand(hand, shapes.axes, Glove(self.worn.names, points, carriers, shapes.worn, hand_size(hand)))

    def start(self, size: float) -> tuple[np.ndarray, np.ndarray]:
        """Parameters (N,), and poses (K, 32): the hand is placed by what is sure of its back, else by its posture."""
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
        """Parameters with the markers that are not sure where the frames whose posture fits best have them."""
        far = self.marked.markers(self.shapes(theta), pose) - np.nan_to_num(self.seen)
        use = self.known & sure
        cost = ((far**2).sum(axis=-1) * use).sum(axis=1) / np.maximum(use.sum(axis=1), 1)
        best = np.argsort(cost)[: max(len(cost) // 4, 3)]
        turn = to_matrix(np.asarray(quaternion_exp(pose[best, -6:-3])))
        own = brought_back(self.seen[best], turn, pose[best, -3:])
        shapes, (_, _, _, offset, accuracy) = self.shapes(theta), self._sitting
        after = theta.copy()
        for k in np.flatnonzero(~sure & self.marked.on_hand & self.known[best].any(axis=0)):
            place = np.nanmedian(own[:, k], axis=0) - (self.marked.markers(shapes, np.zeros(POSE))[k] - shapes.worn[k])
            size = hand_size(self.hand(theta).skeleton) / _DEFAULT_SIZE
            after[SHAPE + 3 * k : SHAPE + 3 * k + 3] = (place / size - offset[k]) / accuracy[k]
        return after

    @cached_property
    def straight(self) -> np.ndarray:
        """(K, 26) which angles are taken for 0, in standard deviations a radian: those of a finger that reaches far."""
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
        """(N,) how many standard deviations one unit of a parameter is."""
        believed = np.full(SHAPE + 3 * len(self.worn.markers), 1.0)
        believed[:SHAPE] = _FAMILY
        believed[_SIZE_PART] = 1.0
        return believed

    def with_told(self, theta: np.ndarray, network: HandNetwork) -> _CalibrationProblem:
        """The same with what a network tells of a hand of these parameters, where all its markers are seen."""
        whole, hand = self.known.all(axis=1), self.hand(theta)
        count, told = int(whole.sum()), np.full((len(self.seen), ANGLES), np.nan)
        if count:
            axes = np.broadcast_to(hand.axes, (count, *hand.axes.shape))
            reader = JointReader(network, (hand.skeleton,) * count, (hand.glove,) * count, axes=axes)
            told[whole] = reader.angles(self.seen[whole])
        return replace(self, told=told)

    def residuals(self, theta: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """(..., K, R) of every frame, in standard deviations, without those of the parameters."""
        far = self.marked.markers(self.shapes(theta), pose) - np.nan_to_num(self.seen)
        missed = np.where(self.known[..., None], far, 0.0) / _MARKER
        usual, angles = unusual(pose), pose[..., :ANGLES]
        if self.told is not None:
            strange = np.where(np.isnan(self.told), 0.0, angles - self.told) / _TOLD
            usual = np.concatenate([np.where(np.isnan(self.told[:, :1]), usual, 0.0), strange], axis=-1)
        prior = np.concatenate([hardly_possible(pose), usual, angles * self.straight], axis=-1)
        prior = np.broadcast_to(prior, (*missed.shape[:-2], prior.shape[-1]))
        return np.concatenate([missed.reshape(*missed.shape[:-2], -1), prior], axis=-1)

    def cost(self, theta: np.ndarray, pose: np.ndarray) -> float:
        """Half of it is the negative logarithm of how likely these are."""
        return float((self.residuals(theta, pose) ** 2).sum() + ((self.prior * theta) ** 2).sum())

    def refined(self, theta: np.ndarray, pose: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Parameters, poses and their cost after so many steps at most."""
        cost, damping = self.cost(theta, pose), 1e-2
        for _ in range(steps):
            step = self._step(theta, pose, damping)
            trial = theta + step[0], moved(pose, step[1])
            new = self.cost(*trial)
            if new < cost:
                done = cost - new < 1e-4 * cost
                (theta, pose), cost, damping = trial, new, damping / 4
                if done:
                    break
            else:
                damping *= 6
        return theta, pose, cost

    def _step(self, theta: np.ndarray, pose: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """Changes of the parameters (N,) and of the poses (K, 32), the wrist's turn before its present one."""
        count = len(theta)
        now = self.residuals(theta, pose)
        other = self.residuals((theta + _STEP * np.eye(count))[:, None], pose)
        common = ((other - now) / _STEP).transpose(1, 2, 0)  # (K, R, N)
        shifted = moved(pose[None], _STEP * np.eye(POSE)[:, None])
        own = ((self.residuals(theta, shifted) - now) / _STEP).transpose(1, 2, 0)  # (K, R, 32)
        drawn = own.swapaxes(1, 2) @ np.concatenate([own, common, now[..., None]], axis=-1)
        inner, across = drawn[..., :POSE], drawn[..., POSE:]
        inner += damping * inner * np.eye(POSE) + 1e-9 * np.eye(POSE)
        solved = np.linalg.solve(inner, across)
        # Frames are summed by one large product, not by many small ones.
        every, left = common.reshape(-1, count), across[..., :-1].reshape(-1, count).T @ solved.reshape(-1, count + 1)
        outer = every.T @ every + np.diag(self.prior**2)
        outer += damping * outer * np.eye(count)
        outer -= left[:, :-1]
        slope = every.T @ now.ravel() + self.prior**2 * theta - left[:, -1]
        change = -np.linalg.solve(outer, slope)
        return change, -(solved[..., -1] + solved[..., :-1] @ change)


_HAND = hand_skeleton(default_skeleton(), "left")
_DEFAULT_SIZE = hand_size(_HAND)
_MIDDLE = _HAND.indices(["middle1", "middle2", "middle3", "middle_tip"])


def _back(worn: GloveSet) -> list[int]:
    """Markers by which frames are laid on each other: those of the back of the hand, or all where these are few."""
    return list(worn.on_hand if len(worn.on_hand) >= 3 else range(len(worn.markers)))


def _good(markers: np.ndarray, worn: GloveSet) -> np.ndarray:
    """The frames that show a hand well."""
    known, back = ~np.isnan(markers[..., 0]), list(worn.on_hand)
    enough = known.sum(axis=1) >= np.ceil(_SEEN * len(worn.markers))
    return np.flatnonzero((known[:, back].sum(axis=1) >= min(3, len(back))) & enough)


def _different(markers: np.ndarray, worn: GloveSet) -> np.ndarray:
    """(K, M, 3) the frames that differ most in shape, among those that show enough."""
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
    """(K, 5) m, how far fingers' farthest markers are from the back of the hand; NaN where they are not seen."""
    back = np.nanmean(np.where(marked.on_hand[:, None], markers, np.nan), axis=1)
    away = [np.full(len(markers), np.nan) if k is None else markers[:, k] - back for k in marked.farthest]
    return np.stack([np.linalg.norm(one, axis=-1) if one.ndim == 2 else one for one in away], axis=1)
