"""The gate behind every reader of motions: doubts about a clip, as warnings with the option that settles each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.io.clip import Clip, part_joints
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.observing.world import moments
from bodysense.quality.plausible import doubts_about

_BODY = frozenset((*BODY, "left_toe", "right_toe"))


def checked(
    clip: Clip, warnings: Sequence[str] = (), known: Collection[str] = _BODY, options: ReadingOptions = AS_FOUND
) -> Clip:
    """Return a clip with warnings: those of its reader, and doubts about its body.

    `known` are the points that the file has; others were filled in, so that they are no evidence. `options` are those
    with which the file was read.
    """
    skeleton = clip.pose.skeleton
    made_up = part_joints(clip.lacks, skeleton.joints)
    names = [name for name in skeleton.points if name in _BODY and name in known and name not in made_up]
    first, later, moment = moments(len(clip), clip.frame_rate)
    place, after = (np.asarray(forward_kinematics(clip.pose[frames])[0]) for frames in (first, later))
    one, other = ({name: points[:, skeleton.index(name)] for name in names} for points in (place, after))
    found = doubts_about(one, other, moment, clip.frame_rate, unit=options.unit, left_handed=options.left_handed)
    return replace(clip, warnings=tuple(dict.fromkeys([*clip.warnings, *warnings, *(doubt.text for doubt in found)])))
