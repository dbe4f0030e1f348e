"""Rigid transforms: rotation and translation."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
)


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """T_a_b: maps coordinates in frame b to coordinates in frame a; its translation is the origin of b in a.

    In products the inner frames cancel: `T_a_b @ T_b_c` is T_a_c. The rotation is normalised, with w ≥ 0.
    """

    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))  # (3,) m
    rotation: np.ndarray = field(default_factory=lambda: np.array([1.0, 0, 0, 0]))  # (4,) wxyz, a ← b

    def __post_init__(self) -> None:
        for name, size in (("translation", 3), ("rotation", 4)):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.shape != (size,) or not np.isfinite(values).all():
                raise BodysenseError(f"rigid transform: {name} {values.tolist()}; it must be {size} finite numbers")
            object.__setattr__(self, name, values)
        size = float(np.linalg.norm(self.rotation))
        if size < 1e-6:
            raise BodysenseError("rigid transform: rotation 0, 0, 0, 0 is no rotation; give a quaternion w, x, y, z")
        if abs(size - 1) > 1e-12:  # a unit quaternion is kept to the last bit
            object.__setattr__(self, "rotation", self.rotation / size)
        object.__setattr__(self, "rotation", np.asarray(quaternion_canonical(self.rotation)))
        self.translation.setflags(write=False)
        self.rotation.setflags(write=False)

    def compose(self, inner: RigidTransform) -> RigidTransform:
        """Return T_a_c from this T_a_b and an inner T_b_c."""
        translation = self.translation + quaternion_rotate(self.rotation, inner.translation)
        return RigidTransform(translation, quaternion_multiply(self.rotation, inner.rotation))

    def __matmul__(self, inner: RigidTransform) -> RigidTransform:
        return self.compose(inner)

    def inverse(self) -> RigidTransform:
        """Return T_b_a from this T_a_b."""
        back = quaternion_conjugate(self.rotation)
        return RigidTransform(-quaternion_rotate(back, self.translation), back)

    def apply(self, positions: np.ndarray) -> np.ndarray:
        """Return positions (..., 3), metres, in frame a from positions in frame b."""
        return self.translation + quaternion_rotate(self.rotation, np.asarray(positions, dtype=np.float64))
