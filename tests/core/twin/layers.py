"""Layers of the networks, and the tables of a weights file.

Products are of whole numbers in the core: a feature counts in 1/32767 of the largest of its block of 64, a state in
1/127. The twin rounds inputs alike and multiplies plainly.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from bodysense_lab.completion.networks.weights_file import read_safetensors

BLOCK = 64
FEATURE, STATE = 32767, 127  # steps of the largest number of a block


@lru_cache(maxsize=2)
def tables(path: Path) -> Mapping[str, np.ndarray]:
    """The tables of a weights file as plain numbers."""
    stored, _ = read_safetensors(path)
    whole = dict[str, np.ndarray]()
    for name, values in stored.items():
        step = stored.get(f"{name}.step")
        whole[name] = values.astype(np.float32) * (1 if step is None else step.reshape(-1, 1).astype(np.float32))
    return whole


def rounded(x: np.ndarray, steps: int) -> np.ndarray:
    """Columns (N, C) in whole multiples of 1/steps of the largest of each block of 64."""
    count = len(x)
    blocks = np.pad(x.astype(np.float32), ((0, -count % BLOCK), (0, 0))).reshape(-1, BLOCK, x.shape[1])
    largest = np.abs(blocks).max(axis=1, keepdims=True)
    inverse = np.where(largest > 1e-30, np.float32(steps) / np.maximum(largest, np.float32(1e-30)), 0)
    return (np.rint(blocks * inverse) * (largest / np.float32(steps))).reshape(-1, x.shape[1])[:count]


def logistic(x: np.ndarray) -> np.ndarray:
    """1 / (1 + e^-x)"""
    return 1 / (1 + np.exp(-x))


def softplus(x: np.ndarray) -> np.ndarray:
    """log(1 + e^x)"""
    return np.logaddexp(0, x)


@dataclass(frozen=True)
class Update:
    """A product of two narrow matrices that is added to another product (Hu et al. 2022, "LoRA")."""

    inward: np.ndarray  # (R, N)
    outward: np.ndarray  # (M, R)

    def of(self, x: np.ndarray) -> np.ndarray:
        """(M, C) for rounded inputs (N, C)."""
        return self.outward @ rounded(self.inward @ x, FEATURE)

    def columns(self, *wanted: slice) -> "list[Update]":
        """Updates of the same outputs by some of the inputs."""
        return [Update(self.inward[:, part], self.outward) for part in wanted]


@dataclass(frozen=True)
class Recurrent:
    """A gated recurrent unit (Cho et al. 2014), in PyTorch's form.

    r = σ(Wr x + Ur h), z = σ(Wz x + Uz h), c = tanh(W x + r U h), h' = c + z (h - c)
    """

    of_input: np.ndarray  # (3 H, N): rows of r, of z, of c
    of_state: np.ndarray  # (3 H, H)
    input_bias: np.ndarray  # (3 H, 1)
    state_bias: np.ndarray  # (3 H, 1)

    @property
    def hidden(self) -> int:
        """H"""
        return self.of_state.shape[1]

    def step(self, x: np.ndarray, before: np.ndarray, steps: int = STATE, updates: Sequence[Update] = ()) -> np.ndarray:
        """States (H, C) after inputs (N, C) that are rounded; states are rounded to `steps`.

        `updates`, of the products with inputs and with states, are added if there are any.
        """
        state = rounded(before, steps)
        added = [update.of(of) for update, of in zip(updates, (x, state), strict=False)] or [0.0, 0.0]
        given = np.split(self.of_input @ x + self.input_bias + added[0], 3)
        kept = np.split(self.of_state @ state + self.state_bias + added[1], 3)
        reset, update = logistic(given[0] + kept[0]), logistic(given[1] + kept[1])
        candidate = np.tanh(given[2] + reset * kept[2])
        return candidate + update * (before - candidate)


@dataclass(frozen=True)
class Branch:
    """A rectified layer over memory and inputs, and a linear layer: W max(V [h, x] + b, 0) + c."""

    inward: np.ndarray  # (M, H + N)
    inward_bias: np.ndarray  # (M, 1)
    outward: np.ndarray  # (O, M)
    outward_bias: np.ndarray  # (O, 1)

    def outputs(self, hidden: np.ndarray, x: np.ndarray, updates: Sequence[Update] = ()) -> np.ndarray:
        """Outputs (O, C) for columns that are rounded, with `updates` by memory and by inputs if there are any."""
        added = sum(update.of(of) for update, of in zip(updates, (hidden, x), strict=False))
        units = np.maximum(self.inward @ np.concatenate([hidden, x]) + self.inward_bias + added, 0)
        return self.outward @ units + self.outward_bias


def recurrent_of(of: Mapping[str, np.ndarray], network: str, layer: int) -> Recurrent:
    """A recurrent layer of a file."""
    names = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
    parts = [of[f"{network}.recurrent.{name}_l{layer}"] for name in names]
    return Recurrent(*parts[:2], *(part.reshape(-1, 1) for part in parts[2:]))


def branch_of(of: Mapping[str, np.ndarray], name: str) -> Branch:
    """A branch of a file."""
    inward, outward = (of[f"{name}.{k}.weight"] for k in (0, 2))
    return Branch(inward, of[f"{name}.0.bias"].reshape(-1, 1), outward, of[f"{name}.2.bias"].reshape(-1, 1))


def updates_of(of: Mapping[str, np.ndarray], product: str) -> list[Update]:
    """The update of a product of the body's network in a list; empty if the file has none."""
    inward, outward = (f"body.updates.{product}.{k}.weight" for k in (0, 1))
    return [Update(of[inward], of[outward])] if inward in of else []
