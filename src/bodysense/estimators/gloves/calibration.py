"""A hand and its glove from a few seconds of markers: least squares with the family of hands as prior.

Unknown are the parameters of the hand (`body.hand_family`), common to all frames, and of every frame 26 angles and
where the wrist is. Markers must be where they are seen, parameters are standard normal, and angles are near those of a
relaxed hand, loosely. Gauss-Newton with Levenberg's damping; what belongs to one frame is eliminated (Schur).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bodysense.body.glove import ALIGNMENT, MARKERS, default_glove, template
from bodysense.body.hand import FINGERS, FREEDOMS, HAND_JOINTS, limits, rotations_of
from bodysense.body.hand_family import COUNT, GlovedHand, HandShapes, hand_of, shapes_of
from bodysense.body.registration import brought_back, register, to_matrix
from bodysense.body.rotation import matrix_to_quaternion, quaternion_conjugate, quaternion_exp, quaternion_multiply
from bodysense.errors import BodysenseError

FRAMES = 32  # that are looked at, as different as there are
FEWEST = 6  # of them, with all but two markers and the back of the hand
SEEN = 7  # markers of a frame
_MARKER = 0.0015  # m: standard deviation of a marker, from where the best hand of the family has it
_ANGLE = {"flexion": 2.5, "abduction": 0.3, "twist": 0.2}  # rad, from those of a relaxed hand
_STRAIGHT = 0.12  # rad, of the flexion of a finger where it reaches farthest, from 0; its base's, three times that
_COUPLED, _BEYOND = 0.15, 0.05  # rad: of a last joint from two thirds of the middle one, and of what is beyond limits
_SIZES, _TRIED = (-1.0, 0.5, 2.0), 12  # standard deviations from which it starts, and steps of each
_STEPS, _STEP = 30, 1e-4  # of the best one; of the numerical derivative, of a parameter or rad
_POSE = len(FREEDOMS) + 6  # numbers of a frame: angles, then turn (rad) and place (m) of the wrist


@dataclass(frozen=True, eq=False)
class HandFit:
    """A calibrated hand."""

    hand: GlovedHand
    error: float  # m, root mean square of markers from where the hand has them
    frames: int  # that were looked at


def fit_hand(markers: np.ndarray) -> HandFit:
    """The likeliest hand and glove of markers (T, 9, 3) m, as of a left hand; NaN where missing.

    A flat hand and a fist, or any ten seconds of motion. Raises BodysenseError where too few markers are seen at once.
    """
    seen = _different(markers)
    known = ~np.isnan(seen[..., 0])
    start = _start(seen, known)
    begun = [_refined(size * np.eye(COUNT)[0], start, seen, known, _TRIED) for size in _SIZES]
    theta, pose, _ = _refined(*min(begun, key=lambda one: one[2])[:2], seen, known, _STEPS)
    missed = (_markers(shapes_of(theta), pose) - seen)[known]
    return HandFit(hand_of(theta), float(np.sqrt((missed**2).sum(axis=-1).mean())), len(seen))


def _refined(
    theta: np.ndarray, pose: np.ndarray, seen: np.ndarray, known: np.ndarray, steps: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Parameters, poses and their cost after so many steps of the optimisation at most."""
    cost, damping = _cost(theta, pose, seen, known), 1e-2
    for _ in range(steps):
        step = _step(theta, pose, seen, known, damping)
        trial = theta + step[0], _moved(pose, step[1])
        new = _cost(*trial, seen, known)
        if new < cost:
            done = cost - new < 1e-4 * cost
            (theta, pose), cost, damping = trial, new, damping / 4
            if done:
                break
        else:
            damping *= 6
    return theta, pose, cost


def enough_frames(markers: np.ndarray) -> bool:
    """Whether `fit_hand` has enough of markers (T, 9, 3) to look at."""
    return len(_good(markers)) >= FEWEST


def _good(markers: np.ndarray) -> np.ndarray:
    """The frames that show a hand well."""
    known = ~np.isnan(markers[..., 0])
    return np.flatnonzero(known[:, list(ALIGNMENT)].all(axis=1) & (known.sum(axis=1) >= SEEN))


def _different(markers: np.ndarray) -> np.ndarray:
    """(K, 9, 3) the frames that differ most in shape, among those that show enough."""
    good = _good(markers)
    if len(good) < FEWEST:
        raise BodysenseError(
            f"gloves: {len(good)} frames show {SEEN} markers of a hand and its back; calibrating needs {FEWEST}: "
            "hold the hand flat, then make a fist, where every camera sees it"
        )
    some = markers[good[np.unique(np.linspace(0, len(good) - 1, 2000).astype(int))]]
    back = np.zeros(some.shape[:2], dtype=bool)
    back[:, list(ALIGNMENT)] = True
    own = np.nan_to_num(brought_back(some, *register(np.nan_to_num(some[0]), some, back))).reshape(len(some), -1)
    chosen = sorted(set(np.nanargmax(_reach(some), axis=0).tolist()))
    far = np.min([np.linalg.norm(own - own[one], axis=1) for one in chosen], axis=0)
    while len(chosen) < min(FRAMES, len(some)):
        chosen.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(own - own[chosen[-1]], axis=1))
    return some[chosen]


def _reach(markers: np.ndarray) -> np.ndarray:
    """(K, 5) m, how far fingertips are from the wrist's marker; −1 where they are not seen."""
    tips = [MARKERS.index(f"{finger}_tip") for finger in FINGERS]
    away = np.linalg.norm(markers[:, tips] - markers[:, [MARKERS.index("wrist")]], axis=-1)
    return np.nan_to_num(away, nan=-1.0)


def _straight(seen: np.ndarray) -> np.ndarray:
    """(K, 26) which angles are taken for 0, in standard deviations a radian: those of a finger that reaches far."""
    weight = np.zeros((len(seen), len(FREEDOMS)))
    for finger, frame in zip(FINGERS, _reach(seen).argmax(axis=0), strict=True):
        for place, row in enumerate(FREEDOMS):
            if row.angle == "flexion" and row.joint.startswith(finger) and row.joint != "thumb1":
                weight[frame, place] = 1 / (_STRAIGHT * (3.0 if row.joint.endswith("1") else 1.0))
    return weight


def _start(seen: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(K, 32) poses of a relaxed hand, placed by the back of the hand."""
    middle = hand_of(np.zeros(COUNT))
    back = known & np.isin(np.arange(len(MARKERS)), ALIGNMENT)
    rotation, translation = register(template(middle.glove, middle.skeleton), seen, back)
    pose = np.zeros((len(seen), _POSE))
    pose[:, : len(FREEDOMS)] = _relaxed()
    pose[:, -6:-3], pose[:, -3:] = _vectors(rotation), translation
    return pose


def _markers(shapes: HandShapes, pose: np.ndarray) -> np.ndarray:
    """(..., 9, 3) m of hands (shapes …) with poses (..., 32)."""
    turn = rotations_of(pose[..., : len(FREEDOMS)])
    turn = quaternion_multiply(quaternion_multiply(shapes.axes, turn), quaternion_conjugate(shapes.axes))
    matrix = to_matrix(np.asarray(turn)).reshape(*turn.shape[:-2], 5, 3, 3, 3)
    rest = shapes.rest[..., _chains(), :][..., None]  # (..., 5, 4, 3, 1)
    place, world, at, frame = rest[..., 0, :, :], matrix[..., 0, :, :], [], []
    for joint in range(3):
        at.append(place)
        frame.append(world)
        place = place + world @ rest[..., joint + 1, :, :]
        if joint < 2:
            world = world @ matrix[..., joint + 1, :, :]
    at.append(place)
    wrist = to_matrix(np.asarray(quaternion_exp(pose[..., -6:-3])))
    batch = np.broadcast_shapes(shapes.rest.shape[:-2], pose.shape[:-1])
    local = np.empty((*batch, len(MARKERS), 3))
    for marker, (finger, point, carrier) in enumerate(_places()):
        offset = shapes.worn[..., marker, :]
        if carrier >= 0:
            offset = (frame[carrier][..., finger, :, :] @ offset[..., None])[..., 0]
        local[..., marker, :] = offset + (at[point][..., finger, :, 0] if finger >= 0 else 0.0)
    return local @ wrist.swapaxes(-1, -2) + pose[..., None, -3:]


def _residuals(theta: np.ndarray, pose: np.ndarray, seen: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(..., K, R) of every frame, in standard deviations, without those of the parameters."""
    missed = np.where(known[..., None], _markers(shapes_of(theta), pose) - np.nan_to_num(seen), 0.0) / _MARKER
    angles, (low, high) = pose[..., : len(FREEDOMS)], limits()
    about = (angles - _relaxed()) / _deviations()
    middle, last = _couples()
    coupled = (angles[..., last] - angles[..., middle] / 1.5) / _COUPLED
    beyond = (np.maximum(angles - high, 0.0) + np.minimum(angles - low, 0.0)) / _BEYOND
    prior = np.concatenate([about, coupled, beyond, angles * _straight(seen)], axis=-1)
    prior = np.broadcast_to(prior, (*missed.shape[:-2], prior.shape[-1]))
    return np.concatenate([missed.reshape(*missed.shape[:-2], -1), prior], axis=-1)


def _cost(theta: np.ndarray, pose: np.ndarray, seen: np.ndarray, known: np.ndarray) -> float:
    return float((_residuals(theta, pose, seen, known) ** 2).sum() + (theta**2).sum())


def _step(
    theta: np.ndarray, pose: np.ndarray, seen: np.ndarray, known: np.ndarray, damping: float
) -> tuple[np.ndarray, np.ndarray]:
    """Changes of the parameters (COUNT,) and of the poses (K, 32), the wrist's turn before its present one."""
    now = _residuals(theta, pose, seen, known)
    other = _residuals((theta + _STEP * np.eye(COUNT))[:, None], pose, seen, known)
    common = ((other - now) / _STEP).transpose(1, 2, 0)  # (K, R, COUNT)
    moved = _moved(pose[None], _STEP * np.eye(_POSE)[:, None])
    own = ((_residuals(theta, moved, seen, known) - now) / _STEP).transpose(1, 2, 0)  # (K, R, 32)
    inner = own.swapaxes(1, 2) @ own
    inner += damping * inner * np.eye(_POSE) + 1e-9 * np.eye(_POSE)
    across, drawn = own.swapaxes(1, 2) @ common, own.swapaxes(1, 2) @ now[..., None]
    solved = np.linalg.solve(inner, np.concatenate([across, drawn], axis=-1))
    outer = (common.swapaxes(1, 2) @ common).sum(axis=0) + np.eye(COUNT)
    outer += damping * outer * np.eye(COUNT)
    outer -= (across.swapaxes(1, 2) @ solved[..., :-1]).sum(axis=0)
    slope = (common.swapaxes(1, 2) @ now[..., None]).sum(axis=0)[:, 0] + theta
    slope -= (across.swapaxes(1, 2) @ solved[..., -1:]).sum(axis=0)[:, 0]
    change = -np.linalg.solve(outer, slope)
    return change, -(solved[..., -1] + solved[..., :-1] @ change)


def _moved(pose: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Poses after a change, whose turn of the wrist comes before its present one."""
    after = pose + change
    turn = quaternion_multiply(quaternion_exp(change[..., -6:-3]), quaternion_exp(pose[..., -6:-3]))
    after[..., -6:-3] = _log(np.asarray(turn))
    return after


def _vectors(rotation: np.ndarray) -> np.ndarray:
    """(..., 3) rotation vectors of matrices."""
    return _log(np.asarray(matrix_to_quaternion(rotation)))


def _log(turn: np.ndarray) -> np.ndarray:
    turn = turn * np.copysign(1.0, turn[..., :1])
    sine = np.linalg.norm(turn[..., 1:], axis=-1, keepdims=True)
    return turn[..., 1:] * np.where(sine > 1e-9, 2 * np.arctan2(sine, turn[..., :1]) / np.maximum(sine, 1e-12), 2.0)


@lru_cache(maxsize=1)
def _relaxed() -> np.ndarray:
    """(26,) rad."""
    flexion = {"1": 25.0, "2": 35.0, "3": 20.0}
    bent = {"thumb1": 5.0, "thumb2": 10.0, "thumb3": 15.0}
    rows = [bent.get(row.joint, flexion[row.joint[-1]]) if row.angle == "flexion" else 0.0 for row in FREEDOMS]
    return np.radians(rows)


@lru_cache(maxsize=1)
def _deviations() -> np.ndarray:
    """(26,) rad; the base of a thumb turns more to the side and about itself than those of fingers."""
    return np.array(
        [_ANGLE[row.angle] * (2.0 if row.joint == "thumb1" and row.angle != "flexion" else 1.0) for row in FREEDOMS]
    )


@lru_cache(maxsize=1)
def _couples() -> tuple[list[int], list[int]]:
    """Flexions of the fingers' middle and last joints among the angles."""
    where = {row.joint: place for place, row in enumerate(FREEDOMS) if row.angle == "flexion"}
    return [where[f"{finger}2"] for finger in FINGERS[1:]], [where[f"{finger}3"] for finger in FINGERS[1:]]


@lru_cache(maxsize=1)
def _chains() -> np.ndarray:
    """(5, 4) points of fingers."""
    first = [HAND_JOINTS.index(f"{finger}1") for finger in FINGERS]
    return np.array([[k, k + 1, k + 2, len(HAND_JOINTS) + row] for row, k in enumerate(first)])


@lru_cache(maxsize=1)
def _places() -> tuple[tuple[int, int, int], ...]:
    """Of every marker its finger, its point and the joint that carries it, in a chain; −1 for the wrist."""
    glove, rows = default_glove(), []
    for point, carrier in zip(glove.points, glove.carried_by, strict=True):
        if point == "wrist":
            rows.append((-1, 0, -1))
            continue
        finger = FINGERS.index(point.removesuffix("_tip").rstrip("123"))
        rows.append(
            (
                finger,
                3 if point.endswith("_tip") else int(point[-1]) - 1,
                -1 if carrier == "wrist" else int(carrier[-1]) - 1,
            )
        )
    return tuple(rows)
