"""Parametric model of hands for fitting: shapes, gloves and poses in, markers out; and a prior of poses.

A pose has 32 numbers: 26 angles (rad, `body.hand.FREEDOMS`), then the wrist's rotation vector (rad) and position (m).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.resources import as_file, files
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import Glove
from bodysense.body.hands.hand import FINGERS, FREEDOMS, closing_hand, joint_rotations, limits, own_axes, per_joint
from bodysense.body.hands.hand_family import HandShapes
from bodysense.devices.gloves.fingers import finger_chains
from bodysense.geometry.products import exp, log, multiply, to_matrix
from bodysense.geometry.registration import register
from bodysense.geometry.rotation import matrix_to_quaternion

ANGLES = len(FREEDOMS)
POSE = ANGLES + 6
# Standard deviations of the prior.
_ANGLE = {"flexion": 2.5, "abduction": 0.3, "twist": 0.2}  # rad, from a relaxed hand's angle
_COUPLED, _BEYOND = 0.15, 0.05  # rad, flexion of the last joint from two thirds of the middle one's; excess of limits
_USUAL_WEIGHT = 0.5  # weight of usual poses; less than 1, because real hands have others, too


class Attachment(NamedTuple):
    """Attachment of a marker to a hand."""

    finger: int  # index in `FINGERS`; -1: none
    point: int  # index among the finger's four points
    carrier: int  # index among the finger's joints; -1: the wrist


@dataclass(frozen=True, eq=False)
class MarkedHand:
    """Attachments of the markers of a hand. `HandShapes` have their offsets."""

    attachments: tuple[Attachment, ...]

    @classmethod
    def of(cls, glove: Glove) -> MarkedHand:
        """Return the attachments of a glove's markers."""
        return cls(tuple(_attachment(*row) for row in zip(glove.points, glove.carried_by, strict=True)))

    @cached_property
    def on_hand(self) -> np.ndarray:
        """(M,) bool: the wrist carries the marker."""
        return np.array([attachment.carrier < 0 for attachment in self.attachments])

    @cached_property
    def farthest(self) -> tuple[int | None, ...]:
        """The marker closest to the tip of each finger; None for a finger without markers."""
        found: list[int | None] = []
        for finger in range(len(FINGERS)):
            own = [
                (p.carrier, p.point, k) for k, p in enumerate(self.attachments) if p.finger == finger and p.carrier >= 0
            ]
            found.append(max(own)[2] if own else None)
        return tuple(found)

    def markers(self, shapes: HandShapes, pose: np.ndarray) -> np.ndarray:
        """Return markers (..., M, 3) m of hands with `shapes` (...) and poses (..., 32)."""
        turn = joint_rotations(per_joint(pose[..., :ANGLES]), own_axes(shapes.axes))
        points, axes = finger_chains(shapes.rest, np.asarray(turn))
        wrist = to_matrix(exp(pose[..., -6:-3]))
        batch = np.broadcast_shapes(shapes.rest.shape[:-2], pose.shape[:-1])
        local = np.empty((*batch, len(self.attachments), 3))
        for marker, (finger, point, carrier) in enumerate(self.attachments):
            offset = shapes.markers[..., marker, :]
            if carrier >= 0:
                offset = (axes[..., finger, carrier, :, :] @ offset[..., None])[..., 0]
            local[..., marker, :] = offset + (points[..., finger, point, :] if finger >= 0 else 0.0)
        return local @ wrist.swapaxes(-1, -2) + pose[..., None, -3:]

    def register_wrists(self, shapes: HandShapes, poses: np.ndarray, seen: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Return poses (K, S, 32) with wrists registered to the markers `seen` (K, M, 3) that are `known` (K, M)."""
        local = poses.copy()
        local[..., -6:] = 0.0
        count, target = poses.shape[1], np.where(known[..., None], seen, 0.0)
        rotation, translation = register(
            self.markers(shapes, local).reshape(-1, len(self.attachments), 3),
            target.repeat(count, axis=0),
            known.repeat(count, axis=0),
        )
        turns = log(np.asarray(matrix_to_quaternion(rotation)))
        local[..., -6:-3], local[..., -3:] = turns.reshape(-1, count, 3), translation.reshape(-1, count, 3)
        return local

    def closest_poses(self, shapes: HandShapes, poses: np.ndarray, seen: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Return the poses (K, 32), one of each S in (K, S, 32), that are closest to the known markers."""
        far = np.where(known[:, None, :, None], self.markers(shapes, poses) - seen[:, None], 0.0)
        return poses[np.arange(len(poses)), (far**2).sum(axis=(-1, -2)).argmin(axis=1)]


def prior_residuals(pose: np.ndarray) -> np.ndarray:
    """Return residuals (..., R) of poses by the whole prior, in standard deviations."""
    return np.concatenate([limit_residuals(pose), usual_residuals(pose)], axis=-1)


def limit_residuals(pose: np.ndarray) -> np.ndarray:
    """Return residuals (..., R) of poses from joint limits and from a relaxed hand, in standard deviations."""
    angles, (low, high) = pose[..., :ANGLES], limits()
    beyond = (np.maximum(angles - high, 0.0) + np.minimum(angles - low, 0.0)) / _BEYOND
    return np.concatenate([(angles - relaxed()) / _deviations(), beyond], axis=-1)


def usual_residuals(pose: np.ndarray) -> np.ndarray:
    """Return residuals (..., R) of poses from usual ones with coordinated joints, in standard deviations."""
    angles, (middle, last) = pose[..., :ANGLES], _couples()
    coupled = (angles[..., last] - angles[..., middle] / 1.5) / _COUPLED
    usual, white = _usual()
    return np.concatenate([coupled, _USUAL_WEIGHT * ((angles - usual) @ white)], axis=-1)


def apply_change(pose: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Add a change to poses (..., 32); the wrist's rotation in it is in the world's axes."""
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


def _attachment(point: str, carrier: str) -> Attachment:
    if point == "wrist":
        return Attachment(-1, 0, -1)
    finger = FINGERS.index(point.removesuffix("_tip").rstrip("123"))
    joint = -1 if carrier == "wrist" else int(carrier[-1]) - 1
    return Attachment(finger, 3 if point.endswith("_tip") else int(point[-1]) - 1, joint)


@lru_cache(maxsize=1)
def _usual() -> tuple[np.ndarray, np.ndarray]:
    """Return the mean pose (26,) rad, and the matrix (26, 26) that scales differences from it to unit variance."""
    with as_file(files("bodysense.devices.gloves").joinpath("postures.npy")) as path:
        stored = np.load(path, allow_pickle=False).astype(float)
    return stored[0], stored[1:]


@lru_cache(maxsize=1)
def _deviations() -> np.ndarray:
    """Return standard deviations (26,) rad; the base of the thumb abducts and twists more than those of fingers."""
    return np.array(
        [_ANGLE[row.angle] * (2.0 if row.joint == "thumb1" and row.angle != "flexion" else 1.0) for row in FREEDOMS]
    )


@lru_cache(maxsize=1)
def _couples() -> tuple[list[int], list[int]]:
    """Return the flexions of the fingers' middle and last joints among the angles."""
    where = {row.joint: index for index, row in enumerate(FREEDOMS) if row.angle == "flexion"}
    return [where[f"{finger}2"] for finger in FINGERS[1:]], [where[f"{finger}3"] for finger in FINGERS[1:]]
