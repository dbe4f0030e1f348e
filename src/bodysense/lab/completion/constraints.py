"""What a completed body must keep to: measured points and rotations, bones, joints' senses, the floor, held feet.

Everything is in the world, batched over bodies (B), and made of operations that any runtime has. Rotations are world ←
joint; a rotation changed here never moves another joint's rotation, only places.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.lab.completion.network import CONTACT

_TINY = 1e-9
_SKELETON = default_skeleton()
POINTS, JOINT_COUNT = len(_SKELETON.points), len(_SKELETON.joints)
HEAD = BODY.index("head")
# Joints with several children: turned by three points that are seen. Joint, then the ends of two vectors.
_BRANCHING = (
    ("pelvis", ("right_hip", "left_hip"), ("pelvis", "spine1")),
    ("spine3", ("right_collar", "left_collar"), ("spine3", "neck")),
    ("left_wrist", ("left_wrist", "left_middle1"), ("left_pinky1", "left_index1")),
    ("right_wrist", ("right_wrist", "right_middle1"), ("right_pinky1", "right_index1")),
)
_LIMBS = [[f"{side}_{part}" for part in ("shoulder", "elbow", "wrist")] for side in ("left", "right")]
_LIMBS += [[f"{side}_{part}" for part in ("hip", "knee", "ankle")] for side in ("left", "right")]
# Where the middle joint of a bent limb points, in the upper bone's frame: elbows back, knees forward.
_MIDDLE = np.array([[0.0, 0, -1], [0, 0, -1], [0, 0, 1], [0, 0, 1]])
STRAIGHT = 0.9995  # of a limb's length: it is never quite straight
BENT = 0.02  # m: share of the middle joint's natural side in where it points, what decides a straight limb
LONGEST_REACH = 0.12  # m that a collar gives an arm which is too short


class Indices(NamedTuple):
    """Places of joints and points in the arrays, as constants."""

    triad: np.ndarray  # (4, 5) joint, from, to, from, to
    swung: np.ndarray  # (48,) joints with one child
    child: np.ndarray  # (48,) that child, a point
    limbs: np.ndarray  # (3, 4) start, middle and end of arms and legs
    parents: np.ndarray  # (64,) of every point but the root
    joint_parents: np.ndarray  # (51,) of every joint but the root
    from_head: np.ndarray  # (65, 64) bones → places from the head
    feet: np.ndarray  # (2, 3) ankle, ball and toe tip


def indices() -> Indices:
    """The places for the default skeleton's tree."""
    at = _SKELETON.index
    triad = np.array([[at(joint), at(a), at(b), at(c), at(d)] for joint, (a, b), (c, d) in _BRANCHING])
    branching = {*triad[:, 0]}
    swung = [joint for joint in range(JOINT_COUNT) if joint not in branching]
    child = [next(p for p in range(POINTS) if _SKELETON.parents[p] == joint) for joint in swung]
    path = _SKELETON.path - _SKELETON.path[HEAD]
    feet = np.array([[at(f"{side}_{part}") for part in ("ankle", "foot", "toe")] for side in ("left", "right")])
    limbs = np.array([[at(name) for name in limb] for limb in _LIMBS]).T
    parents = np.array(_SKELETON.parents[1:])
    return Indices(
        triad, np.array(swung), np.array(child), limbs, parents, parents[: JOINT_COUNT - 1], path[:, 1:], feet
    )


def length(vector: Tensor) -> Tensor:
    """(..., n) → (..., 1), never zero."""
    return torch.linalg.vector_norm(vector, dim=-1, keepdim=True).clamp(min=_TINY)


def unit(vector: Tensor) -> Tensor:
    """(..., n) of length one."""
    return vector / length(vector)


def dot(a: Tensor, b: Tensor) -> Tensor:
    """(..., n), (..., n) → (..., 1)."""
    return (a * b).sum(dim=-1, keepdim=True)


def cross(a: Tensor, b: Tensor) -> Tensor:
    """(..., 3), (..., 3) → (..., 3); few operations in an exported file."""
    after = torch.tensor([1, 2, 0], device=a.device)
    return (a * b.index_select(-1, after) - a.index_select(-1, after) * b).index_select(-1, after)


def applied(rotation: Tensor, vector: Tensor) -> Tensor:
    """(..., 3, 3), (..., 3) → (..., 3)."""
    return (rotation @ vector.unsqueeze(-1)).squeeze(-1)


def turned_onto(rotation: Tensor, before: Tensor, after: Tensor) -> Tensor:
    """Rotations (..., 3, 3) followed by the smallest turn that takes direction `before` (..., 3) onto `after`.

    Two reflections make that turn, so that a rotation stays one to rounding. Opposite directions turn about any axis.
    """
    u = unit(before)
    middle = unit(u + unit(after) + u.new_tensor([0.4e-5, 0.5e-5, 0.8e-5]))
    return _reflected(_reflected(rotation, u), middle)


def _reflected(rotation: Tensor, normal: Tensor) -> Tensor:
    """Columns of (..., 3, 3) mirrored at the plane across unit `normal` (..., 3)."""
    return rotation - (2 * normal).unsqueeze(-1) * (normal.unsqueeze(-2) @ rotation)


def frame_of(first: Tensor, second: Tensor) -> Tensor:
    """Orthonormal rows (..., 3, 3): the first along `first`, the second toward `second`."""
    x = unit(first)
    z = unit(cross(x, second))
    return torch.cat([x, cross(z, x), z], dim=-1).unflatten(-1, (3, 3))


def bent_limbs(
    start: Tensor,
    middle: Tensor,
    end: Tensor,
    target: Tensor,
    pole: Tensor,
    natural: Tensor,
    bias: Tensor,
    one_sided: Tensor | None,
) -> tuple[Tensor, Tensor]:
    """Bend limbs so that their ends come to `target` and their middle joints lie toward `pole`.

    Args:
        start, middle, end: (B, N, 3) m, the limb as it is.
        target: (B, N, 3) m; out of reach, the limb points at it.
        pole: (B, N, 3) m, where the middle joint would be.
        natural: (B, N, 3) unit, the side to which the middle joint of a limb goes that is nearly straight.
        bias: (B, N, 1) m, by how much it is drawn there.
        one_sided: (B, N, 1) 1 where the middle joint never leaves that side; None: nowhere.

    Returns the new places (B, N, 3) of the middle joints and of the ends.
    """
    a, b = length(middle - start), length(end - middle)
    toward = target - start
    far = length(toward)
    n = toward / far
    d = torch.minimum(torch.maximum(far, (a - b).abs() + 1e-3), STRAIGHT * (a + b))
    x = (a * a - b * b + d * d) / (2 * d)
    h = torch.sqrt(torch.clamp(a * a - x * x, min=0.0))
    side = pole - start
    side = side - n * dot(side, n)
    if one_sided is not None:
        usual = unit(natural - n * dot(natural, n))
        side = side - torch.clamp(dot(side, usual), max=0.0) * one_sided * usual + bias * usual
    else:
        side = side + bias * natural
        side = side - n * dot(side, n)
    return start + x * n + h * unit(side), start + d * n


class FootState(NamedTuple):
    """What holds each foot, left and right."""

    held: Tensor  # (B, 2) -1 free, 0 by its ankle, 1 by its ball
    anchor: Tensor  # (B, 2, 2) m: where that stands, x and z
    shift: Tensor  # (B, 2, 2) m: how far the foot is moved, x and z


HOLD, RELEASE = 0.6, 0.4  # probability of contact from which a foot is held, and below which it is let go
FADE = 0.1  # s in which half of what a released foot was held back by fades
DRAG = 0.12  # m: a foot that its leg drags farther slides along
LIFT = 0.5  # m: no foot is lifted farther to be on the floor


def held_feet(
    foot: Tensor, contact: Tensor, interval: Tensor, floor: Tensor, hold: Tensor, state: FootState
) -> tuple[Tensor, FootState]:
    """By how much (B, 2, 3) m to move each foot so that it stands still and not under the floor.

    Args:
        foot: (B, 2, 3, 3) m: ankle, ball and toe tip.
        contact: (B, 2, 2) probability that ankle and ball stand.
        interval: (B,) s.
        floor: (B,) m, its height.
        hold: (B,) 1 where feet are to be held and kept above the floor, 0 where not.
        state: of the frame before.
    """
    shift = state.shift * torch.exp2(-interval / FADE)[:, None, None]
    ankle, ball = contact[..., 0], contact[..., 1]
    was = state.held >= 0
    by_ball = torch.where(was, state.held, (ball >= ankle).to(ball))
    likely = ankle + by_ball * (ball - ankle)
    let_go = was & (likely < RELEASE)
    # A part that lets go may hand over to the other one at once.
    by_ball = torch.where(let_go, (ball >= ankle).to(ball), by_ball)
    likely = ankle + by_ball * (ball - ankle)
    stays = was & ~let_go
    holds = (stays | (likely >= HOLD)) & (hold[:, None] > 0.5)
    flat = foot[..., :2, ::2]
    standing = flat[..., 0, :] + by_ball[..., None] * (flat[..., 1, :] - flat[..., 0, :])
    anchor = torch.where((holds & ~stays)[..., None], standing + shift, state.anchor)
    pull = anchor - standing
    pull = pull * torch.clamp(DRAG / length(pull), max=1.0)
    shift = torch.where(holds[..., None], pull, shift) * hold[:, None, None]
    anchor = torch.where(holds[..., None], standing + pull, anchor)
    depth = floor[:, None] - foot[..., 1].amin(dim=-1)
    lift = torch.clamp(depth, min=0.0, max=LIFT) * hold[:, None]
    move = torch.cat([shift[..., :1], lift[..., None], shift[..., 1:]], dim=-1)
    return move, FootState(torch.where(holds, by_ball, -1.0), anchor, shift)


CONTACT_BY_FOOT = [[CONTACT.index(f"{side}_{part}") for part in ("ankle", "foot")] for side in ("left", "right")]
MIDDLE_SIDE, ONE_SIDED = _MIDDLE, np.array([[0.0], [0.0], [1.0], [1.0]])
