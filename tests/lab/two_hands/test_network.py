"""Networks of a glove: inputs, initial weights, and the folded layers of exported ones."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from bodysense_lab.papers.two_hands.network import (
    PAPER_JOINTS,
    PAPER_MARKERS,
    JointNetwork,
    JointNetworkConfig,
    MarkerNetwork,
    MarkerNetworkConfig,
    typical_hand,
)

MARKERS = {"ours": MarkerNetworkConfig((16, 8)), "paper": PAPER_MARKERS}


@pytest.fixture
def read() -> tuple[Tensor, Tensor]:
    """Markers (4, 27), some hidden, and shapes of hands (4, 87), of which one is not known."""
    torch.manual_seed(1)
    shape, hand = typical_hand()
    markers = (shape + 0.02 * torch.randn(4, 9, 3)).flatten(-2)
    markers[1, 3:6] = 0.0
    hands = hand + 0.005 * torch.randn(4, 87)
    hands[2] = 0.0
    return markers, hands


@pytest.mark.parametrize("name", MARKERS)
def test_folded_layers_answer_as_the_network(name: str, read: tuple[Tensor, Tensor]) -> None:
    network = MarkerNetwork(MARKERS[name]).eval()
    assert torch.allclose(network.folded()(network.raw(*read)), network(*read), atol=1e-6)


@pytest.mark.parametrize("config", [JointNetworkConfig((16,)), PAPER_JOINTS])
def test_folded_layers_of_angles_answer_as_the_network(config: JointNetworkConfig, read: tuple[Tensor, Tensor]) -> None:
    network = JointNetwork(config).eval()
    assert torch.allclose(network.folded()(network.raw(*read)), network(*read), atol=1e-5)


def test_a_hidden_marker_differs_from_one_at_the_template(read: tuple[Tensor, Tensor]) -> None:
    markers, hand = read
    shape, _ = typical_hand()
    network = MarkerNetwork(MarkerNetworkConfig((16,)))
    features = network.features(markers, hand)
    assert not features[1, 3:6].any()
    assert features[:, 27:36].sum() == 4 * 9 - 1
    there = markers.clone()
    there[1, 3:6] = shape[1]
    seen = network.features(there, hand)
    assert torch.allclose(seen[1, 3:6], torch.zeros(3), atol=1e-6)  # on the template, and known
    assert seen[1, 28] == 1
    assert features[1, 28] == 0


def test_the_typical_hand_on_the_template_reads_as_zeros() -> None:
    shape, hand = typical_hand()
    features = MarkerNetwork(MarkerNetworkConfig((16,))).features(shape.flatten()[None], hand[None])
    assert torch.allclose(features[:, :27], torch.zeros(1, 27), atol=1e-5)
    assert torch.allclose(features[:, 36:-1], torch.zeros(1, 87), atol=1e-5)
    assert features[0, -1] == 1


def test_an_unknown_hand_reads_as_zeros(read: tuple[Tensor, Tensor]) -> None:
    features = MarkerNetwork(MarkerNetworkConfig((16,))).features(*read)
    assert not features[2, 36:].any()
    assert features[[0, 1, 3], -1].all()
