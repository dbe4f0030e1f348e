"""The networks of a glove: hidden markers from those that are seen, and a hand's angles from all (two-hands, 3.2).

Both read markers of a left hand, at the default hand's size. For the first they are registered onto the template by
all known markers, and hidden ones are exactly 0 (section 3.2.2). For the second all are known, and they are registered
by the back of the hand. Both read the hand's shape: its resting offsets and its flat markers, zeros if it is unknown.
Scaling is linear and inside the network, so that an exported network has it in its first and last layer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.hands.glove import MARKERS, template
from bodysense.body.hands.hand import FINGERTIPS, FREEDOMS, HAND_JOINTS
from bodysense.body.hands.hand_family import COUNT, hand_of

MARKER_VALUES = 3 * len(MARKERS)
BONES = len(HAND_JOINTS) - 1 + len(FINGERTIPS)
SHAPE_VALUES = 3 * BONES + MARKER_VALUES
_REACH = 0.03  # m; markers of fingers move by about this
_SHAPE = 0.006  # m; hands at one size differ by about this
_TURN = 0.5  # rad; joints turn by about this


@dataclass(frozen=True)
class MarkerNetworkConfig:
    """Form of the network that fills hidden markers, by Table 1; the fields below the first are ours."""

    layers: tuple[int, ...] = (256, 200, 256)
    reads_mask: bool = True  # and offsets from the template; otherwise a hidden marker is only a zero
    reads_hand: bool = True  # its shape


PAPER_MARKERS = MarkerNetworkConfig((200, 150, 200), reads_mask=False, reads_hand=False)


@dataclass(frozen=True)
class JointNetworkConfig:
    """Form of the network that turns markers into angles, by Table 2; the last field is ours."""

    layers: tuple[int, ...] = (200, 200, 200)
    dropout: float = 0.0  # behind every layer but the last
    reads_hand: bool = True


PAPER_JOINTS = JointNetworkConfig(dropout=0.1, reads_hand=False)


class MarkerNetwork(nn.Module):
    """Registered markers, hidden ones 0, to all markers in the same frame."""

    scale: Tensor
    shift: Tensor
    typical: Tensor

    def __init__(self, config: MarkerNetworkConfig) -> None:
        super().__init__()
        self.config = config
        shape, hand = typical_hand()
        blocks = [_seen_scale(shape) if config.reads_mask else (torch.eye(MARKER_VALUES) / _REACH, None)]
        blocks += [_hand_scale(hand)] * config.reads_hand
        _register_scale(self, blocks)
        self.register_buffer("typical", shape.flatten(), persistent=False)
        self.layers = _layers(len(self.scale), config.layers, MARKER_VALUES, 0.0)

    def forward(self, markers: Tensor, hand: Tensor) -> Tensor:
        """Markers (..., 27) m and the hand's shape (..., 87) m → (..., 27) m."""
        return self.answer(self.features(markers, hand))

    def raw(self, markers: Tensor, hand: Tensor) -> Tensor:
        """Return the inputs before scaling."""
        config = self.config
        seen = markers
        if config.reads_mask:  # markers (..., 27), and which of them are known (..., 9)
            known = markers.unflatten(-1, (len(MARKERS), 3)).abs().sum(dim=-1) > 0
            seen = torch.cat([markers, known.to(markers.dtype)], dim=-1)
        return torch.cat([seen, _with_flag(hand)], dim=-1) if config.reads_hand else seen

    def features(self, markers: Tensor, hand: Tensor) -> Tensor:
        """Return the inputs of the layers."""
        return nn.functional.linear(self.raw(markers, hand), self.scale, self.shift)

    def answer(self, features: Tensor) -> Tensor:
        """All markers (..., 27) m."""
        return self.typical + _REACH * self.layers(features)

    def folded(self) -> nn.Sequential:
        """Return layers from `raw` to the output, without separate scaling."""
        return _folded(self.layers, self.scale, self.shift, _REACH, self.typical)


class JointNetwork(nn.Module):
    """Markers in the hand's own frame, all known, to the 26 angles of `body.hand.FREEDOMS`."""

    scale: Tensor
    shift: Tensor

    def __init__(self, config: JointNetworkConfig) -> None:
        super().__init__()
        self.config = config
        shape, hand = typical_hand()
        markers = (torch.eye(MARKER_VALUES) / _REACH, -shape.flatten() / _REACH)
        _register_scale(self, [markers] + [_hand_scale(hand)] * config.reads_hand)
        self.layers = _layers(len(self.scale), config.layers, len(FREEDOMS), config.dropout)

    def forward(self, markers: Tensor, hand: Tensor) -> Tensor:
        """Markers (..., 27) m and the hand's shape (..., 87) m → angles (..., 26) rad."""
        return _TURN * self.layers(nn.functional.linear(self.raw(markers, hand), self.scale, self.shift))

    def raw(self, markers: Tensor, hand: Tensor) -> Tensor:
        """Return the inputs before scaling."""
        return torch.cat([markers, _with_flag(hand)], dim=-1) if self.config.reads_hand else markers

    def folded(self) -> nn.Sequential:
        """Return layers from `raw` to the angles, without separate scaling."""
        return _folded(self.layers, self.scale, self.shift, _TURN, torch.zeros(len(FREEDOMS)))


def typical_hand() -> tuple[Tensor, Tensor]:
    """The template (9, 3) m of the middle of the family of hands, and its shape (87,) m."""
    hand = hand_of(np.zeros(COUNT))
    flat = template(hand.glove, hand.skeleton)
    shape = np.concatenate([hand.skeleton.rest_offset[1:].ravel(), flat.ravel()])
    return torch.tensor(flat, dtype=torch.float32), torch.tensor(shape, dtype=torch.float32)


def _with_flag(hand: Tensor) -> Tensor:
    """A hand's shape (..., 87) and whether it is known (..., 1)."""
    return torch.cat([hand, (hand.abs().sum(dim=-1, keepdim=True) > 0).to(hand.dtype)], dim=-1)


Scale = tuple[Tensor, Tensor | None]  # (F, R) from what is read to features, and what is added (F,), if anything


def _seen_scale(shape: Tensor) -> Scale:
    """Scale of markers and their mask: offsets of known markers from the template, in units of `_REACH`."""
    scale = torch.eye(MARKER_VALUES + len(MARKERS))
    scale[:MARKER_VALUES] /= _REACH
    for marker, place in enumerate(shape):
        scale[3 * marker : 3 * marker + 3, MARKER_VALUES + marker] = -place / _REACH
    return scale, None


def _hand_scale(typical: Tensor) -> Scale:
    """Scale of a hand's shape and its flag: difference of a known shape from the typical one."""
    scale = torch.eye(SHAPE_VALUES + 1)
    scale[:SHAPE_VALUES] /= _SHAPE
    scale[:SHAPE_VALUES, SHAPE_VALUES] = -typical / _SHAPE
    return scale, None


def _register_scale(network: nn.Module, blocks: list[Scale]) -> None:
    """Register the scales of consecutive parts of the input as one buffer."""
    shifts = [torch.zeros(len(scale)) if shift is None else shift for scale, shift in blocks]
    network.register_buffer("scale", torch.block_diag(*(scale for scale, _ in blocks)), persistent=False)
    network.register_buffer("shift", torch.cat(shifts), persistent=False)


def _layers(features: int, hidden: tuple[int, ...], outputs: int, dropout: float) -> nn.Sequential:
    parts: list[nn.Module] = []
    for k, width in enumerate(hidden):
        parts += [nn.Linear(features, width), nn.ReLU()]
        if dropout and k < len(hidden) - 1:
            parts.append(nn.Dropout(dropout))
        features = width
    return nn.Sequential(*parts, nn.Linear(features, outputs))


def _folded(layers: nn.Sequential, scale: Tensor, shift: Tensor, gain: float, offset: Tensor) -> nn.Sequential:
    """Return layers whose first one includes the scale of the input, and whose last one that of the output."""
    parts = [layer for layer in layers if not isinstance(layer, nn.Dropout)]
    first, last = parts[0], parts[-1]
    assert isinstance(first, nn.Linear)
    assert isinstance(last, nn.Linear)
    with torch.no_grad():
        begin = nn.Linear(scale.shape[1], first.out_features)
        begin.weight.copy_(first.weight @ scale)
        begin.bias.copy_(first.bias + first.weight @ shift)
        end = nn.Linear(last.in_features, last.out_features)
        end.weight.copy_(gain * last.weight)
        end.bias.copy_(gain * last.bias + offset)
    return nn.Sequential(begin, *parts[1:-1], end)
