"""Options of trainings and tables on the command line, to which each method adds its own."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import tyro

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split as DataSplit
from bodysense.ranges import Count, Processes, Seed, within

Split = Literal["train", "val", "test", "all"]
SplitReader = Callable[[DataSplit], Iterator[Clip]]  # clips of a split, read one at a time
Output = Annotated[Path, tyro.conf.arg(aliases=("-o",))]
Rate = Annotated[float, within(float, 1, 200)]  # Hz, of frames that clients send
Minutes = Annotated[float, within(float, 0.01, 100_000)]
Seconds = Annotated[float, within(float, 0.1, 86_400)]
T = TypeVar("T")
Flat = Annotated[T, tyro.conf.arg(name="")]  # the fields of a dataclass are the options of the command


TRIAL_COUNTS = {"steps": 4, "finger_steps": 4, "frames": 300}  # defaults of a trial run on few clips


class MethodDefault(int):
    """Default number of a method, distinguishable from an equal number given by the user."""


@dataclass(frozen=True)
class Schedule:
    """Length and learning rate of a training."""

    steps: Count = MethodDefault(9000)
    """optimiser steps"""
    minutes: Minutes | None = None
    """time for all steps, in all sessions together, instead of STEPS; the learning rate falls with it"""
    learning_rate: float = 1e-3
    """highest learning rate"""
    warm_up: int = 100
    """steps until the highest learning rate"""
    last_share: float = 0.01
    """learning rate at the end of the cosine, as a share of the highest"""
    weight_decay: float = 0.02
    """weight decay of the optimiser"""
    average_decay: float = 0.999
    """decay of the moving average of the weights, which is kept"""
    check_every: Count = 750
    """steps between checkpoints"""
    seed: Seed = 1
    """random seed"""


@dataclass(frozen=True, kw_only=True)
class Run:
    """Options of every training run."""

    out: Output
    """file or folder to write; checkpoint and log are next to it, and training resumes from them"""
    limit: Count | None = None
    """number of clips of each split for a trial, spread evenly; all if omitted. A trial has 4 steps without --steps"""
    threads: Processes | None = None
    """PyTorch threads; its own choice if omitted"""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """kind of the devices that train; an accelerator if there is one, if omitted"""
    devices: Processes = 1
    """accelerators that share the training, or processes on a machine without them"""
    nodes: Processes = 1
    """machines that share the training: start it on each with `torchrun`; they share the folder of --out"""

    @property
    def trial_settings(self) -> dict[str, int]:
        """Settings of a trial that are part of the identity of a run; empty for a run on all clips."""
        return {} if self.limit is None else {"limit": self.limit}


@dataclass(frozen=True, kw_only=True)
class Card:
    """Options for the card of a network's file."""

    licence: str = "Apache-2.0"
    """licence of the network, for its card"""
    data_note: str = ""
    """description of the training data, for the card"""


@dataclass(frozen=True, kw_only=True)
class MotionRun(Run):
    """A run that learns from motion."""

    data: Path
    """folder of motion files or prepared store, with a train split for training and a val split for validation"""


@dataclass(frozen=True, kw_only=True)
class ScheduleOptions:
    """Options that change the schedule of a method."""

    seed: Seed = 1
    """random seed"""
    check_every: Count | None = None
    """steps between checkpoints; the method's own if omitted"""

    def with_options(self, schedule: T) -> T:
        """Return the method's schedule with the options of this run."""
        changed: Any = {"seed": self.seed} | ({} if self.check_every is None else {"check_every": self.check_every})
        return replace(schedule, **changed)  # type: ignore[type-var]


@dataclass(frozen=True, kw_only=True)
class Training(MotionRun, Card, ScheduleOptions):
    """A run that learns from motion with the method's schedule."""


@dataclass(frozen=True, kw_only=True)
class TableOptions:
    """Data of a table, and its output files."""

    split: Split = "test"
    """people to score"""
    quick: bool = False
    """score only the first seconds of a few clips, in under a minute; the table says so"""
    jobs: Processes | None = None
    """processes; all processors if omitted"""
    out: Output = Path("bodysense-tables")
    """folder for the table as CSV"""
    json: Path | None = None
    """file for the numbers, as one flat object"""

    @property
    def processes(self) -> int:
        """Number of processes."""
        return self.jobs or os.cpu_count() or 1


Table = Flat[TableOptions]
Data = Annotated[
    str, tyro.conf.arg(help="folder of motion files or a prepared store; NAME=FOLDER names it in the table")
]
Stride = Annotated[Count, tyro.conf.arg(help="score every n-th frame")]
Json = Annotated[Path | None, tyro.conf.arg(help="file for the numbers, as one flat object")]


def as_trial(run: T) -> T:
    """Return a run, with few steps if its clips are limited and its steps are not given; print the changed options."""
    limit, schedule = getattr(run, "limit", None), getattr(run, "schedule", None)
    if limit is None:
        return run
    few, of_schedule = _trial_counts(run), _trial_counts(schedule)
    if few or of_schedule:
        given = " ".join(f"--{name.replace('_', '-')} {count}" for name, count in (of_schedule | few).items())
        print(f"--limit {limit}: a trial with {given}; give these options for other numbers")
    if of_schedule:
        few["schedule"] = replace(schedule, **of_schedule)  # type: ignore[type-var]
    return replace(run, **few)  # type: ignore[type-var]


def _trial_counts(options: Any) -> dict[str, Any]:
    """Return the counts of a trial for the options that are not given."""
    found = {name: getattr(options, name, 0) for name in TRIAL_COUNTS}
    return {
        name: TRIAL_COUNTS[name] for name, value in found.items() if value is None or isinstance(value, MethodDefault)
    }


def check_ending(out: Path, *endings: str, what: str = "the network") -> None:
    """Raise BodysenseError unless the file to write has one of the endings."""
    if out.suffix not in endings:
        raise BodysenseError(f"{out}: {what} is written as {' or '.join(endings)}; give a name with this ending")
