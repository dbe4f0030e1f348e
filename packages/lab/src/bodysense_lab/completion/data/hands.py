"""Hands of training sequences: recorded fingers, relative to tracked or estimated wrists."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense_lab.completion.data.points import FINGER_JOINTS, FINGER_OF, FINGERS, HAND_JOINTS, HAND_POINTS
from bodysense_lab.completion.data.sensor_draws import FingerMasks
from bodysense_lab.completion.data.smooth_noise import smooth_noise

RECORDED = HAND_JOINTS - len(BODY)  # (2, 15) indices of the joints in recorded fingers
# (15,) whether the joint is at a knuckle
_FIRST = np.array([default_skeleton().joints[j].endswith("1") for j in HAND_JOINTS[0]])
_WRIST_DEGREES, _WRIST_PLACE = 15.0, 0.06  # standard deviations, degrees and m, of errors of an estimated wrist


@dataclass(frozen=True, eq=False)
class TrainingHands:
    """Both hands of a sequence; the hand axis is left, right. Untracked points have any finite values."""

    true_position: np.ndarray  # (T, 2, 20, 3) float32 m, in the frame of the wrist
    true_rotation: np.ndarray  # (T, 2, 15, 4) float32 wxyz, wrist ← joint
    position: np.ndarray  # (T, 2, 20, 3) float32 m, as tracked, in the frame of the tracked wrist
    rotation: np.ndarray  # (T, 2, 15, 4) float32 wxyz, as tracked, wrist ← joint
    has_position: np.ndarray  # (T, 2, 20) bool
    has_rotation: np.ndarray  # (T, 2, 15) bool
    wrist: np.ndarray  # (T, 2, 3) float32 m, in the frame under the head, relative to the head
    wrist_rotation: np.ndarray  # (T, 2, 4) float32 wxyz, frame under the head ← wrist
    wrist_velocity: np.ndarray  # (T, 2, 3) float32 m/s, in that frame
    rest_offset: np.ndarray  # (2, 20, 3) float32 m, as known to the tracker

    def __len__(self) -> int:
        return len(self.wrist)


# Draws masks of fingers, given the frames in which cameras see each hand (T, 2), the interval in s and a generator.
DrawFingers = Callable[[np.ndarray, float, np.random.Generator], FingerMasks]


def with_finger_noise(local: np.ndarray, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Add slow random bending and spreading to local finger rotations (T, 2, 15, 4)."""
    frames = len(local)
    count = len(FINGERS)
    noise = smooth_noise(frames, 2 * count * 3, rate, 0.8, rng).reshape(frames, 2, count, 3)
    # Fingers bend about z, those of the left hand in the negative direction. They spread about y, at the knuckles.
    bend = (noise[..., 0] * 0.35 + rng.normal(0, 0.3, (2, count)))[..., FINGER_OF[:FINGER_JOINTS]]
    spread = (noise[..., 1] * 0.12)[..., FINGER_OF[:FINGER_JOINTS]] * _FIRST
    roll = (noise[..., 2] * 0.08)[..., FINGER_OF[:FINGER_JOINTS]] * _FIRST
    side = np.array([-1.0, 1.0])[:, None]
    vector = np.stack([roll, spread * side, bend * side], axis=-1)
    return quaternion_multiply(local, quaternion_exp(vector))


def hand_kinematics(local: np.ndarray, rest_offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations wrist ← joint (T, 2, 15, 4) and positions (T, 2, 20, 3) m in the frame of the wrist.

    Args:
        local: (T, 2, 15, 4) wxyz, parent ← joint.
        rest_offset: (2, 20, 3) m.
    """
    rotation = np.tile([1.0, 0.0, 0.0, 0.0], (len(local), len(default_skeleton().joints), 1))
    offset = np.zeros_like(default_skeleton().rest_offset)  # of a body with both wrists at the origin
    rotation[:, HAND_JOINTS], offset[HAND_POINTS] = local, rest_offset
    hands = Pose(default_skeleton().with_offsets(offset), np.zeros((len(local), 3)), rotation)
    position, world = forward_kinematics(hands)
    return np.asarray(world)[:, HAND_JOINTS], np.asarray(position)[:, HAND_POINTS]


def with_wrist_error(
    wrist: np.ndarray, place: np.ndarray, rate: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Add smooth errors of an estimated body to rotations (T, 2, 4) and positions (T, 2, 3) m of wrists."""
    frames = len(wrist)
    error = smooth_noise(frames, 2 * 6, rate, 1.5, rng).reshape(frames, 2, 6)
    turn = quaternion_exp(error[..., :3] * np.radians(_WRIST_DEGREES))
    return quaternion_multiply(turn, wrist), place + error[..., 3:] * _WRIST_PLACE
