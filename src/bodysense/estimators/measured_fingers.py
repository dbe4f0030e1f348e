"""Fingers bent to points of them that are measured, as WebXR's hands give them.

Each bone is laid along the line between its two points, by the smallest turn from the bone above it: directions are the
device's, lengths are the wearer's, and no bone twists.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from bodysense.body.hand import FINGERS
from bodysense.body.products import MATRIX, multiply
from bodysense.body.rotation import shortest_arc
from bodysense.body.skeleton import Skeleton

_SIDES = ("left", "right")
_SHORTEST = 0.003  # m: points that are nearer to each other give no direction


class MeasuredFingers:
    """The ten fingers of a skeleton. Raises BodysenseError for one that lacks a joint of them."""

    def __init__(self, skeleton: Skeleton) -> None:
        names = [[f"{side}_{finger}{k}" for k in (1, 2, 3, "_tip")] for side in _SIDES for finger in FINGERS]
        self.points = np.array([skeleton.indices(chain) for chain in names])  # (10, 4)
        self.wrists = skeleton.indices([f"{side}_wrist" for side in _SIDES for _ in FINGERS])
        self._rest = skeleton.rest_offset[self.points[:, 1:]]

    @cached_property
    def joints(self) -> np.ndarray:
        """(30,) those that turn: of each finger three, from the hand outward."""
        return self.points[:, :3].ravel()

    @cached_property
    def _direction(self) -> np.ndarray:
        """(10, 3, 3) unit, of the bones in the rest pose."""
        return self._rest / np.linalg.norm(self._rest, axis=-1, keepdims=True)

    def bent(self, position: np.ndarray, known: np.ndarray, wrist: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Local rotations (30, 4) of the joints.

        Args:
            position: (P, 3) m, world, of the skeleton's points.
            known: (P,) which of them are measured.
            wrist: (10, 4) wxyz, world: how the hand of each finger is turned.
            before: (30, 4) what a joint keeps whose bone is not measured.
        """
        place, seen = position[self.points], known[self.points]
        bone = place[:, 1:] - place[:, :-1]
        seen = seen[:, 1:] & seen[:, :-1]
        bone = np.where(seen[..., None], bone, self._rest)
        length = np.sqrt(np.einsum("fki,fki->fk", bone, bone))
        seen &= length > _SHORTEST
        bone /= np.maximum(length, _SHORTEST)[..., None]
        local, world = before.reshape(-1, 3, 4).copy(), wrist
        for k in range(3):
            matrix = ((world[:, :, None] * world[:, None, :]).reshape(-1, 16) @ MATRIX).reshape(-1, 3, 3)
            toward = np.einsum("fji,fj->fi", matrix, bone[:, k])
            local[:, k] = np.where(seen[:, k, None], shortest_arc(self._direction[:, k], toward), local[:, k])
            world = multiply(world, local[:, k])
        return local.reshape(-1, 4)

    def hands_known(self, known: np.ndarray) -> np.ndarray:
        """(2,) of which hand any bone of a finger is measured."""
        seen = known[self.points]
        return np.any((seen[:, 1:] & seen[:, :-1]).reshape(2, -1), axis=1)
