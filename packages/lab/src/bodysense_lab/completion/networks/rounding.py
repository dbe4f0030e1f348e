"""Rounding of weights to bytes that keeps the network's products accurate on its real inputs.

If each weight is rounded to the nearest byte, rounding errors of a row add up in its product. Here columns are rounded
one after the other, and the remaining columns compensate for the error of each (Frantar et al. 2023, GPTQ).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import torch
from torch import Tensor

from bodysense_lab.completion.data.batches import RawBatch, SequenceBatch, assembled
from bodysense_lab.completion.networks.network import CompletionNetwork
from bodysense_lab.completion.networks.weights_file import row_step

_DAMPING = 0.01  # of the inputs' mean square; keeps inputs that were always 0 from compensating
_LARGEST = 127  # of a byte
_STRIDE = 10  # frames between samples; neighbouring frames are alike


@torch.no_grad()
def sample_moments(network: CompletionNetwork, batches: Iterable[RawBatch | SequenceBatch]) -> dict[str, np.ndarray]:
    """Return second moments (K, K) of the inputs of each large product of the body's network, by parameter.

    Every `_STRIDE`-th frame of the sequences and of their mirror images counts. Sequences continue from batch to batch.
    """
    sums, frames, memory = dict[str, np.ndarray](), 0, None
    for batch in map(assembled, batches):
        people, length = batch.valid.shape
        features = network.read_both(batch.signal)
        before = network.begin(2 * people) if memory is None else memory
        memory = torch.where(batch.begins.repeat_interleave(2)[:, None], 0.0, before)
        for t in range(length):
            read, before = features[:, t].flatten(0, 1), memory
            # For a single frame, the memory is the output of all layers.
            _, memory = network.remember(read[:, None], before)
            if t % _STRIDE == 0:
                valid = batch.valid[:, t].repeat_interleave(2)
                for name, rows in _read_by(read, before, memory).items():
                    wide = rows[valid].double()
                    sums[name] = sums.get(name, 0.0) + (wide.mT @ wide).numpy()
                frames += int(valid.sum())
    return {name: moment / frames for name, moment in sums.items()}


def _read_by(features: Tensor, before: Tensor, after: Tensor) -> dict[str, Tensor]:
    """Return the inputs (N, K) of the products of a frame, by parameter."""
    rows = {"recurrent.weight_ih_l0": features, "turn_branch.0.weight": torch.cat([after[-1], features], dim=-1)}
    rows |= {f"recurrent.weight_hh_l{layer}": each for layer, each in enumerate(before)}
    return rows | {f"recurrent.weight_ih_l{layer}": each for layer, each in enumerate(after[:-1], start=1)}


def round_weights(network: CompletionNetwork, moments: Mapping[str, np.ndarray]) -> None:
    """Round the weights that have moments, in place."""
    parameters = dict(network.named_parameters())
    with torch.no_grad():
        for name, moment in moments.items():
            values = rounded(parameters[name].numpy(), moment)
            parameters[name].copy_(torch.from_numpy(values))


def rounded(values: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Round weights (N, K) to multiples of `row_step`, for inputs with second moment `moment` (K, K).

    Each row keeps its step. A row whose products would be less accurate than with nearest rounding, which happens with
    few inputs, is rounded to the nearest.
    """
    step = row_step(values)[:, 0].astype(np.float64)
    remaining, counts = values.astype(np.float64).copy(), np.empty(values.shape)
    widest = np.abs(values).argmax(axis=1)
    damped = moment + _DAMPING * np.trace(moment) / len(moment) * np.eye(len(moment))
    order = np.argsort(-np.diag(moment))  # the largest inputs are rounded first
    inverse = np.linalg.cholesky(np.linalg.inv(damped[np.ix_(order, order)])).T
    for place, column in enumerate(order):
        count = np.clip(np.round(remaining[:, column] / step), -_LARGEST, _LARGEST)
        # The largest weight is not compensated: it defines the row's step.
        count = np.where(widest == column, np.round(values[:, column] / step), count)
        error = (remaining[:, column] - count * step) / inverse[place, place]
        later = order[place + 1 :]
        remaining[:, later] -= error[:, None] * inverse[place, place + 1 :]
        counts[:, column] = count
    nearest = np.round(values / step[:, None])
    offs = [each * step[:, None] - values for each in (counts, nearest)]
    error, plain = (np.einsum("nk,nk->n", off @ moment, off) for off in offs)  # mean squares of products
    counts = np.where((error < plain)[:, None], counts, nearest)
    return (counts * step[:, None]).astype(np.float32)
