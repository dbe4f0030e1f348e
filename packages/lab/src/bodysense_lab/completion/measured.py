"""Rotations that measured points tell: of joints that branch by three points, of others by where their bone points."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from bodysense.body.skeleton import default_skeleton
from bodysense_lab.completion.constraints import replacing
from bodysense_lab.completion.hands import from_wrists
from bodysense_lab.completion.masks import Condition, Conditions
from bodysense_lab.completion.points import JOINTS
from bodysense_lab.completion.state import JOINT_COUNT, POINT_COUNT
from bodysense_lab.completion.vectors import carried, frames, replaced, thrice, turned_onto

_SKELETON = default_skeleton()
_AT = _SKELETON.index
# Joints with several children: turned by points on them that are seen. Joint, then the ends of two vectors.
_BRANCHING = (
    ("pelvis", ("right_hip", "left_hip"), ("pelvis", "spine1")),
    ("spine3", ("right_collar", "left_collar"), ("spine3", "neck")),
    ("left_wrist", ("left_wrist", "left_middle1"), ("left_pinky1", "left_index1")),
    ("right_wrist", ("right_wrist", "right_middle1"), ("right_pinky1", "right_index1")),
)
_BRANCH_PLACES = [_AT(joint) for joint, _, _ in _BRANCHING]
CHILDREN = [_SKELETON.parents.index(joint) for joint in range(JOINT_COUNT)]  # the first child of each
UNTRACKED = 1e4  # m: the accuracy of a point that is not tracked
_LEAST_DOUBT = 1e-6  # m
_NO_LINE = 1e-8 * torch.tensor([[[1.0, 2, 3]], [[3, 1, -2]]])  # m: makes a frame of points that are all in one place


class Directions(NamedTuple):
    """Where measured children of joints are, and by how much to turn the joints there."""

    apart: Tensor  # (B, 1, N, 3) m, measured, from joint to child
    trust: Tensor  # (B, 1, N, 3) 0 to 1, thrice
    rest: Tensor  # (B, 3, N, 3) m, the child's rest offset as `spread`

    def turned(self, axes: Tensor) -> Tensor:
        """Axes (B, 3, N, 3) turned so that the joints point at their children."""
        before, after = self.bones(axes)
        return turned_onto(axes, before, after)

    def bones(self, axes: Tensor) -> tuple[Tensor, Tensor]:
        """The bones (B, 1, N, 3), m, that joints carry, and what they should be."""
        bone = carried(axes, self.rest)
        return bone, bone + self.trust * (self.apart - bone)


class MeasuredParts(NamedTuple):
    """What measured points say."""

    body: Directions  # of the 22 joints
    fingers: Directions  # of the 30 joints of both hands
    from_wrists: Tensor  # (B, 1, 40, 3) m: points of the hands from their wrists


class Branches(nn.Module):
    """Rotations of joints that branch, as the points on them imply.

    A hand whose wrist and knuckles are seen, or a pelvis with its hips and spine, has a rotation like any other.
    """

    ends: Tensor
    kept: Tensor

    def __init__(self) -> None:
        super().__init__()
        # Vectors at rest, of the joint's children from it, and now: the first of each joint, then the second.
        count = len(_BRANCHING)
        ends = torch.zeros(2, 2, count, 2 * POINT_COUNT)
        for k, (joint, *pairs) in enumerate(_BRANCHING):
            for vector, (begin, end) in enumerate(pairs):
                for name, sign in ((begin, -1), (end, 1)):
                    ends[vector, 1, k, POINT_COUNT + _AT(name)] = sign
                    if name != joint:
                        ends[vector, 0, k, _AT(name)] = sign
        implying = {_AT(joint): {_AT(joint), *map(_AT, (*first, *second))} for joint, first, second in _BRANCHING}
        self.conditions = Conditions(
            {
                "implied": [
                    Condition(implying.get(joint, ()), never=joint not in implying) for joint in range(JOINT_COUNT)
                ]
            }
        )
        self.register_buffer("ends", ends.reshape(4 * count, 2 * POINT_COUNT), persistent=False)
        kept = torch.tensor(replacing(JOINT_COUNT, _BRANCH_PLACES))
        self.register_buffer("kept", kept, persistent=False)

    def implied(self, masks: Tensor) -> Tensor:
        """(B, 52) 1 or 0: whose rotation points imply, for masks (B, 117) of positions and rotations."""
        return self.conditions(masks)["implied"]

    def forward(self, axes: Tensor, measured: Tensor, rest_offset: Tensor, near: Tensor) -> Tensor:
        """Axes (B, 3, 52, 3) as measured, those of joints that branch as implied where they are not.

        Args:
            axes: (B, 3, 52, 3).
            measured: (B, 1, 52, 3) 1 or 0, thrice: whose are measured.
            rest_offset: (B, 1, 65, 3) m.
            near: (B, 1, 65, 3) m, measured places.
        """
        count = len(_BRANCHING)
        ends = (self.ends @ torch.cat([rest_offset, near], dim=2)).reshape(-1, 2, 2 * count, 3) + _NO_LINE
        at_rest, now = frames(*ends.split(1, dim=1)).split(count, dim=2)
        implied = (at_rest.permute(0, 2, 3, 1) @ now.transpose(1, 2)).transpose(1, 2)
        return replaced(torch.cat([axes, implied], dim=2).index_select(2, self.kept), axes, measured)


class MeasuredDirections(nn.Module):
    """Turn joints by the points on them."""

    apart: Tensor
    child: Tensor
    doubt: Tensor
    least_doubt: Tensor

    def __init__(self) -> None:
        super().__init__()
        apart, doubt = torch.zeros(JOINT_COUNT, POINT_COUNT), torch.zeros(JOINT_COUNT, POINT_COUNT)
        least = torch.full((JOINT_COUNT,), _LEAST_DOUBT)
        least[_BRANCH_PLACES] = UNTRACKED
        for joint, child in enumerate(CHILDREN):
            apart[joint, child], apart[joint, joint] = 1, -1
            doubt[joint, [child, joint]] = 2
        for name, values in (
            ("apart", torch.cat([apart, from_wrists()])),
            ("child", torch.tensor(CHILDREN)),
            ("doubt", doubt),
            ("least_doubt", least),
        ):
            self.register_buffer(name, values, persistent=False)

    def forward(self, near: Tensor, rest: Tensor, accuracy: Tensor) -> MeasuredParts:
        """What points (B, 1, 65, 3) with `accuracy` (B, 65), m, say, for rest offsets (B, 3, 65, 3) as `spread`."""
        rest = rest.index_select(2, self.child)
        square = (rest * rest).sum(dim=1, keepdim=True)
        # Where points err as much as they are apart, their direction says little.
        doubt = nn.functional.linear(accuracy, self.doubt, self.least_doubt)
        trust = square / (square + thrice((doubt * doubt).reshape(-1, 1, JOINT_COUNT, 1)))
        fingers = JOINT_COUNT - JOINTS
        *apart, from_wrist = (self.apart @ near).split([JOINTS, fingers, self.apart.shape[0] - JOINT_COUNT], dim=2)
        parts = zip(apart, trust.split([JOINTS, fingers], dim=2), rest.split([JOINTS, fingers], dim=2), strict=True)
        body, hands = (Directions(*part) for part in parts)
        return MeasuredParts(body, hands, from_wrist)
