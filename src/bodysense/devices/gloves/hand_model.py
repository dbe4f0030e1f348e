"""A hand as numbers: shape, glove and pose in, markers out, many at once; and a prior of poses.

A pose is 32 numbers: 26 angles (`body.hand.FREEDOMS`), then the turn (rotation vector) and the place (m) of the wrist.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.resources import as_file, files
from typing import NamedTuple

import numpy as np

from bodysense.body.glove import Glove
from bodysense.body.hand import FINGERS, FREEDOMS, closing_hand, joint_rotations, limits, own_axes, per_joint
from bodysense.body.hand_family import HandShapes
from bodysense.body.products import exp, log, multiply, to_matrix
from bodysense.body.registration import register
from bodysense.body.rotation import matrix_to_quaternion
from bodysense.devices.gloves.fingers import finger_chains

ANGLES = len(FREEDOMS)
POSE = ANGLES + 6
_ANGLE = {"flexion": 2.5, "abduction": 0.3, "twist": 0.2}  # rad, from a relaxed hand's
_COUPLED, _BEYOND = 0.15, 0.05  # rad: last joint from two thirds of the middle one; excess beyond limits


_BELIEVED = 0.5  # weight of usual poses, because real hands have others, too


class Place(NamedTuple):
    """Position of a marker on a hand."""

    finger: int  # among `FINGERS`; -1: none
    point: int  # of the finger's four
    carrier: int  # of the finger's joints; -1: the wrist


@dataclass(frozen=True, eq=False)
class MarkedHand:
    """The markers of a hand; `shapes` has their positions."""

    places: tuple[Place, ...]

    @classmethod
    def of(cls, glove: Glove) -> MarkedHand:
        """Return the markers of a glove."""
        return cls(tuple(_place(*row) for row in zip(glove.points, glove.carried_by, strict=True)))

    @cached_property
    def on_hand(self) -> np.ndarray:
        """Markers that the wrist carries."""
        return np.array([place.carrier < 0 for place in self.places])

    @cached_property
    def farthest(self) -> tuple[int | None, ...]:
        """For each finger the marker closest to its tip, or None if it has no marker."""
        found: list[int | None] = []
        for finger in range(len(FINGERS)):
            own = [(p.carrier, p.point, k) for k, p in enumerate(self.places) if p.finger == finger and p.carrier >= 0]
            found.append(max(own)[2] if own else None)
        return tuple(found)

    def markers(self, shapes: HandShapes, pose: np.ndarray) -> np.ndarray:
        """Return markers (..., M, 3) m of hands (shapes …) with poses (..., 32)."""
        turn = joint_rotations(per_joint(pose[..., :ANGLES]), own_axes(shapes.axes))
        points, axes = finger_chains(shapes.rest, np.asarray(turn))
        wrist = to_matrix(exp(pose[..., -6:-3]))
        batch = np.broadcast_shapes(shapes.rest.shape[:-2], pose.shape[:-1])
        local = np.empty((*batch, len(self.places), 3))
        for marker, (finger, point, carrier) in enumerate(self.places):
            offset = shapes.worn[..., marker, :]
            if carrier >= 0:
                offset = (axes[..., finger, carrier, :, :] @ offset[..., None])[..., 0]
            local[..., marker, :] = offset + (points[..., finger, point, :] if finger >= 0 else 0.0)
        return local @ wrist.swapaxes(-1, -2) + pose[..., None, -3:]

    def placed(self, shapes: HandShapes, poses: np.ndarray, seen: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Return poses (K, S, 32) with the wrists registered to the known (K, M) of markers (K, M, 3)."""
        local = poses.copy()
        local[..., -6:] = 0.0
        count, shown = poses.shape[1], np.where(known[..., None], seen, 0.0)
        rotation, translation = register(
            self.markers(shapes, local).reshape(-1, len(self.places), 3),
            shown.repeat(count, axis=0),
            known.repeat(count, axis=0),
        )
        turns = log(np.asarray(matrix_to_quaternion(rotation)))
        local[..., -6:-3], local[..., -3:] = turns.reshape(-1, count, 3), translation.reshape(-1, count, 3)
        return local

    def best(self, shapes: HandShapes, poses: np.ndarray, seen: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Return of poses (K, S, 32) those (K, 32) closest to the known markers."""
        far = np.where(known[:, None, :, None], self.markers(shapes, poses) - seen[:, None], 0.0)
        return poses[np.arange(len(poses)), (far**2).sum(axis=(-1, -2)).argmin(axis=1)]


def unlikely(pose: np.ndarray) -> np.ndarray:
    """Return the distance (..., R) of poses from likely ones, in standard deviations."""
    return np.concatenate([hardly_possible(pose), unusual(pose)], axis=-1)


def hardly_possible(pose: np.ndarray) -> np.ndarray:
    """Return the distance (..., R) of poses from joint limits and from a relaxed hand, in standard deviations."""
    angles, (low, high) = pose[..., :ANGLES], limits()
    beyond = (np.maximum(angles - high, 0.0) + np.minimum(angles - low, 0.0)) / _BEYOND
    return np.concatenate([(angles - relaxed()) / _deviations(), beyond], axis=-1)


def unusual(pose: np.ndarray) -> np.ndarray:
    """Return the distance (..., R) of poses from usual ones with coordinated joints, in standard deviations."""
    angles, (middle, last) = pose[..., :ANGLES], _couples()
    coupled = (angles[..., last] - angles[..., middle] / 1.5) / _COUPLED
    usual, white = _usual()
    return np.concatenate([coupled, _BELIEVED * ((angles - usual) @ white)], axis=-1)


def moved(pose: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Return poses after a change; its turn of the wrist is applied before the present one."""
    after = pose + change
    after[..., -6:-3] = log(multiply(exp(change[..., -6:-3]), exp(pose[..., -6:-3])))
    return after


@lru_cache(maxsize=1)
def relaxed() -> np.ndarray:
    """Return the angles (26,) rad of a relaxed hand."""
    flexion = {"1": 25.0, "2": 35.0, "3": 20.0}
    bent = {"thumb1": 5.0, "thumb2": 10.0, "thumb3": 15.0}
    rows = [bent.get(row.joint, flexion[row.joint[-1]]) if row.angle == "flexion" else 0.0 for row in FREEDOMS]
    return np.radians(rows)


@lru_cache(maxsize=1)
def postures() -> np.ndarray:
    """Return (5, 26) rad: a relaxed hand, a flat one, half closed and nearly closed ones."""
    return np.stack([relaxed(), *closing_hand()])


def _place(point: str, carrier: str) -> Place:
    if point == "wrist":
        return Place(-1, 0, -1)
    finger = FINGERS.index(point.removesuffix("_tip").rstrip("123"))
    joint = -1 if carrier == "wrist" else int(carrier[-1]) - 1
    return Place(finger, 3 if point.endswith("_tip") else int(point[-1]) - 1, joint)


@lru_cache(maxsize=1)
def _usual() -> tuple[np.ndarray, np.ndarray]:
    """Return the mean pose (26,) rad, and the matrix (26, 26) that scales differences from it to unit variance."""
    with as_file(files("bodysense.devices.gloves").joinpath("postures.npy")) as path:
        stored = np.load(path, allow_pickle=False).astype(float)
    return stored[0], stored[1:]


@lru_cache(maxsize=1)
def _deviations() -> np.ndarray:
    """Return (26,) rad; the base of a thumb abducts and twists more than those of fingers."""
    return np.array(
        [_ANGLE[row.angle] * (2.0 if row.joint == "thumb1" and row.angle != "flexion" else 1.0) for row in FREEDOMS]
    )


@lru_cache(maxsize=1)
def _couples() -> tuple[list[int], list[int]]:
    """Return the flexions of the fingers' middle and last joints among the angles."""
    where = {row.joint: place for place, row in enumerate(FREEDOMS) if row.angle == "flexion"}
    return [where[f"{finger}2"] for finger in FINGERS[1:]], [where[f"{finger}3"] for finger in FINGERS[1:]]
