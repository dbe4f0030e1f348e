"""Ring of cameras around a scene, as in optical capture: a marker is found if at least two cameras see it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.capsules import PosedPrimitives
from bodysense.devices.simulated.rays import blocked
from bodysense.errors import BodysenseError

_BLOCK = 256  # frames at a time, so that the arrays stay in the processor's cache


@dataclass(frozen=True)
class CameraRing:
    """Cameras spaced evenly about the vertical axis through the middle of the scene, at alternating heights."""

    count: int = 12
    radius: float = 2.5  # m
    heights: tuple[float, ...] = (-0.4, 0.4, 1.2)  # m above the middle
    least: int = 2  # least number of cameras that must see a marker
    beam: float = 80.0  # degrees; a marker is seen within this angle of its facing direction

    def __post_init__(self) -> None:
        if self.count < 1 or not 1 <= self.least <= self.count:
            raise BodysenseError(
                f"camera ring: {self.least} of {self.count} cameras is not possible; give 1 ≤ least ≤ count"
            )
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise BodysenseError(f"camera ring: radius of {self.radius:g} m; give more than 0, such as 2.5")
        if not self.heights or not np.isfinite(self.heights).all():
            raise BodysenseError(f"camera ring: heights {self.heights}; give at least one, in metres")
        if not 0 < self.beam <= 180:
            raise BodysenseError(f"camera ring: beam of {self.beam:g} degrees; give more than 0 and at most 180")

    def places(self, middle: np.ndarray) -> np.ndarray:
        """Return positions (count, 3) m of the cameras about `middle` (3,) m."""
        angle = 2 * np.pi * np.arange(self.count) / self.count
        height = np.array(self.heights)[np.arange(self.count) % len(self.heights)]
        return middle + np.stack([self.radius * np.sin(angle), height, self.radius * np.cos(angle)], axis=1)


def seen_lights(
    ring: CameraRing, middle: np.ndarray, light: np.ndarray, facing: np.ndarray, solids: PosedPrimitives
) -> np.ndarray:
    """Return which lights (F, R) enough cameras see: cameras in the light's beam, without a solid in between.

    Args:
        ring: the cameras.
        middle: (3,) m, middle of the ring.
        light: (F, R, 3) m, positions of the lights in the world, outside the solids that carry them.
        facing: (F, R, 3) unit vectors, the middle of each light's beam.
        solids: solids of F frames in the world.
    """
    found = np.empty(light.shape[:2], dtype=bool)
    for first in range(0, len(light), _BLOCK):
        block = slice(first, first + _BLOCK)
        here = PosedPrimitives(
            solids.primitives, solids.start[block], solids.end[block], solids.center[block], solids.axes[block]
        )
        found[block] = _count_cameras(ring, ring.places(middle), light[block], facing[block], here) >= ring.least
    return found


def _count_cameras(
    ring: CameraRing, cameras: np.ndarray, light: np.ndarray, facing: np.ndarray, solids: PosedPrimitives
) -> np.ndarray:
    """Return the number (F, R) of cameras that see each light."""
    number = np.zeros(light.shape[:2], dtype=int)
    everything = np.ones((light.shape[1], solids.start.shape[1] + solids.center.shape[1]), dtype=bool)
    edge = np.cos(np.radians(ring.beam))
    for camera in cameras:
        ray = (light - camera).astype(np.float32)
        in_beam = -np.einsum("frc,frc->fr", ray, facing) >= edge * np.linalg.norm(ray, axis=-1)
        around = replace(
            solids,
            start=(solids.start - camera).astype(np.float32),
            end=(solids.end - camera).astype(np.float32),
            center=(solids.center - camera).astype(np.float32),
        )
        number += in_beam & ~blocked(ray, around, in_beam, everything)
    return number
