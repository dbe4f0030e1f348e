"""A whole training run of a network of arms and hands, or of all that PAHMT's Table 1 compares; resumable."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from numpy.random import default_rng
from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn, track
from rich.progress import Progress as Bars

from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.lab.checkpoint import differences, identity
from bodysense.lab.clips import count_clips, open_clips
from bodysense.lab.pahmt.export import write_arms_onnx
from bodysense.lab.pahmt.network import ArmNetwork, ArmNetworkConfig
from bodysense.lab.pahmt.rows import TABLE_1
from bodysense.lab.pahmt.task import ArmSchedule, epoch_steps, train_arms, validate_arms
from bodysense.lab.pahmt.weights_file import read_arms, write_arms
from bodysense.lab.pahmt.windows import ArmRecordings, read_arm_recordings
from bodysense.lab.unoc.training import Progress


@dataclass(frozen=True)
class ArmRun:
    """What `bodysense train arms` was asked for."""

    data: Path
    out: Path  # NAME.onnx or NAME.pt; of a table, a folder
    config: ArmNetworkConfig = ArmNetworkConfig()
    schedule: ArmSchedule = ArmSchedule()
    bodies: int = 1  # every clip on so many bodies
    threads: int | None = None
    licence: str = "Apache-2.0"
    data_note: str = ""


@dataclass(frozen=True, eq=False)
class ArmData:
    """What a run learns from and is watched on."""

    train: ArmRecordings
    validation: ArmRecordings

    @property
    def note(self) -> str:
        """For a card."""
        return f"{len(self.train)} clips, {self.train.minutes:.0f} minutes at 30 Hz, as cameras would see them"


def read_data(run: ArmRun) -> ArmData:
    """The training split and the clips with hands of the validation split."""
    clips = track(open_clips(run.data, "train"), "reading the train split", count_clips(run.data, "train"))
    stiff = run.schedule.without_hands > 0
    learned = read_arm_recordings(
        (clip for clip in clips if clip.has_fingers or stiff), run.bodies, default_rng(run.schedule.seed)
    )
    watched = read_arm_recordings(clip for clip in open_clips(run.data, "val") if clip.has_fingers)
    return ArmData(learned, watched)


def run_arms(run: ArmRun) -> None:
    """Train one network; the weights (.pt), log (.jsonl) and checkpoint (.ckpt) lie beside `run.out`."""
    check_place(run.out)
    console, weights = Console(), run.out.with_suffix(".pt")
    if not is_trained(run, weights):
        data = read_data(run)
        steps = epoch_steps(data.train, run.schedule)
        console.print(f"{data.note}; {steps} steps an epoch", highlight=False)

        def report(progress: Progress) -> None:
            terms, figures = (
                ", ".join(f"{name} {value:.4f}" for name, value in values.items())
                for values in (progress.terms, progress.validation)
            )
            console.print(
                f"step {progress.step}/{progress.steps}, {progress.seconds:.0f} s; {terms}; validation {figures}",
                highlight=False,
            )

        train_network(run, weights, data, report)
    network, card = read_arms(weights)
    if run.out.suffix == ".onnx":
        write_arms_onnx(network, run.out, card)
    console.print(f"wrote {run.out} ({run.out.stat().st_size / 1e6:.1f} MB)", highlight=False)


def run_table(run: ArmRun, names: Sequence[str] = tuple(TABLE_1)) -> None:
    """Train what is not trained yet of the table's networks into the folder `run.out`."""
    unknown = [name for name in names if name not in TABLE_1]
    if unknown:
        raise BodysenseError(f"unknown network {unknown[0]!r}; valid are {', '.join(TABLE_1)}")
    try:
        run.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BodysenseError(f"{run.out}: no folder can be made there ({error.strerror}); choose another") from None
    runs = {name: row_run(run, name) for name in names}
    todo = [one for one in runs.values() if not is_trained(one, one.out)]
    console = Console()
    if todo:
        data = read_data(run)
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} steps"))
        steps = run.schedule.epochs * epoch_steps(data.train, run.schedule)
        before = steps * (len(runs) - len(todo))
        with Bars(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console) as bars:
            bar = bars.add_task("training", total=steps * len(runs), completed=before)
            for place, one in enumerate(todo):
                bars.update(bar, description=one.out.stem)

                def report(now: Progress, done: int = before + steps * place) -> None:
                    bars.update(bar, completed=done + now.step)

                train_network(one, one.out, data, report)
                figures = ", ".join(f"{name} {value}" for name, value in read_arms(one.out)[1]["validation"].items())
                console.print(f"trained {one.out.stem}: {figures}", highlight=False)
    console.print(f"{len(runs)} networks in {run.out}", highlight=False)


def row_run(run: ArmRun, name: str) -> ArmRun:
    """The run of one network of the table."""
    row = TABLE_1[name]
    config = replace(run.config, kind=row.kind, input=row.input)
    schedule = replace(run.schedule, losses=row.losses)
    return replace(run, out=run.out / f"{name}.pt", config=config, schedule=schedule)


def train_network(run: ArmRun, weights: Path, data: ArmData, report: Callable[[Progress], None]) -> None:
    """Train one network and write its weights, with a card that says what they are."""
    if run.threads is not None:
        torch.set_num_threads(run.threads)
    torch.manual_seed(run.schedule.seed)
    log, begun = weights.with_suffix(".jsonl"), time.monotonic()

    def noted(progress: Progress) -> None:
        with log.open("a", encoding="utf-8") as file:
            file.write(json.dumps(vars(progress)) + "\n")
        report(progress)

    network, source = ArmNetwork(run.config), source_of(run)
    checkpoint = weights.with_suffix(".ckpt")
    network = train_arms(network, run.schedule, data.train, data.validation, checkpoint, noted, source)
    figures = validate_arms(network, data.validation, run.schedule.studio)
    card = {
        "identity": identity(run.config, run.schedule, source),
        "licence": run.licence,
        "training_data": run.data_note or data.note,
        "seed": run.schedule.seed,
        "seconds": round(time.monotonic() - begun, 1),
        "validation": {name: round(value, 4) for name, value in figures.items()},
    }
    write_arms(network, weights, card)


def source_of(run: ArmRun) -> dict[str, Any]:
    """What a run learns from, for its identity."""
    return {"data": str(run.data.resolve()), "bodies": run.bodies}


def is_trained(run: ArmRun, weights: Path) -> bool:
    """Whether the weights are there, trained as this run asks. Raises BodysenseError if trained otherwise."""
    if not weights.is_file():
        return False
    before, now = read_arms(weights)[1]["identity"], identity(run.config, run.schedule, source_of(run))
    if json.loads(before) != json.loads(now):
        raise BodysenseError(
            f"{weights} is of another configuration ({differences(before, now)}); give another --out, or those settings"
        )
    return True
