"""The frame under the head, in which the network works."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from bodysense.body.skeleton import default_skeleton
from bodysense_lab.completion.points import HEAD
from bodysense_lab.completion.state import POINT_COUNT
from bodysense_lab.completion.vectors import heading_of, length, unit

PAIRS = [("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"), ("left_ankle", "right_ankle")]
_LEAST_TURN = 1e-6  # of a head that is upside down, whose own heading is none
_SHORTEST_LINE = 0.1  # m: a line from right to left that is shorter says no heading


class Frame(NamedTuple):
    """Which way the head looks, and where the floor is under it."""

    floor: Tensor  # (B, 1, 1, 3) m, from the base straight down to the floor: the origin of the frame
    heading: Tensor  # (B, 2) cosine and sine
    into: Tensor  # (B, 1, 3, 3): row vectors of the world @ this are those of the frame
    back: Tensor  # (B, 1, 3, 3), its inverse


class FrameFinder(nn.Module):
    """Find the frame under the head from whatever is tracked."""

    lines: Tensor
    line_to_heading: Tensor
    heading_to_turns: Tensor
    unturned: Tensor
    looking: Tensor
    looking_masks: Tensor
    up: Tensor

    def __init__(self) -> None:
        super().__init__()
        lines = torch.zeros(len(PAIRS), POINT_COUNT)
        for row, (left, right) in zip(lines, PAIRS, strict=True):
            row[default_skeleton().index(left)], row[default_skeleton().index(right)] = 1, -1
        # Cosine and sine → both matrices, row by row; the vertical is added.
        turns = torch.zeros(2, 2, 3, 3)
        turns[0, :, 0, 0] = turns[0, :, 2, 2] = 1
        turns[1, 0, 0, 2], turns[1, 0, 2, 0] = 1, -1
        turns[1, 1] = turns[1, 0].T
        unturned = torch.zeros(2, 3, 3)
        unturned[:, 1, 1] = 1
        for name, values in (
            ("lines", lines),
            ("line_to_heading", torch.tensor([[1.0, 0], [0, 0], [0, -1]])),
            ("heading_to_turns", turns.reshape(2, 18)),
            ("unturned", unturned.reshape(18)),
            ("looking", torch.tensor([HEAD, 0])),
            ("looking_masks", torch.tensor([POINT_COUNT + HEAD, POINT_COUNT])),
            ("up", torch.tensor([0.0, 1, 0])),
        ):
            self.register_buffer(name, values, persistent=False)

    def forward(
        self,
        near: Tensor,
        axes: Tensor,
        masks: Tensor,
        both: Tensor,
        base: Tensor,
        floor: Tensor,
        last: Tensor,
    ) -> Frame:
        """The frame of a step.

        Args:
            near: (B, 1, 65, 3) m, places as tracked, from the base.
            axes: (B, 3, 52, 3) as tracked.
            masks: (B, 117) what is tracked of positions and rotations.
            both: (B, 3) 1 where both ends of `PAIRS` are tracked.
            base: (B, 1, 1, 3) m, world.
            floor: (B,) m.
            last: (B, 2) heading in the frame before.
        """
        # The heading is the head's own, the pelvis's, that of lines from right to left, or what it was.
        line = both.unsqueeze(1) @ (self.lines @ near).squeeze(1) @ self.line_to_heading
        of_head, of_pelvis = heading_of(axes.index_select(2, self.looking)).split(1, dim=1)
        head_turned, pelvis_turned = (masks.index_select(1, self.looking_masks).unsqueeze(-1) > 0.5).split(1, dim=1)
        last = last.unsqueeze(1)
        heading = torch.where(length(line) > _SHORTEST_LINE, line, last)
        heading = torch.where(pelvis_turned, of_pelvis, heading)
        heading = torch.where(head_turned, of_head, heading)
        heading = unit(heading + _LEAST_TURN * last)
        into, back = (heading @ self.heading_to_turns + self.unturned).reshape(-1, 2, 3, 3).split(1, dim=1)
        down = (floor.reshape(-1, 1, 1, 1) - base) * self.up
        return Frame(down, heading.squeeze(1), into, back)
