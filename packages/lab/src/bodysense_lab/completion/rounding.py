"""Weights rounded to bytes so that products stay what they are, for what the network really reads.

Rounding each weight to the nearest byte moves a product by what all its errors add up to. Here columns are rounded one
after the other, and what one misses is made up for by those that are still to come (Frantar et al. 2023, GPTQ).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from rich.progress import track as progress

from bodysense.devices.simulated.sensors import SENSOR_SETS, TABLE_SETS, SensorSet, random_edges
from bodysense_lab.completion.graph import CompletionStep
from bodysense_lab.completion.network import CompletionNetwork
from bodysense_lab.completion.onnx_graph import graph_inputs
from bodysense_lab.completion.options import BODIES
from bodysense_lab.completion.scenes import TRUTH_OF, TrackedScene, Truth, person_of, stacked
from bodysense_lab.completion.state import Inputs, State
from bodysense_lab.completion.weights_file import row_step

_DAMPING = 0.01  # of the mean square of what is read: what was never read must not be made up for
_MOST = 127
_STRIDE = 10  # frames: neighbours tell little more
_EDGES = 6  # random sets of sensors beside the named ones


def sample_moments(
    step: CompletionStep, scenes: Mapping[Truth, Sequence[Sequence[TrackedScene]]], seed: int = 8
) -> dict[str, np.ndarray]:
    """`moments_of` every `_STRIDE`-th frame of batches of scenes, as every kind of device sees them."""
    sets: list[SensorSet] = [SENSOR_SETS[name] for name in TABLE_SETS]
    sets += [edge.more for edge in random_edges(_EDGES, np.random.default_rng(seed))]
    sums, frames = dict[str, np.ndarray](), 0
    for turn, sensors in enumerate(progress(sets, "what products read")):
        for place in range(len(scenes["own"])):
            body = BODIES[(turn + place) % len(BODIES)]
            batch = scenes[TRUTH_OF[body]][place]
            people = [person_of(body, scene.skeleton) for scene in batch]
            state = step.start(len(batch))
            whole = stacked([scene.observe(sensors) for scene in batch])
            for frame, values in enumerate(graph_inputs(whole, people), start=1):
                inputs = Inputs(*(torch.from_numpy(values[name]) for name in Inputs._fields))
                if frame % _STRIDE == 0:
                    for name, moment in moments_of(step, inputs, state).items():
                        sums[name] = sums.get(name, 0.0) + len(batch) * moment
                    frames += len(batch)
                with torch.no_grad():
                    _, state = step(inputs, state)
    return {name: moment / frames for name, moment in sums.items()}


def moments_of(step: CompletionStep, inputs: Inputs, state: State) -> dict[str, np.ndarray]:
    """Second moments (K, K) of what each of the body's large products reads, by parameter, over B frames."""
    network, read = step.body, dict[str, Any]()
    hidden, layers = network.config.hidden, network.config.layers
    hooks = [
        network.reader.register_forward_hook(lambda _, __, features: read.update({"features": features})),
        network.turn_branch.register_forward_pre_hook(lambda _, given: read.update({"both": given[0]})),
    ]
    try:
        with torch.no_grad():
            _, after = step(inputs, state)
    finally:
        for hook in hooks:
            hook.remove()
    size = 2 * layers * hidden
    before, now = (each.memory[:, :size].reshape(-1, layers, hidden) for each in (state, after))
    rows = {"recurrent.weight_ih_l0": read["features"].reshape(-1, network.features)}
    for layer in range(layers):
        rows[f"recurrent.weight_hh_l{layer}"] = before[:, layer]
        if layer:
            rows[f"recurrent.weight_ih_l{layer}"] = now[:, layer - 1]
    rows["turn_branch.0.weight"] = read["both"]
    wide = {name: each.double() for name, each in rows.items()}
    return {name: (each.mT @ each / len(each)).numpy() for name, each in wide.items()}


def round_weights(network: CompletionNetwork, moments: Mapping[str, np.ndarray]) -> None:
    """Round the weights, in place, that have moments."""
    parameters = dict(network.named_parameters())
    with torch.no_grad():
        for name, moment in moments.items():
            values = rounded(parameters[name].numpy(), moment)
            parameters[name].copy_(torch.from_numpy(values))


def rounded(values: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Weights (N, K) as multiples of `row_step`, which they keep, for inputs of a second moment (K, K)."""
    step = row_step(values)[:, 0].astype(np.float64)
    left, counts = values.astype(np.float64).copy(), np.empty(values.shape)
    widest = np.abs(values).argmax(axis=1)
    damped = moment + _DAMPING * np.trace(moment) / len(moment) * np.eye(len(moment))
    order = np.argsort(-np.diag(moment))  # what is read most is rounded first
    inverse = np.linalg.cholesky(np.linalg.inv(damped[np.ix_(order, order)])).T
    for place, column in enumerate(order):
        count = np.clip(np.round(left[:, column] / step), -_MOST, _MOST)
        # The widest stays so: by it the step is found again.
        count = np.where(widest == column, np.round(values[:, column] / step), count)
        missed = (left[:, column] - count * step) / inverse[place, place]
        later = order[place + 1 :]
        left[:, later] -= missed[:, None] * inverse[place, place + 1 :]
        counts[:, column] = count
    return (counts * step[:, None]).astype(np.float32)
