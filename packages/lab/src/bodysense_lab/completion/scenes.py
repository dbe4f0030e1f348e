"""The scenes that the tables score: recorded clips on own and on unseen bodies, and what the tracker knows of each."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.retarget import retarget
from bodysense.body.rotation import heading
from bodysense.body.shape import Split as BodySplit
from bodysense.body.shape import sample_bodies, stature
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.devices.simulated.headset_camera import see_points
from bodysense.devices.simulated.sensors import SensorSet, observe_points
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split
from bodysense.io.resample import resample
from bodysense.metrics import joint_error
from bodysense.observation import Observation
from bodysense_lab.completion.options import Body
from bodysense_lab.scoring import RATE, group_of

Truth = Literal["own", "stranger"]
# The body that moves in each column; the last three differ in what the tracker knows of it.
TRUTH_OF: dict[Body, Truth] = {"own": "own", "stranger": "stranger", "height": "stranger", "nothing": "stranger"}
STRANGERS = 512  # bodies of a split; each clip gets one
_MOST_CLIPS, _MOST_FRAMES = 32, 24_000  # of a batch; as many as the longest for each clip


@dataclass(frozen=True, eq=False)
class TrackedScene:
    """A clip on one body, at `RATE`: the truth."""

    name: str
    group: str  # category group: main, sport, dance, other
    pose: Pose  # (T,)
    person: str = ""

    def __len__(self) -> int:
        return int(self.pose.root_position.shape[0])

    @property
    def skeleton(self) -> Skeleton:
        """The wearer's proportions."""
        return self.pose.skeleton

    @property
    def time(self) -> np.ndarray:
        """(T,) s."""
        return np.arange(len(self)) / RATE

    @cached_property
    def placed(self) -> tuple[np.ndarray, np.ndarray]:
        """World positions (T, P, 3) m and world rotations (T, J, 4) wxyz."""
        position, rotation = forward_kinematics(self.pose)
        return np.asarray(position), np.asarray(rotation)

    @cached_property
    def facing(self) -> np.ndarray:
        """(T, 4) wxyz: the heading of the pelvis."""
        return np.asarray(heading(self.placed[1][:, 0]))

    @cached_property
    def visible(self) -> np.ndarray:
        """(T, P) bool: what the cameras of a headset see of the body."""
        return see_points(self.skeleton, *self.placed).visible

    def observe(self, sensors: SensorSet) -> Observation:
        """Return the observation of a set of sensors."""
        visible = self.visible if sensors.camera else None
        return observe_points(self.skeleton, *self.placed, self.time, sensors, visible)

    def error_from_head(self, position: np.ndarray) -> np.ndarray:
        """Errors (T, 22) of the joints of `BODY` from the head, cm, of positions (T, P, 3) m."""
        body, head, truth = self.skeleton.indices(BODY), self.skeleton.index("head"), self.placed[0]
        return joint_error(position[:, body] - position[:, [head]], truth[:, body] - truth[:, [head]])

    def beginning(self, frames: int) -> TrackedScene:
        """The first frames of the scene."""
        return replace(self, pose=self.pose[:frames])


def scene_of(clip: Clip, truth: Truth, split: Split | Literal["all"]) -> TrackedScene:
    """Return a clip at `RATE`, on its own body or on the unseen body drawn by its name."""
    clip = resample(clip, RATE)
    pose = clip.pose if truth == "own" else retarget(clip.pose, stranger_of(clip, split))
    return TrackedScene(f"{clip.person}/{clip.name}", group_of(clip), pose, clip.person)


def stranger_of(clip: Clip, split: Split | Literal["all"]) -> Skeleton:
    """Return the unseen body of a clip: fixed by the clip's name, from the bodies of the split."""
    bodies = _strangers(body_split(split))
    digest = hashlib.sha256(f"{clip.person}/{clip.name}".encode()).digest()
    return clip.pose.skeleton.with_offsets(bodies[int.from_bytes(digest[:8], "big") % len(bodies)])


def body_split(split: Split | Literal["all"]) -> BodySplit:
    """The bodies that belong to a split of motion; test bodies for all of it."""
    if split == "train":
        return "train"
    return "validation" if split == "val" else "test"


@lru_cache(maxsize=3)
def _strangers(split: BodySplit) -> np.ndarray:
    return sample_bodies(split, STRANGERS)


def person_of(body: Body, skeleton: Skeleton) -> Person:
    """Return what the tracker knows of a wearer with these proportions."""
    if body == "height":
        return Person(height=float(stature(skeleton.rest_offset)))
    return Person() if body == "nothing" else Person(skeleton)


def batches(clips: Iterable[Clip]) -> Iterator[list[Clip]]:
    """Clips of similar duration together, the longest first: few enough that padding and memory stay small."""
    batch: list[Clip] = []
    for clip in sorted(clips, key=lambda clip: clip.seconds, reverse=True):
        longest = batch[0].seconds if batch else 0.0
        if batch and (len(batch) == _MOST_CLIPS or (len(batch) + 1) * longest * RATE > _MOST_FRAMES):
            yield batch
            batch = []
        batch.append(clip)
    if batch:
        yield batch


def stacked(observations: Sequence[Observation]) -> Observation:
    """Observations (T, P) of the same points as one (B, T, P); shorter ones end with copies of their last frame."""
    longest = max(observations, key=len)
    last = [np.minimum(np.arange(len(longest)), len(one) - 1) for one in observations]
    names = ["position", "rotation", "has_position", "has_rotation", "accuracy"]
    names += [] if longest.acceleration is None else ["acceleration"]
    values = {
        name: np.stack([getattr(one, name)[frames] for one, frames in zip(observations, last, strict=True)])
        for name in names
    }
    return replace(longest, **values)
