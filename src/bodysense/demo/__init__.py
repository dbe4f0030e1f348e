"""The packaged demo performance."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import as_file, files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bodysense.io.clip import Clip

UNSEEN_BODY = 0  # index of the performer among the test bodies of the shape space


def packaged_performance() -> Clip:
    """Return the packaged motion: a wearer walks, turns, waves, sits, gestures, reaches and points."""
    from bodysense.io.formats.amass import read_amass

    with as_file(files("bodysense.demo").joinpath("performance.npz")) as path:
        return replace(read_amass(path), name="performance")


def performance_of_unseen_body() -> Clip:
    """Return the packaged performance on a body that was in no network's training data."""
    from bodysense.body.retarget import retarget
    from bodysense.body.shape import sample_bodies

    clip = packaged_performance()
    skeleton = clip.pose.skeleton.with_offsets(sample_bodies("test", UNSEEN_BODY + 1)[UNSEEN_BODY])
    return replace(clip, name="performance on an unseen body", pose=retarget(clip.pose, skeleton))
