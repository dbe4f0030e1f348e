"""Rounding of weights for given inputs: multiples of a step, with more accurate products than nearest rounding."""

import itertools
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st

from bodysense.demo import packaged_performance
from bodysense_lab.completion.data.batches import SequenceBatch, assembled
from bodysense_lab.completion.data.corpus import corpus_of
from bodysense_lab.completion.data.points import HEAD
from bodysense_lab.completion.networks.error_map import identity_map
from bodysense_lab.completion.networks.features import WIDTHS
from bodysense_lab.completion.networks.fingers import FingerConfig, FingerNetwork
from bodysense_lab.completion.networks.network import CompletionConfig, CompletionNetwork
from bodysense_lab.completion.networks.rounding import round_weights, rounded, sample_moments
from bodysense_lab.completion.networks.weights_file import TrainedNetworks, read_weights, row_step, write_weights
from bodysense_lab.completion.training.task import CompletionTask, CompletionTaskConfig
from bodysense_lab.core.options import Schedule

SMALL = CompletionConfig(hidden=16, branch=16, judge_branch=8)


def read_by(seed: int, inputs: int) -> tuple[np.ndarray, np.ndarray]:
    """Return weights (6, K) and correlated inputs (500, K), like those of motion."""
    rng = np.random.default_rng(seed)
    frames = rng.normal(size=(500, 4)) @ rng.normal(size=(4, inputs)) + 0.05 * rng.normal(size=(500, inputs))
    return rng.normal(size=(6, inputs)).astype(np.float32), frames


@given(st.integers(0, 2**32 - 1), st.integers(5, 40))
@example(seed=3617, inputs=10)  # compensation in a row would be less accurate than nearest rounding
def test_products_are_more_accurate_than_with_nearest_rounding(seed: int, inputs: int) -> None:
    weights, frames = read_by(seed, inputs)
    step = row_step(weights)
    compensated = rounded(weights, frames.T @ frames / len(frames))
    assert (compensated == np.round(compensated / step) * step).all()
    assert (row_step(compensated) == step).all()
    nearest = np.round(weights / step) * step
    errors = [np.linalg.norm(frames @ (values - weights).T, axis=0) for values in (compensated, nearest)]
    assert (errors[0] <= errors[1] * (1 + 1e-4)).all()
    assert np.linalg.norm(errors[0]) < np.linalg.norm(errors[1]) or inputs < 10


def test_weights_of_unused_inputs_are_rounded_to_the_nearest() -> None:
    weights, frames = read_by(3, 12)
    frames[:, 5:] = 0
    step = row_step(weights)
    got = rounded(weights, frames.T @ frames / len(frames))
    assert (got[:, 5:] == (np.round(weights / step) * step)[:, 5:]).all()


@pytest.fixture(scope="module")
def batches() -> list[SequenceBatch]:
    """Return two consecutive batches of training sequences."""
    network = CompletionNetwork(SMALL)
    config = CompletionTaskConfig(network.config, streams=3, chunk=21)
    task = CompletionTask(network, config, Schedule(), corpus_of([packaged_performance()]), {})
    return list(map(assembled, itertools.islice(task.batches(np.random.default_rng(4)), 2)))


def small_network() -> CompletionNetwork:
    torch.manual_seed(2)
    return CompletionNetwork(SMALL).eval()


def test_moments_are_of_the_inputs_of_products(batches: list[SequenceBatch]) -> None:
    body = small_network()
    moments = sample_moments(body, batches)
    of = dict(body.named_parameters())
    assert {name: of[name].shape[1] for name in moments} == {name: len(moment) for name, moment in moments.items()}
    assert len(moments) == 5
    for name, moment in moments.items():
        assert np.linalg.eigvalsh(moment).min() > -1e-9 and np.trace(moment) > 0.1, name
    first = batches[0].signal
    with torch.no_grad():
        features = body.read(first)[:, ::10][batches[0].valid[:, ::10]].double()
    own = sample_moments(body, batches[:1])["recurrent.weight_ih_l0"]
    place = WIDTHS["position"]  # masks of points in the middle are the same in a mirror
    masks = slice(place, place + WIDTHS["has_position"])
    head = masks.start + HEAD
    assert own[head, head] == pytest.approx(float(features[:, head].square().mean()), abs=1e-9)


def test_a_network_is_rounded_as_it_is_stored(batches: list[SequenceBatch], tmp_path: Path) -> None:
    body, fingers = small_network(), FingerNetwork(FingerConfig(hidden=8, branch=8))
    moments, path = sample_moments(body, batches), tmp_path / "rounded.safetensors"
    round_weights(body, moments)
    configured = {"network": asdict(body.config), "fingers": asdict(fingers.config)}
    write_weights(TrainedNetworks(body, fingers, *[identity_map()] * 2), path, configured)
    stored, _ = read_weights(path)
    of, read = dict(body.named_parameters()), dict(stored.named_parameters())
    for name in moments:
        assert (read[name] == of[name]).all(), name
