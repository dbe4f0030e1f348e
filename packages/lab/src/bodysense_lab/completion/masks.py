"""What is tracked, as the graph needs it: conditions on several points at once, and weights among points.

All conditions come out of one matrix product, and so do the weights of all means over those points that are tracked:
a graph of few large operations is quicker than one of many small ones.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from bodysense_lab.completion.state import JOINT_COUNT, POINT_COUNT

_LEAST = 2.0**-14  # what a point counts that counts only where no other does; exact in half precision
FIRST, SECOND = 1e12, 1e6  # how much more a point counts that others only stand in for


class Condition:
    """That all of some points and rotations are tracked, and none of some others."""

    def __init__(
        self,
        points: Collection[int] = (),
        joints: Collection[int] = (),
        without_points: Collection[int] = (),
        without_joints: Collection[int] = (),
        never: bool = False,
    ) -> None:
        self.weight = np.zeros(POINT_COUNT + JOINT_COUNT, dtype=np.float32)
        self.weight[[*points, *(POINT_COUNT + joint for joint in joints)]] = 1
        self.weight[[*without_points, *(POINT_COUNT + joint for joint in without_joints)]] = -1
        self.bias = -1.0 if never else 1.0 - len(points) - len(joints)


class Conditions(nn.Module):
    """Named groups of conditions, each 1 where it holds, else 0."""

    weight: Tensor
    bias: Tensor

    def __init__(self, groups: Mapping[str, Sequence[Condition]]) -> None:
        super().__init__()
        self.sizes = {name: len(group) for name, group in groups.items()}
        every = [condition for group in groups.values() for condition in group]
        self.register_buffer("weight", torch.tensor(np.stack([each.weight for each in every])), persistent=False)
        self.register_buffer("bias", torch.tensor([each.bias for each in every]), persistent=False)

    def forward(self, tracked: Tensor) -> dict[str, Tensor]:
        """Groups (B, n) of masks (B, 117) of points and rotations."""
        # A sum of masks is whole: it is 1 where all of n are tracked and n - 1 is taken off, and 0 or less elsewhere.
        holds = torch.relu(nn.functional.linear(tracked, self.weight, self.bias))
        return dict(zip(self.sizes, holds.split(list(self.sizes.values()), dim=-1), strict=True))


class Means(nn.Module):
    """Named means over those points that are tracked, as matrices of weights; zero where none of them is."""

    weight: Tensor
    least: Tensor

    def __init__(self, groups: Mapping[str, Sequence[Mapping[int, float]]], last: Mapping[str, int]) -> None:
        """What counts.

        Args:
            groups: for each mean what its points count, by index; those that are absent do not count.
            last: by group, the point that counts where none is tracked, once a body has been shown.
        """
        super().__init__()
        self.sizes = {name: len(group) for name, group in groups.items()}
        rows = [row for group in groups.values() for row in group]
        weight = np.zeros((len(rows), POINT_COUNT), dtype=np.float32)
        for k, row in enumerate(rows):
            weight[k, list(row)] = list(row.values())
        names = [name for name, group in groups.items() for _ in group]
        least = np.zeros_like(weight)
        for k, name in enumerate(names):
            if name in last:
                least[k, last[name]] = _LEAST
        self.register_buffer("weight", torch.tensor(weight), persistent=False)
        self.register_buffer("least", torch.tensor(least), persistent=False)

    def forward(self, seen: Tensor, shown: Tensor) -> dict[str, Tensor]:
        """Weights (B, 1, n, 65) of each group.

        Args:
            seen: (B, 1, 1, 65) masks of points.
            shown: (B, 1, 1, 1) 1 once a body has been shown.
        """
        weights = seen * self.weight + shown * self.least
        weights = weights / weights.sum(dim=-1, keepdim=True).clamp(min=_LEAST)
        return dict(zip(self.sizes, weights.split(list(self.sizes.values()), dim=2), strict=True))
