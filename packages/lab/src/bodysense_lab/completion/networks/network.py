"""Completion network: predicts rotations, contacts and expected errors from any points, for any proportions.

It reads 27 points (the 22 joints of `BODY`, head top, toe tips, and the middle of each hand's knuckles), each with a
position, a rotation, both or neither, and the known lengths of the wearer's bones. It works in the frame under the head
(x and z of the head, the floor at y = 0, turned by the head's heading) and at a reference stature, so its prediction is
independent of the body's place, heading and size. It predicts each joint's rotation relative to that frame, not to the
parent, so that errors do not add up along a chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import quaternion_to_matrix
from bodysense_lab.completion.data.points import (
    BODY_POINT_COUNT,
    CONTACT,
    HEAD_HEIGHT,
    JOINTS,
    bone_parents,
    path_from_head,
    reference_offsets,
)
from bodysense_lab.completion.networks.features import (
    WIDTHS,
    TrackedSignal,
    features_of,
    flag_index,
    mirror_indices,
    mirror_signs,
)

SMALLEST_ERROR = 0.002  # m; no expected error is smaller
ERROR_BIAS = -3.0  # of the expected error, before softplus
_HEAD_FLAGS = (flag_index("has_position", "head"), flag_index("has_rotation", "head"))


@dataclass(frozen=True)
class CompletionConfig:
    """Size of the network."""

    hidden: int = 512
    layers: int = 2  # recurrent layers
    branch: int = 512  # units of the branch of rotations
    judge_branch: int = 128  # units of the branch of contact and expected error
    dropout: float = 0.15  # of the recurrent layers' outputs, in training
    update_rank: int = 0  # of the updates of the weights while the head's pose is not tracked; 0: no updates


class Prediction(NamedTuple):
    """The network's prediction, in the frame under the head, at the reference stature."""

    axes: Tensor  # (B, T, 22, 3, 2) first two columns of frame ← joint, not orthonormal
    head: Tensor  # (B, T, 3) m, position of the head, used if it is not tracked
    contact_logit: Tensor  # (B, T, 4) for `CONTACT`
    error: Tensor  # (B, T, 25) m, expected position error


class CompletionNetwork(nn.Module):
    """GRU with a skip connection and two branches: rotations, and contact with expected errors.

    While the head's position or rotation is not tracked, low-rank updates are added to the weights (Hu et al. 2022,
    "LoRA"). Suits without a headset can so be learned without any change for people who wear one.
    """

    def __init__(self, config: CompletionConfig) -> None:
        super().__init__()
        self.config = config
        self.features = sum(WIDTHS.values())
        self.recurrent = nn.GRU(self.features, config.hidden, config.layers, batch_first=True)
        # Drop whole units for all frames: a mask that changes between frames would make the output tremble.
        self.dropout = nn.Dropout1d(config.dropout)
        both = config.hidden + self.features
        self.turn_branch = nn.Sequential(
            nn.Linear(both, config.branch), nn.ReLU(), nn.Linear(config.branch, 6 * JOINTS + 3)
        )
        self.judge_branch = nn.Sequential(
            nn.Linear(both, config.judge_branch),
            nn.ReLU(),
            nn.Linear(config.judge_branch, len(CONTACT) + BODY_POINT_COUNT),
        )
        self.updates = nn.ModuleDict(
            {name: _low_rank(*size, config.update_rank) for name, size in self._updated().items() if config.update_rank}
        )
        standing = forward_kinematics(standing_pose(default_skeleton()))[1][:JOINTS]
        constants = {
            "standing_axes": quaternion_to_matrix(standing)[..., :2],
            "from_head": path_from_head(),
            "usual_bones": reference_offsets(),
            "image_sign": mirror_signs(),
        }
        for name, values in constants.items():
            self.register_buffer(name, torch.tensor(np.asarray(values), dtype=torch.float32), persistent=False)
        self.register_buffer("bone_parents", torch.tensor(bone_parents()), persistent=False)
        self.register_buffer("image", torch.tensor(mirror_indices()), persistent=False)

    def _updated(self) -> dict[str, tuple[int, int]]:
        """Return inputs and outputs of the products that have updates."""
        hidden, both = self.config.hidden, self.config.hidden + self.features
        sizes = dict[str, tuple[int, int]]()
        for layer in range(self.config.layers):
            sizes[f"input_l{layer}"] = (hidden if layer else self.features, 3 * hidden)
            sizes[f"state_l{layer}"] = (hidden, 3 * hidden)
        return sizes | {"turn_branch": (both, self.config.branch)}

    standing_axes: Tensor
    from_head: Tensor
    bone_parents: Tensor
    usual_bones: Tensor
    image: Tensor
    image_sign: Tensor

    def read(self, signal: TrackedSignal) -> Tensor:
        """Return features (B, T, F) of a signal."""
        return features_of(signal, self.usual_bones)

    def read_both(self, signal: TrackedSignal) -> Tensor:
        """Return features (B, T, 2, F) of a signal and of its mirror image at x = 0 of the frame under the head."""
        features = self.read(signal)
        return torch.stack([features, features[..., self.image] * self.image_sign], dim=-2)

    def begin(self, batch: int) -> Tensor:
        """Return the memory (layers, batch, hidden) before the first frame."""
        return self.standing_axes.new_zeros(self.config.layers, batch, self.config.hidden)

    def predict(self, features: Tensor, memory: Tensor) -> tuple[tuple[Tensor, Tensor], Tensor]:
        """Return raw outputs of both branches for features (B, T, F), and the memory after them."""
        hidden, memory = self.remember(features, memory)
        both = torch.cat([self.dropout(hidden.mT).mT, features.to(hidden)], dim=-1)
        first, *rest = self.turn_branch
        turned = first(both)
        if self.updates:
            turned = turned + head_is_untracked(features) * self.updates["turn_branch"](both)
        for layer in rest:
            turned = layer(turned)
        return (turned, self.judge_branch(both)), memory

    def remember(self, features: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """Return the last layer's states (B, T, hidden) for features (B, T, F), and the memory after them."""
        untracked = head_is_untracked(features)
        if not self.updates or not untracked.any():
            return self.recurrent(features, memory)
        states, after = features, []
        for layer, state in enumerate(memory):
            states = self._remember_with_updates(layer, states, state, untracked)
            after.append(states[:, -1])
        return states, torch.stack(after)

    def _remember_with_updates(self, layer: int, inputs: Tensor, state: Tensor, untracked: Tensor) -> Tensor:
        """Return the states (B, T, hidden) of a layer whose weights have updates in frames with `untracked` heads."""
        of_input, of_state, input_bias, state_bias = self.recurrent.all_weights[layer]
        size = self.config.hidden
        given = nn.functional.linear(inputs, of_input, input_bias)
        given = given + untracked * self.updates[f"input_l{layer}"](inputs)
        update, states = self.updates[f"state_l{layer}"], []
        for now, where in zip(given.unbind(1), untracked.unbind(1), strict=True):
            kept = nn.functional.linear(state, of_state, state_bias) + where * update(state)
            reset, stay = (now[:, : 2 * size] + kept[:, : 2 * size]).sigmoid().chunk(2, dim=-1)
            candidate = torch.tanh(now[:, 2 * size :] + reset * kept[:, 2 * size :])
            state = candidate + stay * (state - candidate)
            states.append(state)
        return torch.stack(states, dim=1)

    def prediction(self, turned: Tensor, judged: Tensor) -> Prediction:
        """Convert raw outputs to a prediction."""
        axes = turned[..., : 6 * JOINTS].unflatten(-1, (JOINTS, 3, 2)) + self.standing_axes
        contact, error = judged[..., : len(CONTACT)], judged[..., len(CONTACT) :]
        raised = turned[..., 6 * JOINTS :] + turned.new_tensor([0.0, HEAD_HEIGHT, 0.0])
        return Prediction(axes, raised, contact, nn.functional.softplus(error + ERROR_BIAS) + SMALLEST_ERROR)

    def places(self, rotation: Tensor, rest_offset: Tensor) -> Tensor:
        """Return positions (B, T, 25, 3) from the head, for rotations (B, T, 22, 3, 3) and offsets (B, 25, 3)."""
        bones = rotation[..., self.bone_parents, :, :] @ rest_offset[:, None, 1:, :, None]
        return self.from_head @ bones[..., 0]


def head_is_untracked(features: Tensor) -> Tensor:
    """Return (B, T, 1) 1 where the head's position or its rotation is not tracked, else 0."""
    position, rotation = (features[..., place] for place in _HEAD_FLAGS)
    return (1.0 - position * rotation)[..., None]


def _low_rank(inputs: int, outputs: int, rank: int) -> nn.Sequential:
    """Return a product of two matrices that is 0 until it is trained."""
    inward, outward = nn.Linear(inputs, rank, bias=False), nn.Linear(rank, outputs, bias=False)
    nn.init.zeros_(outward.weight)
    return nn.Sequential(inward, outward)


def orthonormal(axes: Tensor) -> Tensor:
    """Return rotations (..., 3, 3) from their first two columns (..., 3, 2) (Gram-Schmidt; Zhou et al. 2019)."""
    x = nn.functional.normalize(axes[..., 0], dim=-1, eps=1e-6)
    y = axes[..., 1] - x * (x * axes[..., 1]).sum(dim=-1, keepdim=True)
    y = nn.functional.normalize(y, dim=-1, eps=1e-6)
    return torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)


def turn_about_up(cosine: Tensor, sine: Tensor) -> Tensor:
    """Return rotation matrices (..., 3, 3) about +Y from cosine and sine (...), which are normalised first.

    They map column vectors of the turned frame to the world, and row vectors of the world to the turned frame.
    """
    length = torch.sqrt(cosine * cosine + sine * sine).clamp(min=1e-6)
    c, s = cosine / length, sine / length
    zero, one = torch.zeros_like(c), torch.ones_like(c)
    rows = [[c, zero, s], [zero, one, zero], [-s, zero, c]]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)
