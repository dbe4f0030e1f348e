"""Motion of hands, cut from recordings of whole bodies; every hand is a left hand (`body.hand`)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from bodysense.body.hands.hand import Side, hand_pose
from bodysense.body.pose import Pose
from bodysense.io.clip import Clip
from bodysense.io.resample import resample

RATE = 60.0  # Hz, the rate of the paper's recordings (two-hands, section 6.1.1)


@dataclass(frozen=True, eq=False)
class HandMotion:
    """One hand over time."""

    name: str  # of the recording
    pose: Pose  # (T, …) of a left hand, world; a right hand is mirrored at the plane x = 0, with its root
    frame_rate: float  # Hz
    category: str  # of the motion; empty if unknown
    side: Side  # of the recorded hand

    def __len__(self) -> int:
        return int(self.pose.root_position.shape[0])

    @property
    def seconds(self) -> float:
        """Length of the motion."""
        return len(self) / self.frame_rate


def hand_pairs(clips: Iterable[Clip], rate: float = RATE) -> Iterator[tuple[HandMotion, HandMotion]]:
    """Yield left and right hand of every clip with recorded fingers, at `rate` Hz, with the clip's bone lengths.

    Raises BodysenseError for a skeleton without fingers.
    """
    for clip in clips:
        if clip.has_fingers:
            body = resample(clip, rate)
            left = HandMotion(clip.name, hand_pose(body.pose, "left"), body.frame_rate, clip.category, "left")
            yield left, replace(left, pose=hand_pose(body.pose, "right"), side="right")


def hand_motions(clips: Iterable[Clip]) -> Iterator[HandMotion]:
    """Yield the hands of `hand_pairs` one by one."""
    for pair in hand_pairs(clips):
        yield from pair
