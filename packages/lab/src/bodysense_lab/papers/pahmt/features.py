"""Inputs of the networks of arms and hands, computed from key-points inside them (PAHMT, section 3.4).

Each hand minus its wrist, divided by the longer side of its bounding box; directions of the arms in the torso's axes
("3D local location"); points that were not found repeat the frame before, zeros if nothing was found yet.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.arms import HAND_POINTS, SIDES
from bodysense.body.keypoints import ArmKeypoints
from bodysense.body.pose import forward_kinematics, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import (
    cross,
    matrix_to_quaternion,
    normalize,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
)

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
