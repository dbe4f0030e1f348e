"""How a hand is turned, from the picture of its palm: two answers in closed form, mirror images in depth of each other.

The palm is taken for flat and far (weak perspective): a picture of it is s · P · R of its plane. Two columns of a
rotation have equal length and are at right angles, which leaves the scale s and the depths up to one sign (the
weak-perspective limit of Collins and Bartoli, "Infinitesimal Plane-based Pose Estimation", IJCV 2014).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from bodysense.body.arms import HAND_POINTS, SIDES
from bodysense.body.pose import forward_kinematics, rest_pose
from bodysense.body.rotation import cross, matrix_to_quaternion, normalize, quaternion_conjugate, quaternion_multiply
from bodysense.body.skeleton import default_skeleton

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
