"""Recorded clips of standing people, changed to rare postures (see `postures`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from bodysense.io.clip import Clip
from bodysense_lab.completion.data.postures.limbs import with_changed_body
from bodysense_lab.completion.data.postures.postures import KINDS, apply_posture, is_standing

_MOSTLY = 0.7  # smallest share of a clip in which its person stands


def posture_clips(clips: Iterable[Clip]) -> Iterator[Clip]:
    """Yield a changed copy of each clip whose person mostly stands; the postures alternate."""
    rng, kinds, turn = np.random.default_rng(9), [kind for kind in KINDS if kind != "standing"], 0
    for clip in clips:
        root, rest = clip.pose.root_position, clip.pose.skeleton.rest_offset
        if len(clip) < 2 or is_standing(root, float(rest[0, 1]), clip.frame_rate).mean() < _MOSTLY:
            continue
        kind, turn = kinds[turn % len(kinds)], turn + 1
        yield posture_clip(clip, kind, rng)


def posture_clip(clip: Clip, kind: str, rng: np.random.Generator) -> Clip:
    """Return a clip changed to a posture of `KINDS`; its fingers are unchanged."""
    offset = clip.pose.skeleton.rest_offset
    pose = with_changed_body(
        clip.pose, lambda rotation, root: apply_posture(rotation, root, offset, kind, clip.frame_rate, rng)
    )
    return replace(clip, name=f"{clip.name} ({kind})", category="sit", pose=pose)
