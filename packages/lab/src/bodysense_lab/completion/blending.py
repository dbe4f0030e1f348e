"""Re-acquisition blending: where sensors came or went, what was shown gives way to what is predicted."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from bodysense.body.skeleton import BODY
from bodysense_lab.completion.points import JOINTS
from bodysense_lab.completion.state import JOINT_COUNT, POINT_COUNT, Numbers, Rows

# s: time constants. How a hand is turned that is lost from sight nothing tells, and it mostly stays as it was.
BLEND, WRIST_BLEND = 0.06, 10.0
_WRISTS = [BODY.index(f"{side}_wrist") for side in ("left", "right")]
_ROWS = 2 * JOINTS + 1


class Blend(NamedTuple):
    """What is predicted, blended, and what to keep for it."""

    rows: Tensor  # (B, 1, 45, 3) axes and head
    kept: Tensor  # (B, 1, 45, 3), see `Rows.blend`
    age: Tensor  # (B, 3) s
    changed: Tensor  # (B, 1, 1, 1) bool: sensors come or go now
    fade: Tensor  # (B, 1, 1, 1) share of what was shown


class Blending(nn.Module):
    """A critically damped way from what was shown to what is predicted.

    The offset of what was shown from what was predicted fades. A wrist keeps its direction itself, and gives it up
    slowly.
    """

    changes: Tensor
    rate: Tensor
    group: Tensor
    alone: Tensor
    together: Tensor

    def __init__(self) -> None:
        super().__init__()
        # Changes of any sensor count for all but the wrists, for which those of their own rotation do.
        changes = torch.zeros(POINT_COUNT + JOINT_COUNT, 3)
        changes[:, 0] = 1
        group = torch.zeros(_ROWS + 1, dtype=torch.int64)
        for k, wrist in enumerate(_WRISTS, start=1):
            changes[POINT_COUNT + wrist, k] = 1
            group[[wrist, JOINTS + wrist]] = k
        alone = (group[:_ROWS] > 0).float()[:, None].expand(-1, 3)
        for name, values in (
            ("changes", changes),
            ("rate", -1 / torch.tensor([BLEND, WRIST_BLEND, WRIST_BLEND])),
            ("group", group),
            ("alone", alone.contiguous()),
            ("together", 1 - alone),
        ):
            self.register_buffer(name, values, persistent=False)

    def forward(
        self, predicted: Tensor, then: Tensor, masks: Tensor, interval: Tensor, rows: Rows, numbers: Numbers
    ) -> Blend:
        """Blend a prediction.

        Args:
            predicted: (B, 1, 45, 3) axes, and where the head is, in the frame under the head.
            then: (B, 1, 45, 3) the same as shown in the frame before, in the frame of now.
            masks: (B, 117) what is tracked.
            interval: (B, 1) s.
            rows, numbers: of the frame before.
        """
        changed = ((masks - numbers.tracked).abs() @ self.changes) * numbers.begun > 0.5
        age = torch.where(changed, 0.0, numbers.age) + interval
        along = age * self.rate
        fade = (1 - along) * torch.exp(along)
        row_changed, all_changed = self._by_row(changed)
        row_fade, all_fade = self._by_row(fade)
        kept = torch.where(row_changed, then - predicted * self.together, rows.blend)
        return Blend(predicted + row_fade * (kept - predicted * self.alone), kept, age, all_changed, all_fade)

    def _by_row(self, group: Tensor) -> tuple[Tensor, Tensor]:
        """What (B, 3) groups have for each row (B, 1, 45, 1), and for all others (B, 1, 1, 1)."""
        of_row, of_others = group.index_select(1, self.group).reshape(-1, 1, _ROWS + 1, 1).split([_ROWS, 1], dim=2)
        return of_row, of_others
