"""`bodysense train completion-fingers`, `evaluate fingers`: the finger network alone, and on people it never met."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from bodysense.errors import BodysenseError
from bodysense.files import check_place

Output = Annotated[Path, tyro.conf.arg(aliases=("-o",))]


def completion_fingers(
    data: Path,
    out: Output,
    run: Path | None = None,
    leave_out: str = "",
    generated_hours: float = 0.0,
    steps: int = 2000,
    seed: int = 1,
    threads: int = 1,
) -> None:
    """Train the finger network of the completion network alone, so that it can be scored on people it does not know.

    Args:
        data: folder of motion with splits (docs/data.md).
        out: the checkpoint, .ckpt; training resumes from it.
        run: folder of the motion as it was read and of generated fingers; OUT's folder if omitted.
        leave_out: person of whom nothing is learned.
        generated_hours: hours of generated fingers that are mixed with recorded ones; 0: none.
        steps: optimiser steps.
        seed: random seed.
        threads: PyTorch threads.
    """
    if out.suffix != ".ckpt":
        raise BodysenseError(f"{out}: the run is kept as .ckpt; give a name that ends so")
    if steps < 1 or not 0 <= generated_hours < 1000:
        raise BodysenseError(f"--steps {steps} --generated-hours {generated_hours:g}: give at least 1, and 0 to 1000")
    from bodysense.lab.completion.finger_task import FingerTaskConfig
    from bodysense.lab.completion.train_fingers import FingerTraining, train_fingers

    check_place(out)
    training = FingerTraining(data, out.parent if run is None else run, out, threads=threads)
    schedule = replace(training.schedule, steps=steps, seed=seed)
    train_fingers(
        replace(training, schedule=schedule, task=FingerTaskConfig(generated_hours=generated_hours, left_out=leave_out))
    )
    print(f"wrote {out}")


def fingers(
    data: Path,
    networks: tuple[Path, ...],
    split: Literal["train", "val", "test"] = "test",
    run: Path | None = None,
    json: Path | None = None,
) -> None:
    """Score fingers that are not tracked, each network on the person whom it was trained without.

    Args:
        data: folder of motion with splits; its train split makes the mean hand of the baseline.
        networks: checkpoints of `bodysense train completion-fingers --leave-out NAME`.
        split: which clips of these people.
        run: folder that keeps the motion as it was read; nothing is kept if omitted.
        json: write the numbers here, as one flat object.
    """
    from rich.console import Console
    from rich.table import Table

    from bodysense.cli.show import write_numbers
    from bodysense.lab.completion.corpus import read_corpus
    from bodysense.lab.completion.finger_table import SETS, finger_numbers, person_clips, score_fingers
    from bodysense.lab.completion.train_fingers import load_finger_network

    if json is not None:
        check_place(json)
    loaded = {path.name: load_finger_network(path) for path in networks}
    scored, learned = (
        read_corpus(data, part, None if run is None else run / f"{part}.npz") for part in (split, "train")
    )
    for name, (_, task) in loaded.items():
        if not task.left_out or not len(person_clips(scored, task.left_out)[0]):
            raise BodysenseError(
                f"{name}: left out {task.left_out or 'no one'!r}, who has no fingers in the {split} split of {data}; "
                "give networks trained with --leave-out NAME of someone who has"
            )
    scores = score_fingers(loaded, scored, learned)
    table = Table(title=f"Fingers of people of whom nothing was learned ({data.name}, {split}), RMSJPE cm")
    for column in ("network", "left out", "generated h", "fingers", "network", "baseline", "ratio"):
        table.add_column(column)
    for one in scores:
        task = one.task
        figures = (f"{100 * one.error:.2f}", f"{100 * one.baseline:.2f}", f"{one.ratio:.2f}")
        table.add_row(one.network, task.left_out, f"{task.generated_hours:g}", SETS[one.sensors], *figures)
    Console().print(table)
    write_numbers(json, finger_numbers(scores))
