"""Inertialisation: the output continues from its last pose, and the difference to the target decays.

If motion breaks (sensors came or went, a point was found again, the skeleton changed), the difference between output
and target becomes an offset that a critically damped spring takes to zero (Bollo, *Inertialization*, GDC 2018, with a
spring in place of his polynomial). Pose and velocity are continuous, the old motion is not blended in, and without an
offset the output is bit-identical to the target.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    cross,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.geometry.spring import spring_step

_NOTHING = 1e-7  # m, rad, m/s and rad/s; smaller offsets count as zero


@dataclass(frozen=True, eq=False)
class Velocity:
    """Rate of change of a pose."""

    root: np.ndarray  # (..., 3) m/s, world
    spin: np.ndarray  # (..., J, 3) rad/s, in the axes of the parent; the root's in the world's


@dataclass(frozen=True, eq=False)
class Offset:
    """Difference between output and target, and its rate of change."""

    root: np.ndarray  # (..., 3) m, world
    rotation: np.ndarray  # (..., J, 3) rad, rotation vector in the axes of the parent
    velocity: Velocity  # of the offset


@dataclass(frozen=True)
class Inertialiser:
    """Outputs poses without a jump. Immutable; state is an argument. Leading axes (...) are people, one frame each."""

    half_life: float = 0.08  # s in which half of an offset at rest decays

    def __post_init__(self) -> None:
        if not 0 < self.half_life < np.inf:
            raise BodysenseError(f"inertialiser: half-life {self.half_life:g} s; give a positive number of seconds")

    def rest(self, pose: Pose) -> Offset:
        """Return a zero offset for poses of the shape of `pose` (...)."""
        root, rotation = np.asarray(pose.root_position), np.asarray(pose.rotation)
        turn = np.zeros((*rotation.shape[:-1], 3))
        return Offset(np.zeros(root.shape), turn, Velocity(np.zeros(root.shape), turn))

    def start(
        self,
        output: Pose,
        target: Pose,
        offset: Offset,
        *,
        people: np.ndarray | None = None,
        follow: np.ndarray | None = None,
        velocity: Velocity | None = None,
        target_velocity: Velocity | None = None,
    ) -> Offset:
        """Return the offset after a break, with which `apply` continues from the pose that was output before it.

        Args:
            output: output pose (...) of the frame before.
            target: new target pose (...) for that frame, or for the first frame after the break.
            offset: offset of the frame before; it continues for people without a break.
            people: (...) bool, people whose motion breaks; all if omitted.
            follow: (..., J) bool, joints that take the target at once; for the root this includes its position.
            velocity: velocity of the output; zero if omitted.
            target_velocity: velocity of the target; zero if omitted.
        """
        root = np.asarray(output.root_position) - np.asarray(target.root_position)
        turn = quaternion_multiply(np.asarray(output.rotation), quaternion_conjugate(np.asarray(target.rotation)))
        rotation = np.asarray(quaternion_log(turn))
        velocity, still = velocity or self.rest(output).velocity, target_velocity or self.rest(target).velocity
        root_velocity = velocity.root - still.root
        spin = _rate_of_rotation_vector(rotation, velocity.spin - np.asarray(quaternion_rotate(turn, still.spin)))
        if follow is not None:
            rotation, spin = (np.where(follow[..., None], 0.0, values) for values in (rotation, spin))
            root, root_velocity = (np.where(follow[..., :1], 0.0, values) for values in (root, root_velocity))
        if people is not None:
            root, root_velocity, rotation, spin = (
                np.where(people.reshape(people.shape + (1,) * (new.ndim - people.ndim)), new, old)
                for new, old in (
                    (root, offset.root),
                    (root_velocity, offset.velocity.root),
                    (rotation, offset.rotation),
                    (spin, offset.velocity.spin),
                )
            )
        return Offset(root, rotation, Velocity(root_velocity, spin))

    def apply(self, target: Pose, interval: np.ndarray | float, offset: Offset) -> tuple[Pose, Offset]:
        """Return the output pose (...) for the target `interval` (...) s after the frame before, and the new offset.

        The output is bit-identical to the target if the offset is zero.
        """
        if not (offset.root.any() or offset.rotation.any() or offset.velocity.root.any() or offset.velocity.spin.any()):
            return target, offset
        passed = np.asarray(interval, dtype=float)
        root, root_velocity = _decayed(offset.root, offset.velocity.root, self.half_life, passed[..., None])
        rotation, spin = _decayed(offset.rotation, offset.velocity.spin, self.half_life, passed[..., None, None])
        output = Pose(
            target.skeleton,
            target.root_position + root,
            quaternion_multiply(np.asarray(quaternion_exp(rotation)), np.asarray(target.rotation)),
        )
        return output, Offset(root, rotation, Velocity(root_velocity, spin))


def _decayed(
    offset: np.ndarray, velocity: np.ndarray, half_life: float, interval: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return offset and velocity (..., 3) `interval` s later; exactly zero once they are negligible."""
    offset, velocity = spring_step(offset, velocity, half_life, interval)
    over = (np.abs(offset).max(axis=-1, keepdims=True) < _NOTHING) & (
        np.abs(velocity).max(axis=-1, keepdims=True) < _NOTHING
    )
    return np.where(over, 0.0, offset), np.where(over, 0.0, velocity)


def _rate_of_rotation_vector(vector: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """Return the rate of a rotation vector (..., 3) whose rotation has angular velocity `spin` (..., 3) rad/s.

    The inverse of the left Jacobian of SO(3) (Solà et al., *A micro Lie theory*, eq. 146).
    """
    squared = (vector * vector).sum(axis=-1, keepdims=True)
    half = np.sqrt(squared) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(squared > 1e-8, (1 - half / np.tan(half)) / squared, 1 / 12)
    once = np.asarray(cross(vector, spin))
    return spin - once / 2 + share * np.asarray(cross(vector, once))
