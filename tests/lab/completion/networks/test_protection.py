"""Protection of a network's answers: products, moments of their inputs, shrinking and merging."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from torch import Tensor

from bodysense_lab.completion.data.batches import SequenceBatch, assembled
from bodysense_lab.completion.networks.network import CompletionConfig, CompletionNetwork
from bodysense_lab.completion.networks.protection import Protection, input_moments, products_of, set_products
from bodysense_lab.completion.training.packaged import packaged_corpus
from bodysense_lab.completion.training.task import CompletionTask, CompletionTaskConfig
from bodysense_lab.core.options import Schedule

CONFIG = CompletionConfig(hidden=12, branch=10, judge_branch=6)


def network(seed: int) -> CompletionNetwork:
    torch.manual_seed(seed)
    return CompletionNetwork(CONFIG).eval()


@pytest.fixture(scope="module")
def batches() -> list[SequenceBatch]:
    config = CompletionTaskConfig(CONFIG, streams=6, chunk=24)
    task = CompletionTask(network(0), config, Schedule(), packaged_corpus(), {})
    return list(map(assembled, itertools.islice(task.batches(np.random.default_rng(2)), 3)))


def answers(body: CompletionNetwork, batches: list[SequenceBatch], usual: bool) -> Tensor:
    with torch.no_grad():
        parts = [body.predict(body.read(one.signal), body.begin(6))[0][0][one.usual == usual] for one in batches]
    return torch.cat([part.flatten() for part in parts])


def test_products_give_the_network_back(batches: list[SequenceBatch]) -> None:
    first, second = network(1), network(2)
    set_products(second, products_of(first))
    torch.testing.assert_close(answers(second, batches, True), answers(first, batches, True), atol=1e-5, rtol=1e-4)


def test_moments_are_of_the_inputs_of_products(batches: list[SequenceBatch]) -> None:
    """Compared with the network itself: the products of the last layer on its inputs are its outputs."""
    body = network(3)
    moments = input_moments(body, batches, lambda batch: torch.ones_like(batch.usual))
    products = products_of(body)
    assert {name: value.shape[1] for name, value in products.items()} == {
        name: len(value) for name, value in moments.items()
    }
    total, frames, memory = 0.0, 0, body.begin(6)
    for batch in batches:
        memory = torch.where(batch.begins[None, :, None], 0.0, memory)
        with torch.no_grad():
            (turned, _), memory = body.predict(body.read(batch.signal), memory)
        counted = batch.valid.clone()
        counted[:, torch.arange(24) % 4 != 0] = False
        total, frames = total + turned[counted].double().square().sum(dim=0), frames + int(counted.sum())
    last = products["turn_branch.2"]
    squares = torch.einsum("nk,kl,nl->n", last, moments["turn_branch.2"], last)
    torch.testing.assert_close(squares, total / frames, atol=1e-6, rtol=1e-3)


def test_shrinking_and_merging_keep_answers_on_known_inputs(batches: list[SequenceBatch]) -> None:
    first, changed = network(4), network(4)
    known, new = (input_moments(first, batches, chosen) for chosen in (lambda one: one.usual, lambda one: ~one.usual))
    protection = Protection.of(first, known)
    torch.manual_seed(5)
    with torch.no_grad():
        for parameter in changed.parameters():
            parameter.add_(0.02 * torch.randn_like(parameter))

    def away(body: CompletionNetwork, usual: bool) -> float:
        return float((answers(body, batches, usual) - answers(first, batches, usual)).square().mean().sqrt())

    free = [away(changed, usual) for usual in (True, False)]
    for _ in range(40):
        protection.shrink(changed, 1.0)
    shrunk = [away(changed, usual) for usual in (True, False)]
    assert shrunk[0] < 0.5 * free[0], "answers on known inputs come back"
    before = products_of(changed)
    protection.shrink(changed, 0.0)
    for name, value in products_of(changed).items():
        torch.testing.assert_close(value, before[name], atol=1e-6, rtol=1e-5)
    protection.merge(changed, new, 1e4)
    merged = [away(changed, usual) for usual in (True, False)]
    assert merged[0] < 0.3 * shrunk[0]
    other = network(6)
    before = answers(other, batches, False)
    protection.merge(other, new, 0.0)
    torch.testing.assert_close(answers(other, batches, False), before, atol=1e-4, rtol=1e-3)
