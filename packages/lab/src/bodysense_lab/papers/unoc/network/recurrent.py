"""Recurrent part: GRU, LSTM, plain RNN or causal convolutions, over sequences or windows (UNOC, section 4.2).

One recurrent part serves every network of the paper. Over whole sequences its memory is the hidden state; over windows
it is the frames before, and every frame is answered from its own window, as the paper does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import torch
from torch import Tensor, nn

from bodysense.errors import BodysenseError

Cell = Literal["gru", "lstm", "rnn", "tcn"]
_KERNEL = 3  # frames that a convolution joins (Pavllo et al. 2019)


class Recurrent(nn.Module):
    """Features (B, T, F) → what is made of each frame (B, T, hidden).

    `window` None carries the state on; a number answers every frame from that many frames. Convolutions need a window
    that is a power of 3. Raises BodysenseError where they do not get one.
    """

    def __init__(self, cell: Cell, features: int, hidden: int, window: int | None) -> None:
        super().__init__()
        self.cell, self.features, self.hidden, self.window = cell, features, hidden, window
        if cell == "tcn":
            self.convolutions = _Convolutions(features, hidden, window)
        else:
            layer = {"gru": nn.GRU, "lstm": nn.LSTM, "rnn": nn.RNN}[cell]
            self.layer: nn.GRU | nn.LSTM | nn.RNN = layer(features, hidden, batch_first=True)

    def start(self, batch: int) -> Tensor:
        """The memory before the first frame of `batch` sequences."""
        if self.window is not None:
            return torch.zeros(batch, self.window, self.features)
        return torch.zeros(batch, self.hidden * (2 if self.cell == "lstm" else 1))

    def forward(self, features: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """(B, T, F) and the memory before → (B, T, hidden) and the memory after."""
        if self.window is not None:
            frames, window = features.shape[1], self.window
            # A fresh sequence is preceded by repetitions of its first frame.
            fresh = (memory == 0).all(dim=-1, keepdim=True)
            history = torch.cat([torch.where(fresh, features[:, :1], memory), features], dim=1)
            windows = torch.stack([history[:, t + 1 : t + 1 + window] for t in range(frames)], dim=1)
            return self.last(windows.flatten(0, 1)).unflatten(0, (-1, frames)), history[:, -window:]
        if isinstance(self.layer, nn.LSTM):
            before, cell = memory.chunk(2, dim=-1)
            hidden, (h, c) = self.layer(features, (before[None], cell[None]))
            return hidden, torch.cat([h[0], c[0]], dim=-1)
        if isinstance(self.layer, nn.GRU) and features.shape[1] == 1:
            after = _gru_step(self.layer.all_weights[0], features[:, 0], memory)
            return after[:, None], after
        hidden, after = self.layer(features, memory[None])
        return hidden, after[0]

    def last(self, windows: Tensor) -> Tensor:
        """Return the features of the last frame of windows: (B, window, F) → (B, hidden)."""
        if self.cell == "tcn":
            return self.convolutions(windows)
        return self.layer(windows)[0][:, -1]


def _gru_step(weights: Sequence[Tensor], features: Tensor, hidden: Tensor) -> Tensor:
    """One frame (B, F) of a GRU, spelled out: in the exported file it is faster than a whole GRU of one frame."""
    of_input, of_state, input_bias, state_bias = weights
    given = nn.functional.linear(features, of_input, input_bias)
    kept = nn.functional.linear(hidden, of_state, state_bias)
    size = hidden.shape[-1]
    gates = torch.sigmoid(given[:, : 2 * size] + kept[:, : 2 * size])
    reset, update = gates.chunk(2, dim=-1)
    candidate = torch.tanh(given[:, 2 * size :] + reset * kept[:, 2 * size :])
    return candidate + update * (hidden - candidate)


class _Convolutions(nn.Module):
    """Causal dilated convolutions, seen from a window's last frame: three frames become one, level by level.

    Dilations are 1, 3, 9 …, so that a window of 27 takes three levels; later levels are residual (Pavllo et al. 2019).
    """

    def __init__(self, features: int, hidden: int, window: int | None) -> None:
        super().__init__()
        levels = [k for k in range(1, 8) if _KERNEL**k == window]
        if not levels:
            raise BodysenseError(f"convolutions over {window} frames: give a window of 3, 9, 27, 81 or another power")
        sizes = [features] + [hidden] * (levels[0] - 1)
        self.levels = nn.ModuleList(nn.Linear(_KERNEL * size, hidden) for size in sizes)

    def forward(self, x: Tensor) -> Tensor:
        for k, level in enumerate(self.levels):
            joined = x.unflatten(1, (-1, _KERNEL))
            change = torch.relu(level(joined.flatten(2)))
            x = change if k == 0 else joined[:, :, -1] + change
        return x[:, 0]


def branch(inputs: int, widths: tuple[int, ...], outputs: int, dropout: float = 0.0) -> nn.Sequential:
    """Fully connected layers with rectified units between them; `dropout` of the inputs and of those units."""
    layers: list[nn.Module] = [nn.Dropout(dropout)] if dropout else []
    for width in widths:
        layers += [nn.Linear(inputs, width), nn.ReLU(), *([nn.Dropout(dropout)] if dropout else [])]
        inputs = width
    return nn.Sequential(*layers, nn.Linear(inputs, outputs))
