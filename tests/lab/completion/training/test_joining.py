"""Training of the joining network: PyTorch agrees with NumPy, the losses are of the joined body, takes are cached."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, mean_rotation, quaternion_exp, quaternion_multiply
from bodysense.takes.joining import keep_tracked_rotations
from bodysense.takes.joining_network import load_joining, shift_share
from bodysense_lab.completion.data import joining_takes
from bodysense_lab.completion.data.joining_takes import KINDS, JoinedTake, cached_takes, draw_observation, draw_takes
from bodysense_lab.completion.score.scenes import TrackedScene
from bodysense_lab.completion.training.joining_task import (
    JoiningConfig,
    JoiningModule,
    JoiningTask,
    JoiningTaskConfig,
    calibrate_errors,
    head_relative_kinematics,
    joined_rotation,
    write_joining,
)
from bodysense_lab.core.options import Schedule


@pytest.fixture(scope="module")
def takes() -> list[JoinedTake]:
    clip = packaged_performance()
    drawn = draw_takes([clip], "train", np.random.default_rng(2))
    return [next(drawn) for _ in range(2)]


def module_of(take: JoinedTake, spread: float = 0.05) -> JoiningModule:
    torch.manual_seed(1)
    network = JoiningModule(JoiningConfig(take.features.shape[1], width=24))
    torch.nn.init.normal_(network.outward.weight, std=spread)
    for values in network.state_dict().values():  # in the precision of a file
        values.copy_(values.half().float())
    return network.eval()


def test_a_written_network_has_the_same_outputs(takes: list[JoinedTake], tmp_path: Path) -> None:
    network = module_of(takes[0])
    write_joining(network, tmp_path / "net.safetensors", {"seed": 3})
    read = takes[0].features.astype(np.float32)
    with torch.no_grad():
        turn, odds, log_scale = network(torch.from_numpy(read)[None])
    opened = load_joining(tmp_path / "net.safetensors")
    expected = np.concatenate([turn[0].flatten(-2).numpy(), odds[0].numpy(), log_scale[0].numpy()], axis=-1)
    np.testing.assert_allclose(opened.outputs(read), expected, atol=2e-5)
    assert opened.card["seed"] == 3


def test_a_network_of_more_blocks_is_refused(takes: list[JoinedTake], tmp_path: Path) -> None:
    larger = JoiningModule(JoiningConfig(takes[0].features.shape[1], width=24, dilations=(1, 2, 4, 8, 16, 32)))
    write_joining(larger, tmp_path / "net.safetensors", {})
    with pytest.raises(BodysenseError, match=r"net.safetensors: a joining network with a block 5; blocks 0 to 4"):
        load_joining(tmp_path / "net.safetensors")


def test_expected_errors_are_calibrated(takes: list[JoinedTake]) -> None:
    """On these takes the mean error equals the expected one, and nine in ten errors are below their bounds."""
    network = module_of(takes[0])
    calibrate_errors(network, takes)
    error, expected, bound = list[np.ndarray](), list[np.ndarray](), list[np.ndarray]()
    for take in takes:
        batch = {
            name: torch.from_numpy(getattr(take, name).astype(np.float32))[None]
            for name in ("features", "past", "future", "share", "world", "truth", "rest_offset")
        }
        turned = torch.from_numpy(take.turned)[None]
        with torch.no_grad():
            turn, odds, log_scale = network(batch["features"])
            offset = batch["rest_offset"][:, None]
            position, _ = head_relative_kinematics(joined_rotation(batch, turn, odds), offset, batch["world"], turned)
            truth, _ = head_relative_kinematics(batch["truth"], offset)
        logarithm = take.expected + log_scale[0].numpy() + network.error_offset.numpy()
        error.append(np.linalg.norm((position - truth)[0].numpy(), axis=-1))
        expected.append(np.exp(logarithm))
        bound.append(np.exp(logarithm + take.spread + network.bound_offset.numpy()))
    hidden = np.concatenate([take.hidden for take in takes])
    pair = [BODY.index("left_knee"), BODY.index("right_knee")]
    true, guess, most = (np.concatenate(values)[:, pair][hidden[:, pair]] for values in (error, expected, bound))
    assert guess.mean() == pytest.approx(true.mean(), rel=0.01)
    assert (true < most).mean() == pytest.approx(0.9, abs=0.01)
    assert network.error_offset[pair[0]] == network.error_offset[pair[1]] != 0


def test_training_and_tracker_join_the_same_body(takes: list[JoinedTake]) -> None:
    """With equal shares, turns and tracked rotations, the body equals that of `two_way`."""
    skeleton, take = packaged_performance().pose.skeleton, takes[0]
    rng = np.random.default_rng(6)
    turn = rng.normal(0, 0.3, (len(take), len(BODY), 3))
    odds = rng.normal(0, 1, (len(take), len(BODY)))
    turned = rng.random(odds.shape) < 0.2
    batch = {name: torch.from_numpy(getattr(take, name).astype(np.float64)) for name in ("past", "future", "share")}
    joined = joined_rotation(batch, torch.from_numpy(turn), torch.from_numpy(odds))
    world, offset = (torch.from_numpy(one.astype(np.float64)) for one in (take.world, take.rest_offset))
    _, local = head_relative_kinematics(joined, offset, world, torch.from_numpy(turned))

    share = shift_share(take.share.astype(float)[:, None], odds)
    mean = mean_rotation(take.past.astype(float), take.future.astype(float), share[..., None])
    rotation = np.zeros((len(take), len(skeleton.joints), 4))
    rotation[..., 0] = 1
    body = skeleton.indices(BODY)
    whole, has = rotation.copy(), np.zeros(rotation.shape[:2], dtype=bool)
    rotation[:, body] = quaternion_multiply(mean, quaternion_exp(turn))
    whole[:, body], has[:, body] = take.world, turned
    rotation = keep_tracked_rotations(skeleton, rotation, whole, has)
    assert geodesic_angle(local.numpy(), rotation[:, body]).max() < 1e-3  # quaternions of a file have three digits


def test_positions_are_those_of_forward_kinematics() -> None:
    pose = packaged_performance().pose[:40]
    body, head = pose.skeleton.indices(BODY), pose.skeleton.index("head")
    position = np.asarray(forward_kinematics(pose)[0])
    found, _ = head_relative_kinematics(
        torch.from_numpy(np.asarray(pose.rotation)[:, body]), torch.from_numpy(pose.skeleton.rest_offset[body])
    )
    np.testing.assert_allclose(found.numpy(), position[:, body] - position[:, [head]], atol=1e-9)


def test_a_short_training_lowers_the_score(takes: list[JoinedTake]) -> None:
    config = JoiningTaskConfig(JoiningConfig(takes[0].features.shape[1], width=24), takes=2, frames=60)
    torch.manual_seed(0)
    network = JoiningModule(config.network)
    task = JoiningTask(network, config, Schedule(steps=40), takes, takes)
    before = task.validate(network)
    optimizer, batches = torch.optim.AdamW(network.parameters(), lr=3e-3), task.batches(np.random.default_rng(0))
    for _ in range(40):
        terms, _ = task.loss(next(batches), None)
        optimizer.zero_grad()
        terms["loss"].backward()
        optimizer.step()
    after = task.validate(network)
    assert after["score"] < 0.97 * before["score"] and after["rotation_deg"] < before["rotation_deg"]


@pytest.mark.parametrize("term", ["position", "rotation", "velocity", "haste", "certainty"])
def test_each_term_penalises_its_error(takes: list[JoinedTake], term: str) -> None:
    """A body with an error of the kind that the term measures has a larger term than the truth."""
    take = takes[0]
    exact = replace(take, past=take.truth, future=take.truth, head=take.true_head, turned=np.zeros_like(take.turned))
    wrong = exact.past.copy()
    if term in ("velocity", "haste"):
        wrong[::2, BODY.index("left_shoulder")] = multiplied_by(wrong[::2, BODY.index("left_shoulder")], 0.5)
    else:
        wrong[:, BODY.index("left_shoulder")] = multiplied_by(wrong[:, BODY.index("left_shoulder")], 0.2)
    assert cost_of(term, replace(exact, past=wrong, future=wrong)) > cost_of(term, exact) + 1e-4


def cost_of(term: str, take: JoinedTake) -> float:
    """Return a weighted term of the loss for the plain mean of both estimates."""
    network = module_of(take, 0.0)
    torch.nn.init.zeros_(network.outward.bias)
    config = JoiningTaskConfig(network.config, takes=1, frames=90)
    task = JoiningTask(network, config, Schedule(), [take], [take])
    terms, _ = task.loss(next(task.batches(np.random.default_rng(0))), None)
    return float(terms[term].detach())


def test_the_true_error_is_the_expected_error_of_least_loss(takes: list[JoinedTake]) -> None:
    """The term is error / expectation + log(expectation), which is least if the expectation equals the error."""
    weight = JoiningTaskConfig(JoiningConfig(1)).losses.certainty

    def cost(expected: float) -> float:
        values = np.full_like(takes[0].expected, expected)
        return cost_of("certainty", replace(takes[0], expected=values)) / weight

    error = (cost(-3.0) + 3.0) * np.exp(-3.0)
    assert (cost(-1.0) + 1.0) * np.exp(-1.0) == pytest.approx(error, rel=1e-3)
    least = cost(np.log(error))
    assert least < cost(np.log(error) - 0.3) and least < cost(np.log(error) + 0.3)


def multiplied_by(rotation: np.ndarray, angle: float) -> np.ndarray:
    return quaternion_multiply(rotation.astype(np.float64), quaternion_exp(np.array([0.0, 0.0, angle])))


def test_every_kind_of_take_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    clip = packaged_performance()
    monkeypatch.setattr(joining_takes, "LONGEST", 90)
    for kind in KINDS:
        monkeypatch.setattr(joining_takes, "KINDS", {kind: 1.0})
        take = next(draw_takes([clip], "val", np.random.default_rng(3)))
        assert np.isfinite(take.features).all() and len(take) >= joining_takes.SHORTEST
        assert np.abs(np.linalg.norm(take.past.astype(float), axis=-1) - 1).max() < 1e-2


def test_every_drawn_set_of_sensors_is_observed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawn sets name knuckles, which a body has as joints of fingers."""
    scene = TrackedScene("demo", "", packaged_performance().pose[:10])
    monkeypatch.setattr(joining_takes, "KINDS", {"lattice": 0.5, "signals": 0.5})
    rng = np.random.default_rng(4)
    seen = [draw_observation(scene, rng) for _ in range(60)]
    assert all(len(one.points) > 0 for one in seen)
    assert any("left_index1" in one.points or "right_index1" in one.points for one in seen)


def test_takes_are_cached_once_all_are_drawn(takes: list[JoinedTake], tmp_path: Path) -> None:
    drawn = list[int]()

    def draw() -> Iterator[JoinedTake]:
        for number in range(9):
            drawn.append(number)
            yield takes[number % 2]

    def cached() -> list[JoinedTake]:
        return cached_takes(tmp_path / "train", draw, 2 * len(takes[0]))

    first, again = cached(), cached()
    assert len(first) == len(again) == len(drawn) >= 2
    fewer = cached_takes(tmp_path / "train", draw, 1)
    assert len(fewer) == 1 == len(list((tmp_path / "train").glob("*.npz"))) and len(cached()) == len(first)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.features, other.features)
        np.testing.assert_array_equal(one.true_head, other.true_head)
