"""What the networks of a glove learn from: frames of hands with all markers, in the hand's own axes and at one size."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace

import numpy as np

from bodysense.body.glove import MARKERS, default_glove, hand_size, marker_positions, template
from bodysense.body.hand import angles_of
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_conjugate, quaternion_rotate
from bodysense.data.hand_motion import HandMotion
from bodysense.data.hand_synthesis import varied_hand
from bodysense.errors import BodysenseError

_MIRROR = np.array([-1.0, 1.0, 1.0])  # from one hand's world to the other's (`body.hand`)


@dataclass(frozen=True, eq=False)
class GloveFrames:
    """N frames of K motions, one motion after the other: from the wrist, in its axes, lengths over the size ratio.

    The size ratio is that of the hand to the one that the glove's template is of.
    """

    markers: np.ndarray  # (N, 9, 3) float32, m
    other: np.ndarray  # (N, 9, 3) m, of the person's other hand as this one sees it; NaN where there is none
    points: np.ndarray  # (N, 21, 3) m
    angles: np.ndarray  # (N, 26) rad
    motion: np.ndarray  # (N,) which motion a frame is of
    hand: np.ndarray  # (K, 20) m, lengths of bones
    rest: np.ndarray  # (K, 21, 3) m, resting offsets
    template: np.ndarray  # (K, 9, 3) m, what markers are registered to

    def __len__(self) -> int:
        return len(self.motion)

    def only(self, rows: np.ndarray) -> GloveFrames:
        """Some of the frames: (N,) bool."""
        per_frame = ("markers", "other", "points", "angles", "motion")
        return replace(self, **{name: getattr(self, name)[rows] for name in per_frame})


@dataclass(frozen=True)
class HandVariation:
    """How hands and gloves differ from those of the recording."""

    hand: float = 0.0  # spread of the lengths of bones, as a share
    placement: float = 0.0  # m, how far markers of fingers are off their place


AS_RECORDED = (HandVariation(),)
VARIATIONS = (
    *AS_RECORDED,
    HandVariation(hand=0.05, placement=0.001),
    HandVariation(hand=0.1),
    HandVariation(hand=0.1, placement=0.002),
)


def frames_of(
    motion: HandMotion, variation: HandVariation, rng: np.random.Generator, other: HandMotion | None = None
) -> GloveFrames:
    """The frames of one motion, on a hand varied from its own; `other` is the person's other hand, at the same times.

    Raises BodysenseError where both hands have not the same number of frames.
    """
    pose = _varied(motion.pose, variation, rng)
    ratio = hand_size(pose.skeleton) / default_glove().size
    local = _from_wrist(pose)
    seen = np.full((len(motion), len(MARKERS), 3), np.nan)
    if other is not None:
        if len(other) != len(motion):
            raise BodysenseError(f"hands: {len(motion)} and {len(other)} frames; both need the same times")
        markers = _MIRROR * marker_positions(default_glove(), _varied(other.pose, variation, rng))
        away = quaternion_conjugate(pose.rotation[:, :1])
        seen = quaternion_rotate(away, markers - pose.root_position[:, None])
    points, _ = forward_kinematics(local)
    return GloveFrames(
        markers=(_worn(local, variation, rng) / ratio).astype(np.float32),
        other=(seen / ratio).astype(np.float32),
        points=(points / ratio).astype(np.float32),
        angles=angles_of(pose.rotation[:, 1:]).astype(np.float32),
        motion=np.zeros(len(motion), dtype=np.int64),
        hand=(pose.skeleton.bone_length[None, 1:] / ratio).astype(np.float32),
        rest=(pose.skeleton.rest_offset[None] / ratio).astype(np.float32),
        template=template(default_glove(), pose.skeleton)[None] / ratio,
    )


def join(parts: Iterable[GloveFrames]) -> GloveFrames:
    """All motions together. Raises BodysenseError where there is none."""
    several = list(parts)
    if not several:
        raise BodysenseError("gloves: no motion with fingers; give motion with recorded fingers")
    joined = {
        field.name: np.concatenate([getattr(part, field.name) for part in several])
        for field in fields(GloveFrames)
        if field.name != "motion"
    }
    before = np.cumsum([0, *(len(part.hand) for part in several[:-1])])
    motion = np.concatenate([part.motion + count for part, count in zip(several, before, strict=True)])
    return GloveFrames(motion=motion, **joined)


def _varied(pose: Pose, variation: HandVariation, rng: np.random.Generator) -> Pose:
    """The same motion on another hand."""
    return replace(pose, skeleton=varied_hand(pose.skeleton, variation.hand, rng)) if variation.hand else pose


def _from_wrist(pose: Pose) -> Pose:
    """The pose with its wrist at the origin, not turned."""
    rotation = np.array(pose.rotation, dtype=float)
    rotation[:, 0] = [1.0, 0.0, 0.0, 0.0]
    return Pose(pose.skeleton, np.zeros_like(pose.root_position), rotation)


def _worn(pose: Pose, variation: HandVariation, rng: np.random.Generator) -> np.ndarray:
    """Markers (T, 9, 3) m of a glove that is worn a little askew."""
    glove, skeleton = default_glove(), pose.skeleton
    offset = glove.offset * (hand_size(skeleton) / glove.size)
    return marker_positions(glove, pose, offset + rng.normal(0.0, 1.0, offset.shape) * variation.placement)
