"""The training loop: it learns, goes on after a stop, and refuses what is another run's."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from lightning_fabric import Fabric

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense_lab.core.fit import Progress, fit, moving_average
from bodysense_lab.papers.unoc.network.network import PAPER, BodyNetwork, BodyNetworkConfig
from bodysense_lab.papers.unoc.sequences.body_sequences import Augmentation, BodyBatch, BodySequence, make_body_sequence
from bodysense_lab.papers.unoc.task import BodySchedule, BodyTask, make_batches, step_count, validate

CARRIED = BodyNetworkConfig(hidden=4, branch=(4,))
SCHEDULE = BodySchedule(steps=60, lanes=3, chunk=15, warm_up=5, learning_rate=3e-3, average_decay=0.5, check_every=20)
WINDOWS = replace(SCHEDULE, epochs=2, epoch_batches=(32, 64), window_stride=4)


def run(
    network: BodyNetwork,
    schedule: BodySchedule,
    sequences: list[BodySequence],
    checkpoint: Path,
    report: Callable[[Progress], None] = lambda progress: None,
) -> BodyNetwork:
    fabric = Fabric(accelerator="cpu", devices=1)
    fit(BodyTask(network, schedule, sequences, sequences[:1]), checkpoint, report, fabric)
    return network


@pytest.mark.slow
def test_the_loss_falls(network: BodyNetwork, few_sequences: list[BodySequence], tmp_path: Path) -> None:
    before = validate(network, few_sequences)
    reports: list[Progress] = []
    longer = replace(SCHEDULE, steps=180, check_every=60)
    trained = run(network, longer, few_sequences, tmp_path / "a.ckpt", reports.append)
    assert [progress.step for progress in reports] == [60, 120, 180]
    losses = [progress.terms["loss"] for progress in reports]
    assert losses[2] < 0.8 * losses[0], losses
    after = validate(trained, few_sequences)
    assert after["body"] < before["body"] and after["body_known"] == before["body_known"]
    assert reports[-1].validation == pytest.approx(validate(trained, few_sequences[:1]))


def test_the_papers_form_learns_from_windows(waving_clip, tmp_path: Path) -> None:
    torch.manual_seed(3)
    network = BodyNetwork(replace(PAPER, hidden=8, branch=(8,), window=5), default_skeleton())
    sequences = [make_body_sequence(waving_clip, network, Augmentation(), np.random.default_rng(0))]
    reports: list[Progress] = []
    schedule = replace(WINDOWS, epochs=3, epoch_batches=(8, 8, 8), window_stride=1, check_every=10)
    run(network, schedule, sequences, tmp_path / "a.ckpt", reports.append)
    assert reports[-1].step == reports[-1].steps == 3 * (90 // 8)
    assert reports[-1].terms["loss"] < 0.8 * reports[0].terms["loss"]


def test_the_state_is_carried_until_a_clip_ends(
    network: BodyNetwork, few_sequences: list[BodySequence], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Memory carries over from chunk to chunk and is empty at the start of a clip."""
    loss, before = BodyTask.loss, [torch.zeros(3, 16)]
    read = network.recurrent.forward

    def watched_read(features: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        handed.append(memory)
        return read(features, memory)

    def watched(
        self: BodyTask, batch: BodyBatch, memory: torch.Tensor | None
    ) -> tuple[dict[str, torch.Tensor], torch.Tensor | None]:
        terms, after = loss(self, batch, memory)
        assert after is not None
        expected = torch.where(batch.begins[:, None], 0.0, before[-1])
        assert torch.equal(handed[-1], expected) and not handed[-1].requires_grad
        before.append(after.detach().float())
        return terms, after

    handed: list[torch.Tensor] = []
    monkeypatch.setattr(network.recurrent, "forward", watched_read)
    monkeypatch.setattr(BodyTask, "loss", watched)
    run(network, replace(SCHEDULE, steps=20), few_sequences, tmp_path / "a.ckpt")
    assert len(before) == 21 and all(memory.any() for memory in before[1:])


def test_a_run_goes_on_after_a_stop(network: BodyNetwork, few_sequences: list[BodySequence], tmp_path: Path) -> None:
    def stop(progress: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(network, SCHEDULE, few_sequences, tmp_path / "a.ckpt", stop)
    assert {path.name for path in tmp_path.iterdir()} == {"a.ckpt", "a.jsonl"}
    reports: list[Progress] = []
    another = BodyNetwork(network.config, default_skeleton())
    run(another, SCHEDULE, few_sequences, tmp_path / "a.ckpt", reports.append)
    assert [progress.step for progress in reports] == [40, 60]
    assert reports[-1].steps == 60
    saved = torch.load(tmp_path / "a.ckpt", weights_only=True)
    assert saved["step"] == 60 and {int(row["step"]) for row in saved["optimizer"]["state"].values()} == {60}
    # Nothing is left to do: the same network again.
    finished = run(BodyNetwork(network.config, default_skeleton()), SCHEDULE, few_sequences, tmp_path / "a.ckpt")
    for one, other in zip(finished.state_dict().values(), another.state_dict().values(), strict=True):
        assert torch.equal(one, other)


def test_a_checkpoint_of_another_schedule_is_refused(
    network: BodyNetwork, few_sequences: list[BodySequence], tmp_path: Path
) -> None:
    short = replace(SCHEDULE, steps=2, check_every=1)
    run(network, short, few_sequences, tmp_path / "a.ckpt")
    message = r"a\.ckpt belongs to another configuration \(schedule\.seed: 1 → 2\); give another --out"
    with pytest.raises(BodysenseError, match=message):
        run(network, replace(short, seed=2), few_sequences, tmp_path / "a.ckpt")


def test_the_same_seed_trains_the_same(few_sequences: list[BodySequence], tmp_path: Path) -> None:
    weights = []
    for name in ("a", "b"):
        torch.manual_seed(0)
        network = BodyNetwork(BodyNetworkConfig(hidden=16, branch=(16,)), default_skeleton())
        run(network, replace(SCHEDULE, steps=5), few_sequences, tmp_path / f"{name}.ckpt")
        weights.append(torch.cat([value.flatten() for value in network.state_dict().values()]))
    assert torch.equal(*weights)


def test_the_kept_weights_are_the_average(
    network: BodyNetwork, few_sequences: list[BodySequence], tmp_path: Path
) -> None:
    trained = run(network, replace(SCHEDULE, steps=7), few_sequences, tmp_path / "a.ckpt")
    saved = torch.load(tmp_path / "a.ckpt", weights_only=True)
    for name, value in trained.state_dict().items():
        assert torch.equal(value, saved["average"][f"module.{name}"])
    assert any(not torch.equal(value, trained.state_dict()[name]) for name, value in saved["network"].items())


def test_moving_average() -> None:
    old, new = torch.zeros(2), torch.ones(2)
    assert moving_average(old, new, 1000, 0.0).tolist() == [1.0, 1.0]  # 0 keeps the last ones
    assert moving_average(old, new, 10_000, 0.9).tolist() == pytest.approx([0.1, 0.1])
    assert moving_average(old, new, 1, 0.999).tolist() == pytest.approx([1 - 2 / 11] * 2)  # the beginning is forgotten


def test_learning_rate() -> None:
    schedule = BodySchedule(steps=1000, warm_up=100)
    carried, windowed = (
        BodyTask(BodyNetwork(config, default_skeleton()), schedule, [], []) for config in (CARRIED, PAPER)
    )
    rates = [carried.rate(step) for step in range(1, 1001)]
    assert rates[49] == pytest.approx(5e-4) and max(rates) == pytest.approx(1e-3)
    assert np.argmax(rates) == 99 and rates[-1] == pytest.approx(1e-5)
    assert windowed.rate(1) == windowed.rate(999) == 1e-3


@given(st.lists(st.integers(2, 40), min_size=1, max_size=6), st.integers(1, 5), st.integers(1, 30), st.integers(0, 9))
def test_the_batches_suffice_for_all_steps(lengths: list[int], stride: int, batch: int, seed: int) -> None:
    """However clips and windows fall, the run reaches its last step, where it saves."""
    sequences = [sequence_of(length) for length in lengths]
    config = BodyNetworkConfig(hidden=4, branch=(4,), window=3)
    schedule = BodySchedule(epochs=3, epoch_batches=(batch, 2 * batch, 2 * batch), window_stride=stride, seed=seed)
    steps = step_count(config, schedule, sequences)
    assert steps >= 1
    assert sum(1 for _ in make_batches(config, schedule, sequences, np.random.default_rng(seed), 0)) >= steps


def test_fingers_are_drawn_by_their_share() -> None:
    """Clips with fingers are short and few; they still make up the share of the frames that was asked for."""
    sequences = [sequence_of(30, fingers=True), sequence_of(100), sequence_of(200), sequence_of(300)]
    schedule = BodySchedule(lanes=8, chunk=10, finger_share=0.4)
    batches = make_batches(CARRIED, schedule, sequences, np.random.default_rng(1), 0)
    with_fingers = frames = 0
    for _ in range(1500):
        batch = next(batches)
        with_fingers += int((batch.valid & batch.fingers[:, None]).sum())
        frames += int(batch.valid.sum())
    assert with_fingers / frames == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize("fingers", [True, False])
def test_one_kind_of_clips_is_enough(fingers: bool) -> None:
    batch = next(make_batches(CARRIED, BodySchedule(lanes=2), [sequence_of(9, fingers)], np.random.default_rng(1), 0))
    assert batch.fingers.tolist() == [fingers, fingers]


def test_validation_by_hand(network: BodyNetwork, few_sequences: list[BodySequence]) -> None:
    """Root mean square, cm, over hidden points of the joints that the paper tests; fingers only where recorded."""
    names = network.skeleton.points
    tested = [
        p for p, name in enumerate(names) if name[:-1].endswith(("shoulde", "elbo", "wris", "hi", "kne", "ankl", "foo"))
    ]
    assert len(tested) == 14
    squares = []
    for sequence in few_sequences:
        hidden = ~sequence.visible[:, tested]
        squares.append(((sequence.known - sequence.offset)[:, tested] ** 2).sum(axis=-1)[hidden])
    scores = validate(network, few_sequences)
    assert scores["body_known"] == pytest.approx(100 * np.sqrt(np.concatenate(squares).mean()), rel=1e-4)
    assert set(scores) == {"body", "body_known", "finger", "finger_known"}
    assert set(validate(network, few_sequences[2:])) == {"body", "body_known"}, "no fingers, no figure"
    assert json.loads(json.dumps(scores)) == scores


def sequence_of(length: int, fingers: bool = False) -> BodySequence:
    """An empty sequence of some length."""
    return BodySequence(
        features=np.zeros((length, 1), dtype=np.float32),
        known=np.zeros((length, 1, 3), dtype=np.float32),
        offset=np.zeros((length, 1, 3), dtype=np.float32),
        visible=np.ones((length, 1), dtype=bool),
        fingers=fingers,
    )
