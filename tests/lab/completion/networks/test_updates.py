"""Low-rank updates of the completion network: they act while the head's pose is not tracked, and only then."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from bodysense.body.skeleton import BODY
from bodysense_lab.completion.data.points import INPUT_POINTS
from bodysense_lab.completion.networks.features import flag_index
from bodysense_lab.completion.networks.network import CompletionConfig, CompletionNetwork, head_is_untracked
from bodysense_lab.completion.networks.weights_file import read_weights, row_step, write_weights

from .test_weights_file import SMALL, small_networks

RANK, FRAMES = 16, 7
PLACE, TURN = flag_index("has_position", "head"), flag_index("has_rotation", "head")


def network_with_updates() -> CompletionNetwork:
    torch.manual_seed(2)
    network = CompletionNetwork(replace(CompletionConfig(**SMALL["network"]), update_rank=RANK)).eval()
    with torch.no_grad():
        for name, values in network.named_parameters():
            if name.startswith("updates."):
                values.copy_(0.3 * torch.randn_like(values))
    return network


def features(network: CompletionNetwork, has_position: list[float], has_rotation: list[float]) -> Tensor:
    """Random features (2, T, F) of heads that are tracked in some frames."""
    out = torch.randn(2, len(has_position), network.features, generator=torch.Generator().manual_seed(3))
    out[..., PLACE], out[..., TURN] = torch.tensor(has_position), torch.tensor(has_rotation)
    return out


def test_flags_are_found_among_the_features() -> None:
    width = 3 * len(INPUT_POINTS)
    assert width + INPUT_POINTS.index("head") == PLACE
    assert 8 * len(INPUT_POINTS) + 6 * len(BODY) + BODY.index("head") == TURN


def test_updates_change_nothing_while_the_head_is_tracked() -> None:
    network = network_with_updates()
    plain = CompletionNetwork(replace(network.config, update_rank=0)).eval()
    plain.load_state_dict({name: v for name, v in network.state_dict().items() if not name.startswith("updates.")})
    tracked = features(network, [1.0] * FRAMES, [1.0] * FRAMES)
    for a, b in zip(network.predict(tracked, network.begin(2)), plain.predict(tracked, plain.begin(2)), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=0)
    # In the last frames the head has no position, no rotation, or neither.
    lost = features(network, [1, 1, 1, 1, 0, 1, 0], [1, 1, 1, 1, 1, 0, 0])
    assert head_is_untracked(lost)[0, :, 0].tolist() == [0, 0, 0, 0, 1, 1, 1]
    ((turned, judged), memory), ((plain_turned, plain_judged), plain_memory) = (
        one.predict(lost, one.begin(2)) for one in (network, plain)
    )
    torch.testing.assert_close(turned[:, :4], plain_turned[:, :4], rtol=0, atol=1e-6)
    for own, other in ((turned[:, 4:], plain_turned[:, 4:]), (judged[:, 4:], plain_judged[:, 4:])):
        assert ((own - other).abs().amax(dim=(0, 2)) > 1e-3).all()
    assert ((memory - plain_memory).abs().amax(dim=(1, 2)) > 1e-3).all()  # of each layer


def test_updates_are_sums_of_weights() -> None:
    """Without any tracked head, updates and weights are one matrix."""
    network = network_with_updates()
    whole = CompletionNetwork(replace(network.config, update_rank=0)).eval()
    weights = {name: values.clone() for name, values in network.state_dict().items()}
    products = {"turn_branch": "turn_branch.0.weight"}
    for layer in range(network.config.layers):
        for kind, of in (("input", "ih"), ("state", "hh")):
            products[f"{kind}_l{layer}"] = f"recurrent.weight_{of}_l{layer}"
    for product, name in products.items():
        weights[name] += weights[f"updates.{product}.1.weight"] @ weights[f"updates.{product}.0.weight"]
    whole.load_state_dict({name: values for name, values in weights.items() if not name.startswith("updates.")})
    lost = features(network, [0.0] * FRAMES, [1.0] * FRAMES)
    (one, memory), (other, wanted) = (each.predict(lost, each.begin(2)) for each in (network, whole))
    for a, b in zip((*one, memory), (*other, wanted), strict=True):
        torch.testing.assert_close(a, b, rtol=0, atol=1e-4)


def test_new_updates_are_zero_and_files_keep_them(tmp_path: Path) -> None:
    new = CompletionNetwork(replace(CompletionConfig(**SMALL["network"]), update_rank=RANK)).eval()
    lost = features(new, [0.0] * FRAMES, [0.0] * FRAMES)
    (turned, _), _ = new.predict(lost, new.begin(2))
    hidden, _ = new.recurrent(lost, new.begin(2))
    torch.testing.assert_close(turned, new.turn_branch(torch.cat([hidden, lost], dim=-1)), rtol=0, atol=1e-5)

    networks, path = replace(small_networks(), body=network_with_updates()), tmp_path / "own.safetensors"
    network = {**SMALL["network"], "update_rank": RANK}
    write_weights(networks, path, {"network": network, "fingers": SMALL["fingers"]})
    read, _ = read_weights(path)
    assert read.config.update_rank == RANK
    for (name, a), (_, b) in zip(networks.body.named_parameters(), read.named_parameters(), strict=True):
        if name.startswith("updates."):
            values = a.detach().numpy()
            assert (np.abs(b.detach().numpy() - values) <= 0.5001 * row_step(values)).all(), name
