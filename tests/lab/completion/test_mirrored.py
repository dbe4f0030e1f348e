"""The network asked twice: how far its two answers are apart is what it says, and nothing where nothing is unusual."""

import numpy as np
import torch

from bodysense.body.skeleton import BODY
from bodysense.observation import STRAPPED
from bodysense_lab.completion.features import ROWS, Reading
from bodysense_lab.completion.mirrored import LEAST_APART, MirroredNetwork
from bodysense_lab.completion.network import CompletionConfig, CompletionNetwork
from bodysense_lab.completion.points import partners

PEOPLE = 4


def reading() -> Reading:
    torch.manual_seed(1)
    return Reading(
        rows=torch.randn(PEOPLE, 1, ROWS, 3),
        seen=(torch.rand(PEOPLE, ROWS) > 0.4).float(),
        into=torch.linalg.qr(torch.randn(PEOPLE, 1, 3, 3))[0],
        size=torch.rand(PEOPLE, 1) + 0.5,
        interval=torch.full((PEOPLE, 1), 1 / 30),
        accuracy=torch.rand(PEOPLE, 27) / 10 + 1e-3,
        rest_offset=torch.randn(PEOPLE, 75),
        certainty=torch.rand(PEOPLE, 25),
        acceleration=torch.randn(PEOPLE, 1, len(STRAPPED), 3),
        accelerated=(torch.rand(PEOPLE, len(STRAPPED)) > 0.4).float(),
    )


def test_how_far_answers_are_apart_is_told() -> None:
    torch.manual_seed(2)
    network = CompletionNetwork(CompletionConfig(hidden=8, branch=8, judge_branch=8)).eval()
    of = reading()
    answer = MirroredNetwork(network)(of, torch.zeros(PEOPLE, 32))
    features = network.reader(of)[:, None]
    begun = network.begin(PEOPLE)
    plain, image = (
        network.prediction(*network.predict(part, begun)[0]).axes[:, 0]
        for part in features.split(network.features, dim=-1)
    )
    signs = torch.tensor([-1.0, 1, 1])[:, None] * torch.tensor([-1.0, 1])
    half = (plain - image[:, partners(BODY)] * signs) / 2
    wanted = torch.sqrt((half * half).sum(dim=(-1, -2)) + LEAST_APART**2)
    assert torch.allclose(answer.apart, wanted, atol=1e-3)
    assert np.ptp(wanted.detach().numpy()) > 0.01


def test_equal_answers_are_not_apart() -> None:
    torch.manual_seed(2)
    network = CompletionNetwork(CompletionConfig(hidden=8, branch=8, judge_branch=8)).eval()
    with torch.no_grad():  # a network that hears nothing answers the same twice
        for name, parameter in network.named_parameters():
            if "branch.2" in name:
                parameter.zero_()
    apart = MirroredNetwork(network)(reading(), torch.zeros(PEOPLE, 32)).apart
    assert torch.allclose(apart, torch.full_like(apart, LEAST_APART), atol=2e-3)
