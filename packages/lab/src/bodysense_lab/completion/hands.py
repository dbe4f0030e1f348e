"""The fingers of a completion step: from what is tracked of both hands to rotations in the world."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from bodysense.body.skeleton import default_skeleton
from bodysense_lab.completion.fingers import (
    ERROR_BIAS,
    FINGER_JOINTS,
    FINGER_POINTS,
    FLIP,
    HAND_JOINTS,
    HAND_POINTS,
    SIDES,
    FingerNetwork,
    FingerReading,
    relaxed_axes,
)
from bodysense_lab.completion.frame import Frame
from bodysense_lab.completion.network import advance
from bodysense_lab.completion.state import JOINT_COUNT, POINT_COUNT, Memory, Numbers
from bodysense_lab.completion.vectors import frames

WRISTS = [default_skeleton().index(f"{side}_wrist") for side in SIDES]
_OUTPUTS = 6 * FINGER_JOINTS + FINGER_POINTS
_FASTEST = 5.0  # m/s of a wrist


class Fingers(NamedTuple):
    """What the finger network says."""

    axes: Tensor  # (B, 3, 30, 3) of the joints of the left hand, then of the right one, in the world
    error: Tensor  # (B, 40), of their points, not yet positive
    memory: Tensor  # (B, 2 · hidden)


def from_wrists() -> Tensor:
    """(40, 65): points → those of both hands from their wrists."""
    table = torch.zeros(2 * FINGER_POINTS, POINT_COUNT)
    for row, point in zip(table, HAND_POINTS.ravel(), strict=True):
        row[point] = 1
        row[default_skeleton().wrist_of[point]] = -1
    return table


class HandStep(nn.Module):
    """The finger network in a single frame."""

    wrists: Tensor
    axis_rows: Tensor
    points: Tensor
    by_hand: Tensor
    two: Tensor
    axis_places: Tensor
    axis_signs: Tensor
    relaxed: Tensor
    error_places: Tensor

    def __init__(self, network: FingerNetwork) -> None:
        super().__init__()
        self.network = network
        # Outputs are by hand, joint, component and axis; axes are wanted by axis, hand, joint and component.
        output = torch.arange(6 * FINGER_JOINTS).reshape(1, FINGER_JOINTS, 3, 2) + _OUTPUTS * torch.arange(2).reshape(
            2, 1, 1, 1
        )
        signs = FLIP[:, None, :, None] * FLIP[:, None, None, :2].expand(2, FINGER_JOINTS, 1, 2)
        errors = torch.arange(6 * FINGER_JOINTS, _OUTPUTS) + _OUTPUTS * torch.arange(2)[:, None]
        joints = torch.tensor(HAND_JOINTS)
        for name, values in (
            ("wrists", torch.tensor(WRISTS)),
            ("axis_rows", torch.stack([joints, joints + JOINT_COUNT], dim=1).flatten()),  # by hand: x axes, y axes
            ("points", torch.tensor(HAND_POINTS.ravel())),
            ("by_hand", torch.arange(8).reshape(4, 2).T.flatten()),
            ("two", torch.ones(2, 1)),
            ("axis_places", output.permute(3, 0, 1, 2).flatten()),
            ("axis_signs", signs.permute(3, 0, 1, 2).flatten()),
            ("relaxed", (signs * relaxed_axes()).permute(3, 0, 1, 2).flatten()),
            ("error_places", errors.flatten()),
        ):
            self.register_buffer(name, values, persistent=False)

    def forward(
        self,
        axes: Tensor,
        place: Tensor,
        head: Tensor,
        rest_offset: Tensor,
        rows: Tensor,
        from_wrist: Tensor,
        seen: Tensor,
        before: Tensor,
        interval: Tensor,
        frame: Frame,
        memory: Memory,
        numbers: Numbers,
    ) -> Fingers:
        """Complete the fingers of both hands.

        Args:
            axes: (B, 3, 22, 3) of the body's joints.
            place: (B, 1, 2, 3) m, of the wrists from the base.
            head: (B, 1, 1, 3) m, from the base.
            rest_offset: (B, 1, 65, 3) m.
            rows: (B, 1, 156, 3) measured axes, world.
            from_wrist: (B, 1, 40, 3) m, measured, world.
            seen: (B, 100) for each hand what of its points, of its x axes and of its y axes is measured.
            before: (B, 1, 65, 3) m, points as shown in the frame before, from the base.
            interval: (B, 1) s since that frame.
            frame: the frame under the head.
            memory, numbers: of the frame before.
        """
        wrist = axes.index_select(2, self.wrists)
        measured = rows.index_select(2, self.axis_rows).reshape(-1, 2, 2 * FINGER_JOINTS, 3)
        points = from_wrist.reshape(-1, 2, FINGER_POINTS, 3)
        moved = place - before.index_select(2, self.wrists)
        velocity = moved * (numbers.begun / interval).reshape(-1, 1, 1, 1)
        of_wrist = torch.cat([place - head, velocity, wrist[:, :2].reshape(-1, 1, 4, 3)], dim=2) @ frame.into
        features = self.network.reader(
            FingerReading(
                rows=torch.cat([points, measured], dim=2) @ wrist.permute(0, 2, 3, 1),
                seen=seen.reshape(-1, 2, FINGER_POINTS + 2 * FINGER_JOINTS),
                rest_offset=rest_offset.index_select(2, self.points).reshape(-1, 2, FINGER_POINTS, 3),
                wrist=of_wrist.clamp(-_FASTEST, _FASTEST).index_select(2, self.by_hand).reshape(-1, 2, 4, 3),
                interval=(numbers.elapsed + interval).unsqueeze(-1) * self.two,
            )
        ).reshape(-1, self.network.features)
        remembered = memory.fingers.reshape(-1, self.network.config.hidden)
        hidden, after = advance(self.network.recurrent, features, [remembered])
        output = self.network.branch(torch.cat([hidden, features], dim=-1)).reshape(-1, 2 * _OUTPUTS)
        local = output.index_select(1, self.axis_places) * self.axis_signs + self.relaxed
        local = frames(*local.reshape(-1, 2, 2 * FINGER_JOINTS, 3).split(1, dim=1))
        world = local.reshape(-1, 3, 2, FINGER_JOINTS, 3) @ wrist.transpose(1, 2).unsqueeze(1)
        return Fingers(
            axes=world.reshape(-1, 3, 2 * FINGER_JOINTS, 3),
            error=output.index_select(1, self.error_places) + ERROR_BIAS,
            memory=after[0].reshape(-1, 2 * self.network.config.hidden),
        )
