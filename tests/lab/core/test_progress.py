"""Progress in a log: lines of reading with the remaining time, and lines with the pace of trainings."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from bodysense_lab.core import fit, progress, sweep
from bodysense_lab.core.options import Schedule


@dataclass(frozen=True, eq=False)
class Small(fit.Task):
    """Task of one weight that is trained toward 0."""

    network: nn.Module = field(default_factory=partial(nn.Linear, 1, 1))
    schedule: Schedule = Schedule(steps=4, check_every=2, warm_up=0)

    def identity(self) -> str:
        return "{}"

    def batches(self, rng: object, done: int = 0) -> Iterator[Tensor]:
        return itertools.repeat(torch.ones(1, 1))

    def loss(self, batch: Tensor, memory: Any) -> tuple[dict[str, Tensor], Any]:
        return {"loss": self.network(batch).square().sum()}, None

    def validate(self, network: Any) -> dict[str, float]:
        return {"error_cm": 1.0}


def small(folder: Path, name: str, report: fit.Report) -> str:
    fit.fit(Small(), folder / f"{name}.ckpt", report, fit.launch_fabric(), report)
    return f"trained {name}"


@pytest.mark.parametrize("total", [4, None])
def test_a_log_has_the_remaining_time(
    total: int | None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = itertools.chain([100.0, 108.0, 115.0, 124.0], itertools.repeat(126.0))  # s: begun, then after each piece
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    drawn = progress.with_progress_log("abcd", "reading", total)
    assert next(drawn) == "a" and capsys.readouterr().out, "the first line is printed before the first piece is done"
    assert list(drawn) == ["b", "c", "d"]
    ends = ["/4, 15 s, 0:00:15 remaining", "/4, 26 s, 0:00:00 remaining"] if total else [", 15 s"]
    assert capsys.readouterr().out.splitlines() == [f"reading: {n}{end}" for n, end in zip((2, 4), ends, strict=False)]


def test_a_terminal_has_a_bar(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    assert list(progress.with_progress_log("abc", "reading", 3)) == list("abc")
    output = capsys.readouterr().out
    assert "100%" in output and "0/3" not in output


def test_only_the_first_process_displays_progress(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(torch.distributed, "is_initialized", lambda: True)
    monkeypatch.setattr(torch.distributed, "get_rank", lambda: 1)
    assert list(progress.with_progress_log("abc", "reading", 3)) == list("abc") and not capsys.readouterr().out


def test_the_pace_is_reported_at_growing_intervals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reached: list[int] = []
    monkeypatch.setattr(fit, "_PACE", (0.0, 0.0))
    fit.fit(Small(), tmp_path / "a.ckpt", lambda _: None, fit.launch_fabric(), lambda now: reached.append(now.step))
    assert reached == [0, 1, 3]  # checkpoints are at 2 and 4
    monkeypatch.setattr(fit, "_PACE", (5.0, 15.0))
    clock = iter(itertools.chain.from_iterable((now, now) if now in (5, 15, 30, 45) else (now,) for now in range(50)))
    monkeypatch.setattr(fit.time, "monotonic", lambda: next(clock))
    due = fit._pace_is_due(0.0)
    assert [second for second in range(50) if next(due)] == [5, 15, 30, 45]


def test_a_run_of_minutes_ends_in_time_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A step takes a second: 6 s are left of 10 after an interruption, and the learning rate falls to its end."""
    clock = {"now": 0.0}
    monkeypatch.setattr(fit.time, "monotonic", lambda: clock["now"])
    schedule = Schedule(minutes=10 / 60, check_every=2, warm_up=0, last_share=0.0)
    rates: list[float] = []

    class Timed(Small):
        stop: int | None = None

        def rate(self, step: int, steps: int | None = None) -> float:
            rates.append(super().rate(step, steps))
            return rates[-1]

        def loss(self, batch: Tensor, memory: Any) -> tuple[dict[str, Tensor], Any]:
            if self.stop == len(rates):
                raise KeyboardInterrupt
            clock["now"] += 1.0
            return super().loss(batch, memory)

    first = Timed(schedule=schedule)
    object.__setattr__(first, "stop", 5)
    with pytest.raises(KeyboardInterrupt):
        fit.fit(first, tmp_path / "a.ckpt", lambda _: None, fit.launch_fabric())
    reached: list[int] = []
    clock["now"] = 1000.0
    fit.fit(Timed(schedule=schedule), tmp_path / "a.ckpt", lambda now: reached.append(now.step), fit.launch_fabric())
    assert reached == [6, 8, 10, 11]  # the fifth step was lost; the last one begins when the time is over
    rates = rates[:4] + rates[5:]
    assert all(late < early for early, late in itertools.pairwise(rates)) and rates[-1] < 0.01 * rates[0]
    again = fit.fit(
        Timed(schedule=schedule), tmp_path / "a.ckpt", lambda now: reached.append(now.step), fit.launch_fabric()
    )
    assert again == {"error_cm": 1.0} and reached[-1] == 11, "a run whose time is over is not trained again"


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_log_of_a_sweep_has_the_pace_of_each_network(
    jobs: int, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    monkeypatch.syspath_prepend(Path(__file__).parents[3])  # so that worker processes can import `small`
    sweep.sweep({"a": 4, "b": 4}, partial(small, tmp_path), lambda name: False, tmp_path, jobs)
    output = capfd.readouterr().out
    for name in "ab":
        lines = [line for line in output.splitlines() if line.startswith(f"{name} step ")]
        assert ["steps/s, 0:00:0" in line for line in lines] == [False, True, True], output
        assert f"{name} step 0/4, 0 s · cpu, float32 layers, 1 process" in lines[0]
