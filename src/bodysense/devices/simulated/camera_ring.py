"""A ring of cameras about a scene, as of an optical capture: a marker is found where two of them or more see it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.capsules import PosedPrimitives
from bodysense.devices.simulated.rays import blocked
from bodysense.errors import BodysenseError

_BLOCK = 256  # frames at a time, so that the arrays stay in the processor's cache


@dataclass(frozen=True)
class CameraRing:
    """Cameras evenly about the vertical axis through the middle of the scene, by turns at each of the heights."""

    count: int = 12
    radius: float = 2.5  # m
    heights: tuple[float, ...] = (-0.4, 0.4, 1.2)  # m above the middle
    least: int = 2  # cameras that must see a marker to place it
    beam: float = 80.0  # degrees from the way that a marker faces, within which it can be seen

    def __post_init__(self) -> None:
        if self.count < 1 or not 1 <= self.least <= self.count:
            raise BodysenseError(
                f"camera ring: {self.least} of {self.count} cameras cannot see; give 1 ≤ least ≤ count"
            )
        if not (np.isfinite(self.radius) and self.radius > 0):
            raise BodysenseError(f"camera ring: a radius of {self.radius:g} m cannot be; give one above 0, such as 2.5")
        if not self.heights or not np.isfinite(self.heights).all():
            raise BodysenseError(f"camera ring: heights {self.heights} cannot be; give metres, one at least")
        if not 0 < self.beam <= 180:
            raise BodysenseError(f"camera ring: a beam of {self.beam:g} degrees cannot be; give 0 to 180")

    def places(self, middle: np.ndarray) -> np.ndarray:
        """Where the cameras are about `middle` (3,) m: (count, 3) m."""
        angle = 2 * np.pi * np.arange(self.count) / self.count
        height = np.array(self.heights)[np.arange(self.count) % len(self.heights)]
        return middle + np.stack([self.radius * np.sin(angle), height, self.radius * np.cos(angle)], axis=1)


def seen(
    ring: CameraRing, middle: np.ndarray, light: np.ndarray, facing: np.ndarray, solids: PosedPrimitives
) -> np.ndarray:
    """Which lights enough cameras see: within their beam, with nothing solid between.

    Args:
        ring: of cameras.
        middle: (3,) m, of the ring.
        light: (F, R, 3) m, world; outside of what carries them, which hides them from behind.
        facing: (F, R, 3) unit: the middle of each light's beam.
        solids: of F frames, world.

    Returns:
        (F, R) bool.
    """
    found = np.empty(light.shape[:2], dtype=bool)
    for first in range(0, len(light), _BLOCK):
        block = slice(first, first + _BLOCK)
        here = PosedPrimitives(
            solids.primitives, solids.start[block], solids.end[block], solids.center[block], solids.axes[block]
        )
        found[block] = _cameras_that_see(ring, ring.places(middle), light[block], facing[block], here) >= ring.least
    return found


def _cameras_that_see(
    ring: CameraRing, cameras: np.ndarray, light: np.ndarray, facing: np.ndarray, solids: PosedPrimitives
) -> np.ndarray:
    """(F, R) how many cameras see each light."""
    number = np.zeros(light.shape[:2], dtype=int)
    everything = np.ones((light.shape[1], solids.start.shape[1] + solids.center.shape[1]), dtype=bool)
    edge = np.cos(np.radians(ring.beam))
    for camera in cameras:
        ray = (light - camera).astype(np.float32)
        shone = -np.einsum("frc,frc->fr", ray, facing) >= edge * np.linalg.norm(ray, axis=-1)
        around = replace(
            solids,
            start=(solids.start - camera).astype(np.float32),
            end=(solids.end - camera).astype(np.float32),
            center=(solids.center - camera).astype(np.float32),
        )
        number += shone & ~blocked(ray, around, shone, everything)
    return number
