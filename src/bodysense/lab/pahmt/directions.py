"""Arms turned as their directions say, in closed form: what a network may take for an answer where it trusts them.

Two directions give all of an arm but what lies between its bones' axes: the plane of a bent elbow tells how the upper
arm is turned about itself. What they leave open, the twist of a straight arm and of the hand, collars, and what a
detector errs, is a network's to answer.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from bodysense.body.arms import SIDES, arm_skeleton
from bodysense.body.rotation import (
    cross,
    dot,
    matrix_to_quaternion,
    matrix_to_sixd,
    normalize,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
    shortest_arc,
    sixd_to_matrix,
)
from bodysense.body.skeleton import default_skeleton

_HINGE = ((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))  # of left and right: about it a straight elbow bends forward
_STRAIGHT = 0.3  # sine of the bend at which the plane of the arm counts as much as the way from rest
_BONES = slice(1, 3)  # upper arm and forearm among the joints of an arm: collar, they, wrist, fingers


def hinged(directions: Tensor) -> Tensor:
    """Turns (..., 2, 2, 4), torso ← bone, of left and right upper arm and forearm from their directions (..., 2, 2, 3).

    Directions are unit vectors in the torso's axes; of zero length where none is known: such an arm hangs.
    """
    down = torch.zeros_like(directions)
    down[..., 1] = -1.0
    known = dot(directions, directions) > 0.5
    directions = torch.where(known, directions, down)
    bone = normalize(torch.tensor(_bones(), dtype=directions.dtype)).expand_as(directions)
    hinge = torch.tensor(_HINGE, dtype=directions.dtype)
    upper, forearm = directions[..., 0, :], directions[..., 1, :]
    swung = quaternion_rotate(shortest_arc(bone[..., 0, :], upper), hinge.expand_as(upper))
    axis = (cross(upper, forearm) + _STRAIGHT * swung)[..., None, :].expand_as(directions)
    now, rest = (_frame(*pair) for pair in ((directions, axis), (bone, hinge[:, None].expand_as(bone))))
    return quaternion_multiply(now, quaternion_conjugate(rest))


def beside_directions(said: Tensor, gate: Tensor, bones: Tensor) -> Tensor:
    """Regressed rotations (..., 38, 6), upper arms and forearms of which are between what was said and directions.

    `gate` (..., 2, 2) is the share of directions, of left and right upper arm and forearm; `bones` as of `hinged`.
    """
    arms = said.unflatten(-2, (len(SIDES), -1))
    collar = matrix_to_quaternion(sixd_to_matrix(arms[..., :1, :]))
    above = torch.cat([collar, bones[..., :1, :]], dim=-2)
    given = matrix_to_sixd(quaternion_to_matrix(quaternion_multiply(quaternion_conjugate(above), bones)))
    share = gate[..., None]
    between = share * given + (1 - share) * arms[..., _BONES, :]
    return torch.cat([arms[..., :1, :], between, arms[..., _BONES.stop :, :]], dim=-2).flatten(-3, -2)


def beside_palms(said: Tensor, share: Tensor, palms: Tensor) -> Tensor:
    """Regressed rotations (..., 38, 6), wrists of which are between what was said and what pictures of palms say.

    `share` (..., 2, 3) of left and right hand is that of what was said and of either answer; `palms` (..., 2, 2, 4),
    torso ← wrist, as of `palm.palm_turns`.
    """
    arms = said.unflatten(-2, (len(SIDES), -1))
    collar, upper, lower = matrix_to_quaternion(sixd_to_matrix(arms[..., : _BONES.stop, :])).unbind(dim=-2)
    forearm = quaternion_multiply(quaternion_multiply(collar, upper), lower)
    above = quaternion_conjugate(forearm)[..., None, :].expand(palms.shape)
    given = matrix_to_sixd(quaternion_to_matrix(quaternion_multiply(above, palms)))
    wrist, fingers = arms[..., _BONES.stop, None, :], arms[..., _BONES.stop + 1 :, :]
    between = (share[..., None] * torch.cat([wrist, given], dim=-2)).sum(dim=-2, keepdim=True)
    return torch.cat([arms[..., : _BONES.stop, :], between, fingers], dim=-2).flatten(-3, -2)


@lru_cache(maxsize=1)
def _bones() -> np.ndarray:
    """Upper arms and forearms (2, 2, 3) of the default body at rest, m."""
    skeleton = arm_skeleton(default_skeleton())
    ends = [[f"{side}_{end}" for end in ("elbow", "wrist")] for side in SIDES]
    return skeleton.rest_offset[[skeleton.indices(two) for two in ends]]


def _frame(along: Tensor, axis: Tensor) -> Tensor:
    """Turns (..., 4) of frames whose x is `along` and whose y is as near to `axis` as it can."""
    y = normalize(axis - dot(axis, along) * along)
    return matrix_to_quaternion(torch.stack([along, y, cross(along, y)], dim=-1))
