"""Scenes that the tables score: recorded clips on their own and on unseen bodies, and what the tracker knows."""

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
from bodysense.body.shape import Split as BodySplit
from bodysense.body.shape import sample_bodies, stature
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.devices.simulated.headset_camera import see_points
from bodysense.devices.simulated.sensing import observe_points
from bodysense.devices.simulated.sensors import SensorSet
from bodysense.geometry.rotation import heading
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense.quality.metrics import joint_error
from bodysense_lab.completion.training.options import Body
from bodysense_lab.core.scoring import RATE, group_of

Truth = Literal["own", "stranger"]
# The body that moves in each column of a table. The last three differ in what the tracker knows of it.
TRUTH_OF: dict[Body, Truth] = {"own": "own", "stranger": "stranger", "height": "stranger", "nothing": "stranger"}
UNSEEN_BODIES = 512  # unseen bodies of a split; each clip moves one of them
_MOST_CLIPS, _MOST_FRAMES = 32, 24_000  # limits of a batch: clips, and frames after padding


@dataclass(frozen=True, eq=False)
class TrackedScene:
    """A clip on one body at `RATE`, as ground truth."""

    name: str
    group: str  # category group: main, sport, dance or other
    pose: Pose  # (T,)
    person: str = ""

    def __len__(self) -> int:
        return int(self.pose.root_position.shape[0])

    @property
    def skeleton(self) -> Skeleton:
        """Proportions of the body."""
        return self.pose.skeleton

    @property
    def time(self) -> np.ndarray:
        """Times of the frames (T,), s."""
        return np.arange(len(self)) / RATE

    @cached_property
    def world_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """World positions (T, P, 3) m and world rotations (T, J, 4) wxyz."""
        position, rotation = forward_kinematics(self.pose)
        return np.asarray(position), np.asarray(rotation)

    @cached_property
    def facing(self) -> np.ndarray:
        """Heading of the pelvis (T, 4), wxyz."""
        return np.asarray(heading(self.world_pose[1][:, 0]))

    @cached_property
    def visible(self) -> np.ndarray:
        """Points of the body that the cameras of a headset see (T, P), bool."""
        return see_points(self.skeleton, *self.world_pose).visible

    def observe(self, sensors: SensorSet) -> Observation:
        """Return the observation of the scene by a sensor set."""
        visible = self.visible if sensors.camera else None
        return observe_points(self.skeleton, *self.world_pose, self.time, sensors, visible)

    def error_from_head(self, position: np.ndarray) -> np.ndarray:
        """Return errors (T, 22), cm, of the joints of `BODY` relative to the head, for positions (T, P, 3) m."""
        body, head, truth = self.skeleton.indices(BODY), self.skeleton.index("head"), self.world_pose[0]
        return joint_error(position[:, body] - position[:, [head]], truth[:, body] - truth[:, [head]])

    def beginning(self, frames: int) -> TrackedScene:
        """Return the first `frames` frames of the scene."""
        return replace(self, pose=self.pose[:frames])


def scene_of(clip: Clip, truth: Truth, split: Split | Literal["all"]) -> TrackedScene:
    """Return the scene of a clip on its own body, or on the unseen body of its name."""
    clip = resample(clip, RATE)
    pose = clip.pose if truth == "own" else retarget(clip.pose, unseen_body(clip, split))
    return TrackedScene(f"{clip.person}/{clip.name}", group_of(clip), pose, clip.person)


def unseen_body(clip: Clip, split: Split | Literal["all"]) -> Skeleton:
    """Return the unseen body of a clip: one of the split's bodies, chosen by a hash of the clip's name."""
    bodies = _unseen_bodies(body_split(split))
    digest = hashlib.sha256(f"{clip.person}/{clip.name}".encode()).digest()
    return clip.pose.skeleton.with_offsets(bodies[int.from_bytes(digest[:8], "big") % len(bodies)])


def body_split(split: Split | Literal["all"]) -> BodySplit:
    """Return the split of bodies for a split of motion; `all` has test bodies."""
    if split == "train":
        return "train"
    return "validation" if split == "val" else "test"


@lru_cache(maxsize=3)
def _unseen_bodies(split: BodySplit) -> np.ndarray:
    return sample_bodies(split, UNSEEN_BODIES)


def person_of(body: Body, skeleton: Skeleton) -> Person:
    """Return the person that the tracker is given, for a wearer with these proportions."""
    if body == "height":
        return Person(height=float(stature(skeleton.rest_offset)))
    return Person() if body == "nothing" else Person(skeleton)


def batches(clips: Iterable[Clip]) -> Iterator[list[Clip]]:
    """Yield batches of clips of similar duration, the longest first, small enough to limit padding and memory."""
    batch: list[Clip] = []
    for clip in sorted(clips, key=lambda clip: clip.seconds, reverse=True):
        longest = batch[0].seconds if batch else 0.0
        if batch and (len(batch) == _MOST_CLIPS or (len(batch) + 1) * longest * RATE > _MOST_FRAMES):
            yield batch
            batch = []
        batch.append(clip)
    if batch:
        yield batch


def stack_observations(observations: Sequence[Observation]) -> Observation:
    """Stack observations (T, P) of the same points to one (B, T, P); shorter ones repeat their last frame."""
    longest = max(observations, key=len)
    last = [np.minimum(np.arange(len(longest)), len(one) - 1) for one in observations]
    names = ["position", "rotation", "has_position", "has_rotation", "accuracy"]
    names += [] if longest.acceleration is None else ["acceleration"]
    values = {
        name: np.stack([getattr(one, name)[frames] for one, frames in zip(observations, last, strict=True)])
        for name in names
    }
    return replace(longest, **values)
