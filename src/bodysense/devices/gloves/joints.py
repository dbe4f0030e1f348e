"""From nine markers of a hand to its pose: registration, angles from a network, fingers aimed at their markers.

The hand is placed by its alignment markers (4.2), the joint network predicts 26 angles from the markers in the hand's
axes (4.8), a calibration corrects them (4.4), and every finger is turned at its base to its marker (4.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.glove import ALIGNMENT, Glove, template
from bodysense.body.hand import default_axes, joint_rotations, own_axes, per_joint
from bodysense.body.products import multiply
from bodysense.body.registration import brought_back, fit, moved
from bodysense.body.rotation import quaternion_canonical
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.fingers import HandPoses, HandShape, hand_shape, pointed
from bodysense.devices.gloves.networks import HandNetwork, known_shapes, size_ratios


@dataclass(frozen=True, eq=False)
class JointReader:
    """Poses of H hands from complete markers.

    Every hand wears one of `gloves`; its joints turn about the default hand's axes turned by `axes` (H, 15, 4), and
    `calibration` (H, 15, 4) follows every local rotation.
    """

    model: HandNetwork
    hands: Sequence[Skeleton]
    gloves: Sequence[Glove]
    restraint: float = 0.0  # of fingers' large turns to their markers
    calibration: np.ndarray | None = None
    axes: np.ndarray | None = None

    @cached_property
    def shape(self) -> HandShape:
        """The hands' constants."""
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
        flat = [template(*worn)[list(ALIGNMENT)] for worn in zip(self.gloves, self.hands, strict=True)]
        return np.stack(flat)

    def read(self, markers: np.ndarray) -> HandPoses:
        """Return poses from markers (H, 9, 3) m without missing ones."""
        quaternion, rotation, root = self._placed(markers)
        own = brought_back(markers, rotation, root)
        local, points = pointed(self._local(own), own, self.shape, self.restraint)
        turned = np.empty((len(markers), 16, 4))
        turned[:, 0] = quaternion
        turned[:, 1:] = local
        return HandPoses(root, turned, moved(points, rotation, root))

    def angles(self, markers: np.ndarray) -> np.ndarray:
        """Return the network's angles (H, 26) rad for markers (H, 9, 3) m."""
        _, rotation, root = self._placed(markers)
        return self._angles(brought_back(markers, rotation, root))

    def told(self, markers: np.ndarray) -> np.ndarray:
        """Return the network's local rotations (H, 15, 4), before fingers are aimed at their markers."""
        _, rotation, root = self._placed(markers)
        return np.asarray(quaternion_canonical(self._local(brought_back(markers, rotation, root))))

    def _placed(self, markers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the wrists' quaternions (H, 4), rotations (H, 3, 3) and places (H, 3) m by the alignment markers."""
        seen = markers.take(ALIGNMENT, axis=1)
        return fit(self._back, seen, np.ones(seen.shape[:2], dtype=bool))

    def _local(self, own: np.ndarray) -> np.ndarray:
        """Return the network's local rotations (H, 15, 4) for markers (H, 9, 3) m in the hands' axes, calibrated."""
        local = joint_rotations(per_joint(self._angles(own)), self._own_axes)
        return local if self.calibration is None else multiply(local, self.calibration)

    def _angles(self, own: np.ndarray) -> np.ndarray:
        single = (own / self._ratio).astype(np.float32)
        return self.model.run(single.reshape(len(single), -1), self._shapes).astype(float)
