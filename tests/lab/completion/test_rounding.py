"""Weights rounded for what a network reads: whole multiples of the same step, products nearer than by nearest ones."""

from dataclasses import replace
from importlib.resources import as_file, files

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.io.clip import Clip
from bodysense_lab.completion.error_map import unchanged_errors
from bodysense_lab.completion.fingers import FingerConfig, FingerNetwork
from bodysense_lab.completion.graph import CompletionStep
from bodysense_lab.completion.network import CompletionConfig, CompletionNetwork
from bodysense_lab.completion.rounding import moments_of, round_weights, rounded, sample_moments
from bodysense_lab.completion.scenes import scene_of
from bodysense_lab.completion.state import untracked
from bodysense_lab.completion.weights_file import as_stored, read_weights, row_step


def read_by(seed: int, inputs: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights (6, K), and frames (500, K) of few kinds of motion, as a network reads them."""
    rng = np.random.default_rng(seed)
    frames = rng.normal(size=(500, 4)) @ rng.normal(size=(4, inputs)) + 0.05 * rng.normal(size=(500, inputs))
    return rng.normal(size=(6, inputs)).astype(np.float32), frames


@given(st.integers(0, 2**32 - 1), st.integers(5, 40))
@settings(max_examples=40)
def test_products_stay_nearer(seed: int, inputs: int) -> None:
    weights, frames = read_by(seed, inputs)
    step = row_step(weights)
    made_up = rounded(weights, frames.T @ frames / len(frames))
    assert (made_up == np.round(made_up / step) * step).all()
    assert (row_step(made_up) == step).all()
    nearest = np.round(weights / step) * step
    missed = [np.linalg.norm(frames @ (values - weights).T) for values in (made_up, nearest)]
    assert missed[0] < missed[1] or inputs < 10


def test_what_was_never_read_is_rounded_to_the_nearest() -> None:
    weights, frames = read_by(3, 12)
    frames[:, 5:] = 0
    step = row_step(weights)
    got = rounded(weights, frames.T @ frames / len(frames))
    assert (got[:, 5:] == (np.round(weights / step) * step)[:, 5:]).all()


def test_a_network_is_rounded_as_it_will_be_stored() -> None:
    torch.manual_seed(2)
    body = CompletionNetwork(CompletionConfig(hidden=16, branch=16, judge_branch=8)).eval()
    step = CompletionStep(body, FingerNetwork(FingerConfig(hidden=8, branch=8)), *[unchanged_errors()] * 2).eval()
    state = step.start(4)
    with torch.no_grad():
        _, state = step(untracked(4), state)
    moments = moments_of(step, untracked(4), state)
    of = dict(body.named_parameters())
    assert {name: of[name].shape[1] for name in moments} == {name: len(moment) for name, moment in moments.items()}
    assert all(np.linalg.eigvalsh(moment).min() > -1e-9 for moment in moments.values())
    round_weights(body, moments)
    stored = dict(as_stored(step).body.named_parameters())
    for name in moments:
        assert (stored[name] == of[name]).all(), name


def test_moments_are_of_what_a_tracker_asks(waving_clip: Clip) -> None:
    with as_file(files("bodysense.weights") / "completion.safetensors") as path:
        body, fingers = read_weights(path)
    step = CompletionStep(body, fingers, *[unchanged_errors()] * 2).eval()
    clip = replace(waving_clip, pose=waving_clip.pose[:20])
    batch = [scene_of(clip, "own", "train")]
    moments = sample_moments(step, {"own": [batch], "stranger": [batch]})
    assert len(moments) == 5
    assert all(np.isfinite(moment).all() and np.trace(moment) > 0.1 for moment in moments.values())
