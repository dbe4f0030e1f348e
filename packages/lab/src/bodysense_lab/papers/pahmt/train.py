"""A whole training run of a network of arms and hands, or of all that PAHMT's Table 1 compares; resumable."""

from __future__ import annotations

import time
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from lightning_fabric import Fabric
from numpy.random import default_rng

from bodysense.errors import BodysenseError
from bodysense.files import check_place, make_folder
from bodysense_lab.core.checkpoint import identity, write_weights_file
from bodysense_lab.core.fit import Report, announce_run, fit, set_seed_and_threads
from bodysense_lab.core.options import SplitReader
from bodysense_lab.core.sweep import is_trained_as_configured, sweep
from bodysense_lab.papers.pahmt.network import ArmNetwork, read_arms
from bodysense_lab.papers.pahmt.options import TABLE_1, ArmRun, ArmTableTraining, ArmTraining
from bodysense_lab.papers.pahmt.recordings import ArmRecordings, read_arm_recordings
from bodysense_lab.papers.pahmt.task import ArmTask, Pair, epoch_steps, step_count


@dataclass(frozen=True, eq=False)
class ArmData:
    """Training and validation data of a run."""

    train: ArmRecordings
    validation: ArmRecordings

    @property
    def note(self) -> str:
        """For a card."""
        return f"{len(self.train)} clips, {self.train.minutes:.0f} minutes at 30 Hz, as cameras would see them"


def read_data(run: ArmRun, clips: SplitReader) -> ArmData:
    """The training split and the clips with hands of the validation split."""
    stiff = run.schedule.without_hands > 0
    learned = read_arm_recordings(
        (clip for clip in clips("train") if clip.has_fingers or stiff), run.bodies, default_rng(run.schedule.seed)
    )
    watched = read_arm_recordings(clip for clip in clips("val") if clip.has_fingers)
    return ArmData(learned, watched)


def run_arms(run: ArmTraining, clips: SplitReader) -> None:
    """Train one network; the weights (.pt), log (.jsonl) and checkpoint (.ckpt) are written next to `run.out`."""
    check_place(run.out)
    weights = run.out.with_suffix(".pt")
    fabric = announce_run(run, ArmTask)
    if not is_trained(run, weights):
        data = read_data(run, clips)
        fabric.print(f"{data.note}; {epoch_steps(data.train, run.schedule)} steps an epoch")
        train_network(run, weights, data, fabric)
    if not fabric.is_global_zero:
        return
    network, card = read_arms(weights)
    if run.out.suffix == ".onnx":
        from bodysense_lab.papers.pahmt.export import write_arms_onnx

        write_arms_onnx(network, run.out, card)
    print(f"wrote {run.out} ({run.out.stat().st_size / 1e6:.1f} MB)")


def run_table(run: ArmTableTraining, clips: SplitReader) -> None:
    """Train what is not trained yet of the table's networks into the folder `run.out`."""
    names = run.networks or tuple(TABLE_1)
    unknown = [name for name in names if name not in TABLE_1]
    if unknown:
        raise BodysenseError(f"unknown network {unknown[0]!r}; valid are {', '.join(TABLE_1)}")
    make_folder(run.out)
    fabric = announce_run(run, ArmTask)
    runs = {name: row_run(run, name) for name in names}
    if not all(is_trained(one, one.out) for one in runs.values()):
        data = read_data(run, clips)

        def train(name: str, report: Report) -> str:
            train_network(runs[name], runs[name].out, data, fabric, report)
            figures = read_arms(runs[name].out)[1]["validation"]
            return f"trained {name}: " + ", ".join(f"{key} {value}" for key, value in figures.items())

        steps = dict.fromkeys(runs, step_count(data.train, run.schedule))
        quiet = not fabric.is_global_zero
        sweep(steps, train, lambda name: is_trained(runs[name], runs[name].out), run.out, quiet=quiet)
    fabric.print(f"{len(runs)} networks in {run.out}")


def row_run(run: ArmRun, name: str) -> ArmRun:
    """The run of one network of the table."""
    row = TABLE_1[name]
    config = replace(run.config, kind=row.kind, input=row.input)
    schedule = replace(run.schedule, losses=row.losses)
    plain = {one.name: getattr(run, one.name) for one in fields(ArmRun)}
    return ArmRun(**plain | {"out": run.out / f"{name}.pt", "config": config, "schedule": schedule})


def train_network(run: ArmRun, weights: Path, data: ArmData, fabric: Fabric, report: Report | None = None) -> None:
    """Train one network and write its weights, with a card that says what they are."""
    set_seed_and_threads(run.schedule.seed, run.threads)
    begun, source, pair = time.monotonic(), source_of(run), Pair(ArmNetwork(run.config))
    task = ArmTask(pair, run.schedule, data.train, data.validation, source, fabric.global_rank)
    figures = fit(task, weights.with_suffix(".ckpt"), report, fabric, report)
    card = {
        "identity": identity(run.config, run.schedule, source),
        "licence": run.licence,
        "training_data": run.data_note or data.note,
        "seed": run.schedule.seed,
        "seconds": round(time.monotonic() - begun, 1),
        "validation": {name: round(value, 4) for name, value in figures.items()},
    }
    if fabric.is_global_zero:
        write_weights_file(pair.network.cpu(), weights, card)
    fabric.barrier()


def source_of(run: ArmRun) -> dict[str, Any]:
    """Return the sources of a run, for its identity."""
    return {"data": str(run.data.resolve()), "bodies": run.bodies, **run.trial_settings}


def is_trained(run: ArmRun, weights: Path) -> bool:
    """Whether the weights are there, trained as this run asks. Raises BodysenseError if trained otherwise."""
    if not weights.is_file():
        return False
    now = identity(run.config, run.schedule, source_of(run))
    return is_trained_as_configured(weights, read_arms(weights)[1]["identity"], now)
