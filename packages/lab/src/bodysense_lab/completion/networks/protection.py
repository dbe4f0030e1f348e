"""Learning of new inputs that keeps a network's answers on known ones.

The answers of a product change by the change of its weights times its inputs. So changes are shrunk along directions
that known inputs use, by the inputs' second moments (Zeng et al. 2019, "Continual learning of context-dependent
processing in neural networks"). After training, the weights are merged with the initial ones so that the products on
known and on new inputs change least (Jin et al. 2023, "Dataless knowledge fusion by merging weights of language
models").
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from bodysense_lab.completion.data.batches import RawBatch, SequenceBatch, assembled
from bodysense_lab.completion.networks.network import CompletionNetwork

Products = Mapping[str, Tensor]  # a matrix for each product: weights (N, K), or second moments (K, K) of its inputs
_STRIDE = 4  # frames between samples; neighbouring frames are alike
_SHRINKING = 0.2  # by which a change along a direction with mean energy is divided at each step, beyond 1
_DAMPING = 1e-4  # of the mean square of new inputs; decides where neither known nor new inputs say anything
_BRANCHES = ("turn_branch", "judge_branch")


@torch.no_grad()
def products_of(network: CompletionNetwork) -> dict[str, Tensor]:
    """Return the weights (N, K) of all products, float64. Their inputs are those of `_inputs`.

    Reset and update gates add the products of features and memory, so that they are one product of both. The candidate
    has one of each.
    """
    state, hidden = network.state_dict(), network.config.hidden
    products = dict[str, Tensor]()
    for layer in range(network.config.layers):
        of_input, of_memory, input_bias, memory_bias = (
            state[f"recurrent.{name}_l{layer}"].double() for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
        )
        gates, rest = slice(0, 2 * hidden), slice(2 * hidden, None)
        bias = (input_bias + memory_bias)[gates, None]
        products[f"gates{layer}"] = torch.cat([of_input[gates], of_memory[gates], bias], dim=1)
        products[f"input{layer}"] = torch.cat([of_input[rest], input_bias[rest, None]], dim=1)
        products[f"memory{layer}"] = torch.cat([of_memory[rest], memory_bias[rest, None]], dim=1)
    for name in (f"{branch}.{place}" for branch in _BRANCHES for place in (0, 2)):
        products[name] = torch.cat([state[f"{name}.weight"], state[f"{name}.bias"][:, None]], dim=1).double()
    return products


@torch.no_grad()
def set_products(network: CompletionNetwork, products: Products) -> None:
    """Set the weights of a network to those of its products, in place."""
    parameters, hidden = dict(network.named_parameters()), network.config.hidden
    for layer in range(network.config.layers):
        gates, of_input, of_memory = (products[f"{name}{layer}"] for name in ("gates", "input", "memory"))
        width = gates.shape[1] - 1 - hidden
        values = {
            "weight_ih": torch.cat([gates[:, :width], of_input[:, :-1]]),
            "weight_hh": torch.cat([gates[:, width:-1], of_memory[:, :-1]]),
            "bias_ih": torch.cat([gates[:, -1], of_input[:, -1]]),
            "bias_hh": torch.cat([torch.zeros_like(gates[:, -1]), of_memory[:, -1]]),
        }
        for name, value in values.items():
            parameters[f"recurrent.{name}_l{layer}"].copy_(value)
    for name in (f"{branch}.{place}" for branch in _BRANCHES for place in (0, 2)):
        parameters[f"{name}.weight"].copy_(products[name][:, :-1])
        parameters[f"{name}.bias"].copy_(products[name][:, -1])


@torch.no_grad()
def input_moments(
    network: CompletionNetwork,
    batches: Iterable[RawBatch | SequenceBatch],
    chosen: Callable[[SequenceBatch], Tensor],
) -> dict[str, Tensor]:
    """Return second moments (K, K) of the inputs of all products, float64.

    Args:
        network: its products.
        batches: batches of sequences, which continue from batch to batch.
        chosen: returns the sequences of a batch that count, (B,) bool.
    """
    sums, frames, memory = dict[str, Tensor](), 0, None
    layers = [_single_layer(network, layer) for layer in range(network.config.layers)]
    for batch in map(assembled, batches):
        before = network.begin(len(batch.begins)) if memory is None else memory
        before = torch.where(batch.begins[None, :, None], 0.0, before)
        rows, memory = chosen(batch), before.clone()
        if not rows.any():
            continue
        counted = batch.valid[rows].clone()
        counted[:, torch.arange(counted.shape[1]) % _STRIDE != 0] = False
        read = network.read(batch.signal)[rows]
        features, inputs = read, dict[str, Tensor]()
        for layer, single in enumerate(layers):
            first = before[layer, rows]
            output, after = single(features, first[None].contiguous())
            memory[layer, rows] = after[0]
            earlier = torch.cat([first[:, None], output[:, :-1]], dim=1)
            inputs |= {
                f"gates{layer}": torch.cat([features, earlier], dim=-1)[counted],
                f"input{layer}": features[counted],
                f"memory{layer}": earlier[counted],
            }
            features = output
        both = torch.cat([features, read], dim=-1)[counted]
        for branch in _BRANCHES:
            inputs[f"{branch}.0"] = both
            inputs[f"{branch}.2"] = torch.relu(network.get_submodule(f"{branch}.0")(both))
        for name, values in inputs.items():
            wide = torch.cat([values, values.new_ones(len(values), 1)], dim=1).double()
            sums[name] = sums.get(name, 0.0) + wide.mT @ wide
        frames += int(counted.sum())
    return {name: moment / max(frames, 1) for name, moment in sums.items()}


def _single_layer(network: CompletionNetwork, layer: int) -> nn.GRU:
    """Return one recurrent layer of a network, whose memory is known in every frame."""
    width = network.features if layer == 0 else network.config.hidden
    single = nn.GRU(width, network.config.hidden, batch_first=True)
    ending = f"_l{layer}"
    state = network.recurrent.state_dict().items()
    single.load_state_dict({name.replace(ending, "_l0"): value for name, value in state if name.endswith(ending)})
    return single


@dataclass(frozen=True, eq=False)
class Protection:
    """Protection of a network's answers on known inputs."""

    initial: Products  # weights
    known: Products  # second moments of known inputs
    shrinking: Products  # (K, K) factors of changes at each step

    @classmethod
    def of(cls, network: CompletionNetwork, known: Products) -> Protection:
        """Return the protection of a network's answers on inputs with second moments `known`."""
        factors = dict[str, Tensor]()
        for name, moment in known.items():
            energy, directions = torch.linalg.eigh(moment)
            relative = energy.clamp(min=0.0) / energy.mean()
            factors[name] = (directions / (1 + _SHRINKING * relative)) @ directions.mT
        return cls(products_of(network), known, factors)

    def shrink(self, network: CompletionNetwork, share: float) -> None:
        """Shrink the changes of a network after a step of training, in place.

        `share` is the learning rate as a share of the highest: shrinking that does not fall with the rate undoes at the
        end what was learned.
        """
        changed = dict[str, Tensor]()
        for name, now in products_of(network).items():
            change = now - self.initial[name]
            changed[name] = now + share * (change @ self.shrinking[name] - change)
        set_products(network, changed)

    def merge(self, network: CompletionNetwork, new: Products, weight: float) -> None:
        """Merge a trained network with the initial one, in place.

        The products on known inputs, times `weight`, and on new ones with second moments `new` change least.
        """
        merged = dict[str, Tensor]()
        for name, value in products_of(network).items():
            damping = _DAMPING * new[name].diagonal().mean() * torch.eye(len(new[name]), dtype=torch.float64)
            of_new, of_known = new[name] + damping, weight * (self.known[name] + damping)
            change = (value - self.initial[name]) @ of_new
            merged[name] = self.initial[name] + torch.linalg.solve((of_new + of_known).mT, change.mT).mT
        set_products(network, merged)
