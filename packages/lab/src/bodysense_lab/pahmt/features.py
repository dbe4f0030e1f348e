"""Inputs of the networks of arms and hands, computed from key-points inside them (PAHMT, section 3.4).

Each hand minus its wrist, divided by the longer side of its bounding box; directions of the arms in the torso's axes
("3D local location"); points that were not found repeat the frame before, zeros if nothing was found yet.

Windows for the networks of arms and hands: recorded motion before a camera, and the true rotations.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.arms import ARM_JOINTS, CHEST, HAND_POINTS, SIDES, arm_rotations, arm_skeleton, with_arms
from bodysense.body.keypoints import ArmKeypoints, arms_from_torso
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.rotation import (
    cross,
    matrix_to_quaternion,
    normalize,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_identity,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
)
from bodysense.body.skeleton import ARM, Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.augment import with_limb_proportions
from bodysense_lab.pahmt.camera_view import sample_cameras, view, view_points
from bodysense_lab.pahmt.keypoint_noise import detect
from bodysense_lab.pahmt.options import Studio
from bodysense_lab.windows import Windows, find_windows

PALM = tuple(HAND_POINTS.index(name) for name in ("wrist", "index1", "middle1", "ring1", "pinky1"))
_TINY = 1e-10  # squared heights of the picture


def palm_turns(hand: Tensor) -> Tensor:
    """Both turns (..., 2, 2, 4), camera ← wrist, of left and right hands from their points (..., 2, 21, 2), y up.

    The first axis of two is the hand, the second its answer: fingers lean toward the camera, or away.
    A hand of which all points are one has its palm in the picture's plane.
    """
    plane, inverse = (torch.tensor(values, dtype=hand.dtype) for values in _palms())
    points = hand[..., PALM, :]
    points = points - points.mean(dim=-2, keepdim=True)
    image = torch.einsum("hkp,...hpx->...hkx", inverse, points)  # the plane's axes in the picture, rows
    seen = (image * image).sum(dim=(-2, -1), keepdim=True) > _TINY
    image = torch.where(seen, image, torch.eye(2, dtype=hand.dtype))
    across, along = image[..., 0, :], image[..., 1, :]
    a, b, c = (across * across).sum(-1), (along * along).sum(-1), (across * along).sum(-1)
    size = (
        a + b + torch.sqrt((a - b) ** 2 + 4 * c * c)
    ) / 2  # the larger eigenvalue of image · imageᵀ: the scale squared
    deep = torch.stack(
        [torch.where(c > 0, -1.0, 1.0) * torch.sqrt((size - a).clamp(min=0)), (size - b).clamp(min=0).sqrt()], -1
    )
    scale = size.sqrt()[..., None]
    turns = []
    for sign in (1.0, -1.0):
        x, y = (torch.cat([flat, sign * deep[..., k, None]], dim=-1) / scale for k, flat in enumerate((across, along)))
        turns.append(matrix_to_quaternion(torch.stack([x, y, cross(x, y)], dim=-1)))
    rest = quaternion_conjugate(plane)[:, None].expand(*hand.shape[:-3], 2, 2, 4)
    return quaternion_multiply(torch.stack(turns, dim=-2), rest)


@lru_cache(maxsize=1)
def _palms() -> tuple[np.ndarray, np.ndarray]:
    """Turns (2, 4), wrist ← plane, of the default hands' palms, and maps (2, 2, N) from points to the plane's axes.

    The plane's x goes across, from the little finger to the index, its y along, from the wrist to the knuckles.
    """
    skeleton = default_skeleton()
    rest = np.asarray(forward_kinematics(rest_pose(skeleton))[0])
    turns, maps = [], []
    for side in SIDES:
        place = rest[skeleton.indices([f"{side}_{HAND_POINTS[k]}" for k in PALM])]
        along = np.asarray(normalize(place[1:].mean(axis=0) - place[0]))
        across = place[1] - place[-1]
        across = np.asarray(normalize(across - (across @ along) * along))
        turns.append(np.stack([across, along, np.cross(across, along)], axis=-1))
        maps.append(np.linalg.pinv((place - place.mean(axis=0)) @ turns[-1][:, :2]))
    return np.asarray(matrix_to_quaternion(np.array(turns))), np.array(maps)


_BOX = 0.1  # of the picture's height: a hand of this size is of size 0 to the network


class Window(NamedTuple):
    """Key-points of B windows; any finite number where nothing was found."""

    arm: Tensor  # (B, T, 2, 2, 3)
    has_arm: Tensor  # (B, T, 2) bool
    torso: Tensor  # (B, T, 4)
    has_torso: Tensor  # (B, T) bool
    hand: Tensor  # (B, T, 2, 21, 2)
    has_hand: Tensor  # (B, T, 2) bool


def window_of(keypoints: ArmKeypoints) -> Window:
    """Key-points with a batch axis (B, T, …) as the network takes them."""
    values = (getattr(keypoints, name) for name in Window._fields)
    tensors = (torch.as_tensor(value) for value in values)
    return Window(*(one if one.dtype == torch.bool else torch.nan_to_num(one.float()) for one in tensors))


class SeenWindow(NamedTuple):
    """Key-points that were found, or last found, in every frame of B windows."""

    shape: Tensor  # (B, T, 2, 21, 2) hands
    box: Tensor  # (B, T, 2) longer side of a hand's bounding box in this frame
    arms: Tensor  # (B, T, 2, 2, 3) directions in the camera's axes
    directions: Tensor  # the same in the torso's
    torso: Tensor  # (B, T, 4) its turn
    palms: Tensor  # (B, T, 2, 2, 4) torso ← wrist, both answers (`palm_turns`)


def seen_in(window: Window) -> SeenWindow:
    """Key-points with their gaps filled, in the axes that networks read."""
    size = window.hand.amax(dim=-2) - window.hand.amin(dim=-2)
    box = size.amax(dim=-1).clamp(min=1e-6)
    shape = (window.hand - window.hand[..., :1, :]) / box[..., None, None]
    shape = held(shape.flatten(-2), window.has_hand).unflatten(-1, (-1, 2))
    upright = torch.zeros_like(window.torso[:, :1])
    upright[..., 0] = 1.0
    torso = held(window.torso[..., None, :], window.has_torso[..., None], upright[..., None, :])[..., 0, :]
    arms = held(window.arm.flatten(-2), window.has_arm).unflatten(-1, (2, 3))
    inverse = quaternion_conjugate(torso)[..., None, None, :].expand(*arms.shape[:-1], 4)
    return SeenWindow(
        shape=shape,
        box=box,
        arms=arms,
        directions=quaternion_rotate(inverse, arms),
        torso=torso,
        palms=quaternion_multiply(inverse, palm_turns(shape)),
    )


def more_points(window: Window, seen: SeenWindow) -> Tensor:
    """Ours (B, T, 10, 3): arms in the camera's axes, the torso's turn, hands' place and size, and what was found."""
    place = torch.cat([window.hand[..., 0, :], torch.log(seen.box / _BOX)[..., None]], dim=-1)
    found = torch.cat([window.has_arm, window.has_torso[..., None]], dim=-1)
    found_hands = torch.cat([window.has_hand, torch.zeros_like(window.has_torso[..., None])], dim=-1)
    flags = torch.stack([found, found_hands], dim=-2).to(place.dtype)
    turned = quaternion_to_matrix(seen.torso).mT[..., :2, :]  # where its +x and +y point
    return torch.cat([seen.arms.flatten(-3, -2), turned, held(place, window.has_hand), flags], dim=-2)


def held(values: Tensor, known: Tensor, before: Tensor | None = None) -> Tensor:
    """Values (B, T, N, C); where they are not known (B, T, N) the last that were, at first `before` (B, 1, N, C) or 0.

    As in the frame before, and so on: the past of a window is in it.
    """
    first = torch.zeros_like(values[:, :1]) if before is None else before
    frame = torch.arange(1, known.shape[1] + 1, device=known.device)
    earlier = (frame[:, None] >= frame)[None, :, :, None] & known[:, None]  # (B, now, then, N)
    last = torch.where(earlier, frame[:, None], 0).amax(dim=2)
    return torch.take_along_dim(torch.cat([first, values], dim=1), last[..., None].expand_as(values), dim=1)


RATE = 30.0  # Hz
FRAMES, STRIDE = 32, 5  # of a window, and from one to the next (section 4.2)
_HALF = len(ARM_JOINTS) // 2
_PARTNER = [*range(_HALF, 2 * _HALF), *range(_HALF)]
_STIFF = np.array([name.partition("_")[2] in ARM[:-1] for name in ARM_JOINTS])  # known without hands


@dataclass(frozen=True, eq=False)
class ArmRecordings:
    """Recordings at 30 Hz, their frames one after the other."""

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
    known: Tensor  # (B, 38) bool: joints of which there is a truth


def read_arm_recordings(
    clips: Iterable[Clip], bodies: int = 1, rng: np.random.Generator | None = None
) -> ArmRecordings:
    """Read every clip once as recorded and, with `rng`, `bodies` − 1 times augmented (`varied`)."""
    at_rate = [resample(clip, RATE) for clip in clips]
    donors = [clip for clip in at_rate if clip.has_fingers]
    points, rotations, kept = [], [], []
    for clip in at_rate:
        others = [] if rng is None else [varied(clip, donors, rng) for _ in range(bodies - 1)]
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


def varied(clip: Clip, donors: Sequence[Clip], rng: np.random.Generator) -> Clip:
    """The clip on the default body with other proportions, arms that wander, half the time those of another clip."""
    other = replace(clip, pose=Pose(default_skeleton(), clip.pose.root_position, clip.pose.rotation))
    if clip.has_fingers and rng.random() < 0.5:
        other = with_arms_of(other, donors, rng)
    return with_limb_proportions(with_wandering_arms(other, rng.random(), rng), 0.05, rng)


def film(
    frames: ArmRecordings, windows: Windows, which: np.ndarray, studio: Studio, rng: np.random.Generator
) -> tuple[ArmKeypoints, np.ndarray]:
    """Key-points (B, T) of the windows `which` (B,), each by a camera of its own, and true rotations (B, T, 38, 4)."""
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
    frames: ArmRecordings, windows: Windows, which: np.ndarray, studio: Studio, rng: np.random.Generator
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
