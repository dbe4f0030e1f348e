"""Training windows of the networks of arms and hands: recorded motion seen by simulated cameras, and true rotations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.arms import ARM_JOINTS, CHEST, arm_rotations, arm_skeleton, with_arms
from bodysense.body.keypoints import ArmKeypoints, arms_from_torso
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import ARM, Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_exp,
    quaternion_identity,
    quaternion_multiply,
)
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.data.augment import with_limb_proportions
from bodysense_lab.data.windows import Windows, find_windows
from bodysense_lab.papers.pahmt.camera_view import sample_cameras, view, view_points
from bodysense_lab.papers.pahmt.features import Window, window_of
from bodysense_lab.papers.pahmt.keypoint_noise import detect
from bodysense_lab.papers.pahmt.options import VideoSimulation

RATE = 30.0  # Hz
FRAMES, STRIDE = 32, 5  # of a window, and from one to the next (section 4.2)
_HALF = len(ARM_JOINTS) // 2
_PARTNER = [*range(_HALF, 2 * _HALF), *range(_HALF)]
_STIFF = np.array([name.partition("_")[2] in ARM[:-1] for name in ARM_JOINTS])  # known without hands


@dataclass(frozen=True, eq=False)
class ArmRecordings:
    """Recordings at 30 Hz, concatenated."""

    points: np.ndarray  # (N, 2, 24, 3) float32 m, world: `view_points`
    rotation: np.ndarray  # (N, 38, 4) float32, local rotations of `ARM_JOINTS` (`arms_from_torso`)
    start: np.ndarray  # (C,) first frame of each clip
    length: np.ndarray  # (C,)
    fingers: np.ndarray  # (C,) bool: hands were recorded
    name: tuple[str, ...]
    category: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.name)

    @property
    def minutes(self) -> float:
        """Length of the motion."""
        return len(self.points) / RATE / 60

    def windows(self, stride: int = STRIDE, fingers: bool | None = True) -> Windows:
        """Return windows of clips with hands, without (False), or both (None). Raises BodysenseError without any."""
        chosen = np.ones(len(self), dtype=bool) if fingers is None else self.fingers == fingers
        found = find_windows(self.start[chosen], self.length[chosen], length=FRAMES, stride=stride)
        if not len(found):
            raise BodysenseError(f"no clip of {FRAMES} frames at {RATE:g} Hz among {len(self)}; give longer motion")
        return replace(found, clip=np.flatnonzero(chosen)[found.clip])


class ArmBatch(NamedTuple):
    """B windows of T frames, and the truth."""

    window: Window
    rotation: Tensor  # (B, T, 38, 4)
    known: Tensor  # (B, 38) bool: joints whose true rotation is known


def read_arm_recordings(
    clips: Iterable[Clip], bodies: int = 1, rng: np.random.Generator | None = None
) -> ArmRecordings:
    """Read every clip once as recorded and, with `rng`, `bodies` − 1 times augmented (`augmented`)."""
    at_rate = [resample(clip, RATE) for clip in clips]
    donors = [clip for clip in at_rate if clip.has_fingers]
    points, rotations, kept = [], [], []
    for clip in at_rate:
        others = [] if rng is None else [augmented(clip, donors, rng) for _ in range(bodies - 1)]
        for one in (clip, *others):
            points.append(view_points(one.pose).astype(np.float32))
            rotations.append(arms_from_torso(one.pose).astype(np.float32))
            kept.append(one)
    if not kept:
        raise BodysenseError("no motion to learn from; give a folder with clips")
    length = np.array([len(one) for one in points])
    return ArmRecordings(
        points=np.concatenate(points),
        rotation=np.concatenate(rotations),
        start=np.cumsum(length) - length,
        length=length,
        fingers=np.array([clip.has_fingers for clip in kept]),
        name=tuple(clip.name for clip in kept),
        category=tuple(clip.category for clip in kept),
    )


def augmented(clip: Clip, donors: Sequence[Clip], rng: np.random.Generator) -> Clip:
    """Augment a clip on the default body: other proportions, slow random arm motion, in half of them other arms."""
    other = replace(clip, pose=Pose(default_skeleton(), clip.pose.root_position, clip.pose.rotation))
    if clip.has_fingers and rng.random() < 0.5:
        other = with_arms_of(other, donors, rng)
    return with_limb_proportions(with_wandering_arms(other, rng.random(), rng), 0.05, rng)


def film(
    frames: ArmRecordings, windows: Windows, which: np.ndarray, studio: VideoSimulation, rng: np.random.Generator
) -> tuple[ArmKeypoints, np.ndarray]:
    """Return key-points (B, T) of windows `which` (B,), each by its own camera, and true rotations (B, T, 38, 4)."""
    row = windows.frames(which)
    if studio.begun:
        first = np.where(rng.random(len(row)) < studio.begun, rng.integers(1, windows.length, len(row)), 0)
        row = np.take_along_axis(row, np.maximum(np.arange(windows.length), first[:, None]), axis=1)
    points, rotation = frames.points[row], frames.rotation[row]
    if studio.mirrored:
        turned = rng.random(len(row)) < 0.5
        points = np.where(turned[:, None, None, None, None], points[:, :, ::-1] * [-1.0, 1, 1], points)
        reflected = rotation[:, :, _PARTNER] * [1.0, 1, -1, -1]
        rotation = np.where(turned[:, None, None, None], reflected, rotation)
    camera = sample_cameras(points[:, windows.length // 2], rng, studio.cameras)
    seen = view(points, np.arange(windows.length) / RATE, camera)
    return seen if studio.noise is None else detect(seen, studio.noise, rng), rotation


def make_batch(
    frames: ArmRecordings, windows: Windows, which: np.ndarray, studio: VideoSimulation, rng: np.random.Generator
) -> ArmBatch:
    """`film`, as tensors."""
    keypoints, rotation = film(frames, windows, which, studio, rng)
    known = frames.fingers[windows.clip[which]][:, None] | _STIFF
    return ArmBatch(window_of(keypoints), torch.from_numpy(rotation.astype(np.float32)), torch.from_numpy(known))


@lru_cache(maxsize=1)
def arms_alone() -> Skeleton:
    """The arms of the default body, on which positions are compared ("a pre-defined character skeleton", eq. 17)."""
    return arm_skeleton(default_skeleton())


def arm_positions(rotation: Tensor, joints: Sequence[int]) -> Tensor:
    """Positions (..., 49, 3) m of `arms_alone`'s points, chest at the origin, of rotations (..., N, 4) of `joints`.

    `joints` are of `ARM_JOINTS`; all others are at rest.
    """
    skeleton = arms_alone()
    given = {joint: place for place, joint in enumerate(joints)}
    rest = quaternion_identity(rotation[..., :1, :])
    turns = [rotation[..., [given[joint]], :] if joint in given else rest for joint in range(len(ARM_JOINTS))]
    assert skeleton.joints[0] == CHEST
    pose = Pose(skeleton, torch.zeros_like(rotation[..., 0, :3]), torch.cat([rest, *turns], dim=-2))
    return forward_kinematics(pose)[0]


# Degrees by which a joint wanders, one deviation; of fingers every joint. Elbows stay hinges.
_WANDER = {"collar": 2.0, "shoulder": 12.0, "elbow": 4.0, "wrist": 12.0}
_WANDER_FINGER = 4.0
_WAVES, _SLOWEST, _FASTEST = 4, 0.05, 0.6  # number of sines that are added, and Hz


def with_arms_of(clip: Clip, donors: Sequence[Clip], rng: np.random.Generator) -> Clip:
    """The clip with each arm, hand included, from some stretch of some donor of the same rate, or of its mirror image.

    A donor that is shorter goes back and forth.
    """
    arms = arm_rotations(clip.pose)
    frames = np.arange(len(arms))
    for side in (0, 1):
        theirs = arm_rotations(donors[int(rng.integers(len(donors)))].pose)
        first = rng.integers(max(1, len(theirs) - len(arms) + 1))
        place = (first + frames) % max(1, 2 * len(theirs) - 2)
        place = np.minimum(place, 2 * len(theirs) - 2 - place) if len(theirs) > 1 else place
        other = int(rng.integers(2))
        taken = theirs[place, other * _HALF : (other + 1) * _HALF]
        arms[:, side * _HALF : (side + 1) * _HALF] = taken if other == side else taken * [1.0, 1, -1, -1]
    return replace(clip, pose=with_arms(clip.pose, arms))


def with_wandering_arms(clip: Clip, share: float, rng: np.random.Generator) -> Clip:
    """The clip with every joint of arms and hands turned slowly to and fro, by `share` of what joints wander."""
    spread = np.array([_WANDER.get(name.partition("_")[2], _WANDER_FINGER) for name in ARM_JOINTS])
    shape = (_WAVES, len(ARM_JOINTS), 3)
    rate, phase, size = (
        rng.uniform(_SLOWEST, _FASTEST, shape),
        rng.uniform(0, 2 * np.pi, shape),
        rng.standard_normal(shape),
    )
    wave = np.einsum("tkja,kja->tja", np.sin(2 * np.pi * rate * clip.time[:, None, None, None] + phase), size)
    turn = np.radians(share * spread)[:, None] * wave * np.sqrt(2 / _WAVES)
    arms = quaternion_multiply(arm_rotations(clip.pose), quaternion_exp(turn))
    return replace(clip, pose=with_arms(clip.pose, np.asarray(quaternion_canonical(arms))))
