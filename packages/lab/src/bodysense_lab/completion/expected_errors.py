"""Expected errors of all points, made true, and their bounds."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.skeleton import default_skeleton
from bodysense_lab.completion.error_map import CERTAINTY_SCALE, HIDDEN, KNOWN, LOG_ALIKE, LOG_TRACKED, ErrorMap
from bodysense_lab.completion.fingers import HAND_POINTS
from bodysense_lab.completion.fingers import SMALLEST_ERROR as SMALLEST_FINGER_ERROR
from bodysense_lab.completion.network import SMALLEST_ERROR
from bodysense_lab.completion.points import JOINTS, PLACED, body_places
from bodysense_lab.completion.state import JOINT_COUNT, POINT_COUNT
from bodysense_lab.completion.vectors import replaced

NORMAL_BOUND = 1.567  # 90 % quantile of the length of normal errors in space, by their mean
_SPREADS = (1.0, NORMAL_BOUND)


class ExpectedErrors(nn.Module):
    """What the networks expect → expected errors, and what they do not exceed in nine of ten cases.

    `mean` and `bound` make both true (`uncertainty`).
    """

    weight: Tensor
    inward: Tensor
    offset: Tensor
    inward_offset: Tensor
    points: Tensor
    log_tracked: Tensor
    log_alike: Tensor
    counting: Tensor
    body_places: Tensor
    hand_places: Tensor
    hand_scale: Tensor

    def __init__(self, mean: ErrorMap, bound: ErrorMap) -> None:
        super().__init__()
        # Of log errors, of the masks of all points and rotations and of the certainty of all bones the body's count.
        counting = [
            *range(PLACED),
            *(PLACED + point for point in body_places()),
            *(PLACED + POINT_COUNT + joint for joint in range(JOINTS)),
            *(PLACED + POINT_COUNT + JOINT_COUNT + point for point in body_places()),
            *(PLACED + 2 * POINT_COUNT + JOINT_COUNT + joint for joint in range(JOINTS)),
        ]
        scale = np.ones((KNOWN, 1))
        scale[-PLACED - JOINTS : -JOINTS] = CERTAINTY_SCALE
        outward = np.zeros((2 * HIDDEN, 2 * PLACED))
        outward[:HIDDEN, :PLACED], outward[HIDDEN:, PLACED:] = mean.outward, bound.outward
        body, hands = body_places(), HAND_POINTS.ravel().tolist()
        wrist_of = default_skeleton().wrist_of
        # A finger is misplaced by its wrist's error as well.
        places = [body.index(p) if p in body else body.index(wrist_of[p]) for p in range(POINT_COUNT)]
        fingers = [hands.index(p) if p in hands else 0 for p in range(POINT_COUNT)]
        of_hand = np.array([float(p in hands) for p in range(POINT_COUNT)])
        for name, values in (
            ("weight", _tables([scale * np.concatenate([mean.weight, bound.weight], axis=1), outward])),
            ("inward", _tables([scale * np.concatenate([mean.inward, bound.inward], axis=1)])),
            ("offset", torch.tensor(np.concatenate([mean.offset, bound.offset]), dtype=torch.float32)),
            (
                "inward_offset",
                torch.tensor(np.concatenate([mean.inward_offset, bound.inward_offset]), dtype=torch.float32),
            ),
            ("points", torch.tensor(body_places())),
            ("log_tracked", torch.tensor([LOG_TRACKED])),
            ("log_alike", torch.tensor([LOG_ALIKE])),
            ("counting", torch.tensor(counting)),
            ("body_places", torch.tensor([*places, *(PLACED + place for place in places)])),
            ("hand_places", torch.tensor(fingers * 2)),
            ("hand_scale", torch.tensor(np.concatenate([s * of_hand for s in _SPREADS]), dtype=torch.float32)),
        ):
            self.register_buffer(name, values.contiguous(), persistent=False)

    def forward(
        self,
        body: Tensor,
        fingers: Tensor,
        size: Tensor,
        masks: Tensor,
        certainty: Tensor,
        has: Tensor,
        accuracy: Tensor,
        apart: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Expected errors and their bounds, (B, 65) m each; what is measured errs as its sensor does.

        Args:
            body: (B, 25) of the body's points at the reference stature, not yet positive.
            fingers: (B, 40) of both hands' points, not yet positive.
            size: (B, 1) the wearer's stature beside the reference's.
            masks: (B, 117) 1 or 0: what is tracked of positions and rotations.
            certainty: (B, 65) m, standard deviation of each bone's length.
            has: (B, 65) bool, what is tracked of positions.
            accuracy: (B, 65) m.
            apart: (B, 22) how far the network's two answers are apart about each joint.
        """
        expected = torch.log((nn.functional.softplus(body) + SMALLEST_ERROR) * size)
        expected = replaced(expected, self.log_tracked, masks.index_select(1, self.points))
        joints = masks.index_select(1, self.points)[:, :JOINTS]
        alike = replaced(torch.log(apart), self.log_alike, joints)
        known = torch.cat([expected, masks, certainty, alike], dim=1).index_select(1, self.counting)
        inside = torch.tanh(nn.functional.linear(known, self.inward, self.inward_offset))
        log = nn.functional.linear(torch.cat([known, inside], dim=1), self.weight, self.offset)
        placed = torch.exp(log).index_select(1, self.body_places)
        hands = (nn.functional.softplus(fingers) + SMALLEST_FINGER_ERROR).index_select(1, self.hand_places)
        mean, bound = (placed + hands * self.hand_scale).split(POINT_COUNT, dim=1)
        return torch.where(has, accuracy, mean), torch.where(has, accuracy * NORMAL_BOUND, bound)


def _tables(tables: list[np.ndarray]) -> Tensor:
    """Tables of inputs × outputs, one below the other, as `linear` reads them."""
    return torch.tensor(np.concatenate(tables).T, dtype=torch.float32)
