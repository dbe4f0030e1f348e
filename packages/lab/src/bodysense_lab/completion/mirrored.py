"""The body's network in a single frame, asked of what is seen and of its mirror image, and averaged."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from bodysense.body.skeleton import BODY
from bodysense_lab.completion.features import Reading
from bodysense_lab.completion.network import ERROR_BIAS, CompletionNetwork, advance
from bodysense_lab.completion.points import BODY_POINTS, CONTACT, HEAD_HEIGHT, JOINTS, PLACED, partners

PREDICTED = 6 * JOINTS + 3  # numbers of `MirroredPrediction.rows`
LEAST_APART = 0.003  # answers differ by no less
_COUNTS = [PREDICTED, len(CONTACT), PLACED]


class MirroredPrediction(NamedTuple):
    """What the network says, in the frame under the head, at the reference stature."""

    rows: Tensor  # (B, 1, 45, 3): x axes of the joints, not yet orthonormal, then y axes, then where the head is, m
    contact_logit: Tensor  # (B, 4) of `CONTACT`
    error: Tensor  # (B, 25), not yet positive
    apart: Tensor  # (B, 22) how far the two answers are apart about each joint (`_apart`): far where motion is unusual
    memory: Tensor  # (B, 2 · layers · hidden)


class MirroredNetwork(nn.Module):
    """Ask twice and average: a mirrored wearer gets the mirrored body."""

    places: Tensor
    signs: Tensor
    usual: Tensor

    def __init__(self, network: CompletionNetwork) -> None:
        super().__init__()
        self.network = network
        vector = torch.tensor([-1.0, 1, 1])
        axes = torch.arange(6 * JOINTS).reshape(JOINTS, 3, 2).permute(2, 0, 1)  # by axis, joint and component
        axes_sign = (vector[:, None] * vector[:2]).T[:, None].expand(2, JOINTS, 3)
        head = torch.arange(6 * JOINTS, PREDICTED)
        contact = torch.arange(len(CONTACT)) + PREDICTED
        error = torch.arange(PLACED) + PREDICTED + len(CONTACT)
        plain = torch.cat([axes.flatten(), head, contact, error])
        other = [axes[:, partners(BODY)].flatten(), head, contact[partners(CONTACT)], error[partners(BODY_POINTS)]]
        sign = torch.cat([axes_sign.flatten(), vector, torch.ones(len(CONTACT) + PLACED)])
        usual = [network.standing_axes.permute(2, 0, 1).flatten(), torch.tensor([0.0, HEAD_HEIGHT, 0.0])]
        for name, values in (
            ("places", torch.cat([plain, len(plain) + torch.cat(other)])),
            ("signs", torch.cat([torch.ones(len(plain)), sign]) / 2),
            ("usual", torch.cat([*usual, torch.zeros(len(CONTACT)), torch.full((PLACED,), ERROR_BIAS)])),
        ):
            self.register_buffer(name, values, persistent=False)

    def forward(self, reading: Reading, memory: Tensor) -> MirroredPrediction:
        """The answer to a reading of one frame, and the memory after it."""
        network, config = self.network, self.network.config
        features = network.reader(reading).reshape(-1, network.features)  # 2 B: each body beside its mirror image
        before = memory.reshape(-1, config.layers * config.hidden).split(config.hidden, dim=-1)
        hidden, after = advance(network.recurrent, features, list(before))
        both = torch.cat([hidden, features], dim=-1)
        output = torch.cat([network.turn_branch(both), network.judge_branch(both)], dim=-1)
        output = output.reshape(-1, 2 * sum(_COUNTS)).index_select(1, self.places) * self.signs
        halves = output.reshape(-1, 2, sum(_COUNTS))
        mean = halves.sum(dim=1) + self.usual
        half, middle = (of[:, : 6 * JOINTS].reshape(-1, 2, JOINTS, 3) for of in (halves[:, 0] - halves[:, 1], mean))
        apart = _apart(middle, half)
        rows, contact, error = mean.split(_COUNTS, dim=-1)
        memory = torch.cat(after, dim=-1).reshape(-1, 2 * config.layers * config.hidden)
        return MirroredPrediction(rows.reshape(-1, 1, PREDICTED // 3, 3), contact, error, apart, memory)


def _apart(middle: Tensor, half: Tensor) -> Tensor:
    """(B, 22): how far two answers, middle ± half (B, 2, 22, 3), are apart in direction about each joint's two axes.

    It is the root of the sum of 1 − cosine over both: their lengths mean nothing.
    """
    long, short, both = ((x * y).sum(dim=-1) for x, y in ((middle, middle), (half, half), (middle, half)))
    lengths = torch.sqrt(((long + short) ** 2 - 4 * both * both).clamp(min=1e-8))
    return torch.sqrt((1 - (long - short) / lengths).sum(dim=1).clamp(min=0) + LEAST_APART**2)
