"""Training frames of the networks of a glove: hands with all markers, in the hand's own axes and at one size."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from bodysense.body.hands.glove import default_glove, hand_size, marker_positions, template
from bodysense.body.hands.hand import angles_of
from bodysense.body.hands.hand_family import GlovedHand, plain_hand, transfer_pose
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.errors import BodysenseError
from bodysense_lab.synthesis.motion import HandMotion

RATE = 30.0  # Hz, of the frames that are learned


@dataclass(frozen=True, eq=False)
class GloveFrames:
    """N frames of K motions, one motion after the other: from the wrist, in its axes, lengths over the size ratio.

    The size ratio is that of the hand to the one that the glove's template is of.
    """

    markers: np.ndarray  # (N, 9, 3) float32, m
    points: np.ndarray  # (N, 21, 3) m
    angles: np.ndarray  # (N, 26) rad, about the hand's own axes
    motion: np.ndarray  # (N,) which motion a frame is of
    rest: np.ndarray  # (K, 21, 3) m, resting offsets
    axes: np.ndarray  # (K, 15, 4) wxyz, of joints (`hand_family.GlovedHand`)
    template: np.ndarray  # (K, 9, 3) m, markers of the flat hand

    def __len__(self) -> int:
        return len(self.motion)


def frames_of(motion: HandMotion, hand: GlovedHand | None = None) -> GloveFrames:
    """Return the frames of one motion, on its own hand or on another one."""
    gloved = plain_hand(motion.pose.skeleton) if hand is None else hand
    pose = transfer_pose(motion.pose, gloved)
    ratio = hand_size(pose.skeleton) / default_glove().size
    rotation = np.array(pose.rotation, dtype=float)
    rotation[:, 0] = [1.0, 0.0, 0.0, 0.0]
    local = Pose(pose.skeleton, np.zeros_like(pose.root_position), rotation)  # the wrist is at the origin, unrotated
    points, _ = forward_kinematics(local)
    return GloveFrames(
        markers=(marker_positions(gloved.glove, local) / ratio).astype(np.float32),
        points=(points / ratio).astype(np.float32),
        angles=angles_of(motion.pose.rotation[:, 1:]).astype(np.float32),
        motion=np.zeros(len(motion), dtype=np.int64),
        rest=(pose.skeleton.rest_offset[None] / ratio).astype(np.float32),
        axes=gloved.axes[None].astype(np.float32),
        template=template(gloved.glove, pose.skeleton)[None] / ratio,
    )


def join(parts: Iterable[GloveFrames]) -> GloveFrames:
    """Join the frames of all motions. Raises BodysenseError if there are no motions."""
    several = list(parts)
    if not several:
        raise BodysenseError("gloves: no motion with fingers; give motion with recorded fingers")
    joined = {
        field.name: np.concatenate([getattr(part, field.name) for part in several])
        for field in fields(GloveFrames)
        if field.name != "motion"
    }
    before = np.cumsum([0, *(len(part.rest) for part in several[:-1])])
    motion = np.concatenate([part.motion + count for part, count in zip(several, before, strict=True)])
    return GloveFrames(motion=motion, **joined)
