"""Pose of a hand from its nine markers: registration, angles from a network, fingers aimed at their markers.

The alignment markers give the wrist's position and rotation (4.2). The joint network predicts 26 angles from the
markers in the hand's axes (4.8). A calibration corrects them (4.4). Every finger is turned at its base to its marker
(4.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.hands.glove import ALIGNMENT, Glove, template
from bodysense.body.hands.hand import default_axes, joint_rotations, own_axes, per_joint
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.fingers import HandPoses, HandShape, aim_fingers, hand_shape
from bodysense.devices.gloves.networks import HandNetwork, known_shapes, size_ratios
from bodysense.geometry.products import multiply
from bodysense.geometry.registration import fit, to_hand, to_world
from bodysense.geometry.rotation import quaternion_canonical


@dataclass(frozen=True, eq=False)
class JointReader:
    """Solver of the poses of H hands from complete markers.

    Every hand has one of `gloves`. Its joints turn about the default hand's axes, rotated by `axes` (H, 15, 4).
    `calibration` (H, 15, 4) follows every local rotation.
    """

    model: HandNetwork
    hands: Sequence[Skeleton]
    gloves: Sequence[Glove]
    restraint: float = 0.0  # reduction of fingers' large turns to their markers
    calibration: np.ndarray | None = None
    axes: np.ndarray | None = None

    @cached_property
    def shape(self) -> HandShape:
        """Constants of the hands."""
        return hand_shape(self.hands, self.gloves)

    @cached_property
    def _own_axes(self) -> np.ndarray:
        return default_axes() if self.axes is None else own_axes(self.axes)

    @cached_property
    def _shapes(self) -> np.ndarray:
        return known_shapes(self.hands, self.gloves)

    @cached_property
    def _ratio(self) -> np.ndarray:
        return size_ratios(self.hands)[:, None, None]

    @cached_property
    def _back(self) -> np.ndarray:
        """(H, 3, 3) m, the alignment markers on flat hands."""
        flat = [template(*gloved)[list(ALIGNMENT)] for gloved in zip(self.gloves, self.hands, strict=True)]
        return np.stack(flat)

    def read(self, markers: np.ndarray) -> HandPoses:
        """Return poses from complete markers (H, 9, 3) m."""
        quaternion, rotation, root = self._register(markers)
        own = to_hand(markers, rotation, root)
        local, points = aim_fingers(self._local(own), own, self.shape, self.restraint)
        turned = np.empty((len(markers), 16, 4))
        turned[:, 0] = quaternion
        turned[:, 1:] = local
        return HandPoses(root, turned, to_world(points, rotation, root))

    def angles(self, markers: np.ndarray) -> np.ndarray:
        """Return the network's angles (H, 26) rad for markers (H, 9, 3) m."""
        _, rotation, root = self._register(markers)
        return self._angles(to_hand(markers, rotation, root))

    def local_rotations(self, markers: np.ndarray) -> np.ndarray:
        """Return the network's local rotations (H, 15, 4), before fingers are aimed at their markers."""
        _, rotation, root = self._register(markers)
        return np.asarray(quaternion_canonical(self._local(to_hand(markers, rotation, root))))

    def _register(self, markers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return quaternions (H, 4), rotations (H, 3, 3) and positions (H, 3) m of wrists by the alignment markers."""
        seen = markers.take(ALIGNMENT, axis=1)
        return fit(self._back, seen, np.ones(seen.shape[:2], dtype=bool))

    def _local(self, own: np.ndarray) -> np.ndarray:
        """Return the network's local rotations (H, 15, 4) for markers (H, 9, 3) m in the hands' axes, calibrated."""
        local = joint_rotations(per_joint(self._angles(own)), self._own_axes)
        return local if self.calibration is None else multiply(local, self.calibration)

    def _angles(self, own: np.ndarray) -> np.ndarray:
        single = (own / self._ratio).astype(np.float32)
        return self.model.run(single.reshape(len(single), -1), self._shapes).astype(float)
