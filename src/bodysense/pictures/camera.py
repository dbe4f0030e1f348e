"""Cameras that follow a body along the floor. Compared bodies share one camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.surface import fit_surface
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import heading, quaternion_rotate
from bodysense.geometry.series import smoothed


@dataclass(frozen=True)
class Lens:
    """Picture size and optics; lengths are for a body of 1.7 m and scale with it."""

    width: int = 360  # pixels
    height: int = 450
    distance: float = 4.2  # m from the body, along the floor
    eye: float = 1.6  # m above the floor
    aim: float = 0.88  # m above the floor, where it looks
    view_height: float = 2.25  # m of height in the picture, at the body
    azimuth: float = 0.5  # rad from the body's front, toward its left

    def __post_init__(self) -> None:
        for name in ("width", "height", "distance", "eye", "view_height"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"lens: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True, eq=False)
class FollowingCamera:
    """A camera over T frames. It keeps its height and direction, and follows the body along the floor."""

    lens: Lens
    follow: np.ndarray  # (T, 2) m, world x and z of the target
    turn: float  # rad about +Y, from +Z to the direction of the camera
    floor: float  # m, world height
    scale: float  # height of the body divided by 1.7 m

    def __len__(self) -> int:
        return len(self.follow)

    @cached_property
    def axes(self) -> np.ndarray:
        """(3, 3) world ← camera; its columns point right, up and back."""
        rise = (self.lens.eye - self.lens.aim) / self.lens.distance
        back = np.array([np.sin(self.turn), rise, np.cos(self.turn)]) / np.hypot(1, rise)
        right = np.array([np.cos(self.turn), 0.0, -np.sin(self.turn)])
        return np.stack([right, np.cross(back, right), back], axis=1)

    def eye(self, frame: int) -> np.ndarray:
        """Return the position (3,) m, world, of the camera."""
        x, z = self.follow[frame]
        away, height = self.scale * self.lens.distance, self.scale * self.lens.eye
        return np.array([x + away * np.sin(self.turn), self.floor + height, z + away * np.cos(self.turn)])

    @property
    def focal_length(self) -> float:
        """Focal length in picture heights."""
        return float(np.hypot(self.lens.distance, self.lens.eye - self.lens.aim)) / self.lens.view_height

    def rays(self) -> np.ndarray:
        """Return unit directions (H, W, 3) through the pixels, in the camera's axes."""
        high, wide = self.lens.height, self.lens.width
        x = (np.arange(wide) + 0.5 - wide / 2) / (self.focal_length * high)
        y = (high / 2 - np.arange(high) - 0.5) / (self.focal_length * high)
        rays = np.stack([*np.meshgrid(x, y), np.full((high, wide), -1.0)], axis=-1)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def follow_body(truth: Pose, rate: float, lens: Lens = Lens()) -> FollowingCamera:
    """Return a camera that keeps a body (T, …) at `rate` Hz in the picture, from its front left.

    The camera is still if the head stays within 0.5 m of one position. Otherwise it follows the head, smoothed over
    0.7 s. All compared methods agree on the head, so the camera's motion does not reveal the method.
    """
    position, rotation = forward_kinematics(truth)
    head = truth.skeleton.index("head")
    front = quaternion_rotate(heading(rotation[:, head]), np.array([0.0, 0.0, 1.0])).mean(axis=0)
    path = position[:, head][:, [0, 2]]
    middle = (path.min(axis=0) + path.max(axis=0)) / 2
    stays = np.linalg.norm(path - middle, axis=-1).max() < 0.5 * truth.skeleton.height / 1.7
    soles = [mesh.position[:, 1].min() for mesh in fit_surface(truth.skeleton).soles.placed(truth)]
    return FollowingCamera(
        lens=lens,
        follow=np.tile(middle, (len(path), 1)) if stays else smoothed(path, 0.7 * rate),
        turn=float(np.arctan2(front[0], front[2])) + lens.azimuth,
        floor=float(np.percentile(soles, 5)),
        scale=truth.skeleton.height / 1.7,
    )
