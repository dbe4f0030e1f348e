"""`bodysense train completion`: the tracker's network, from recorded motion to the packaged file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro

from bodysense.errors import BodysenseError

Output = Annotated[Path, tyro.conf.arg(aliases=("-o",))]


def completion(
    data: Path,
    out: Output,
    run: Path | None = None,
    steps: int = 6200,
    learning_rate: float = 1e-3,
    begin_with: Path | None = None,
    finger_steps: int = 2000,
    seed: int = 1,
    threads: int = 1,
    licence: str = "Apache-2.0",
    data_note: str = "",
) -> None:
    """Train the completion network, make its expected errors true, and write the whole step as one .onnx file.

    Training resumes from the checkpoints in the folder of the run.

    Args:
        data: folder of motion with splits (docs/data.md); its train split is learned, its val split watched.
        out: the .onnx file.
        run: folder of checkpoints and of the motion as it was read; OUT without its ending if omitted.
        steps: optimiser steps of the body's network; 6200 take an hour and a half of one core.
        learning_rate: highest learning rate of the body's network.
        begin_with: checkpoint of an earlier run, with whose best weights the body's network begins.
        finger_steps: optimiser steps of the fingers' network; 0 leaves relaxed fingers.
        seed: random seed.
        threads: PyTorch threads.
        licence: licence of the network, for its card.
        data_note: what it was trained on, for its card.
    """
    if out.suffix != ".onnx":
        raise BodysenseError(f"{out}: the network is written as .onnx; give a name that ends so")
    if steps < 1 or finger_steps < 0:
        raise BodysenseError(f"--steps {steps} --finger-steps {finger_steps}: give at least 1 and 0")
    from bodysense.files import check_place
    from bodysense.lab.completion.fingers import FingerConfig, FingerNetwork
    from bodysense.lab.completion.publish import publish
    from bodysense.lab.completion.train import CompletionTraining, train_completion
    from bodysense.lab.completion.train_fingers import FingerTraining, train_fingers
    from bodysense.lab.fit import Schedule

    check_place(out)
    run = out.with_suffix("") if run is None else run
    schedule = Schedule(steps=steps, learning_rate=learning_rate, seed=seed)
    body = train_completion(CompletionTraining(data, run, schedule, begin_with=begin_with, threads=threads))
    fingers = FingerNetwork(FingerConfig()).relaxed_only()
    if finger_steps:
        training = FingerTraining(data, run, run / "fingers.ckpt", threads=threads)
        fingers = train_fingers(replace(training, schedule=replace(training.schedule, steps=finger_steps, seed=seed)))
    card = {"training_data": data_note or str(data.name), "licence": licence, "seed": seed, "steps": steps}
    publish(body.eval(), fingers.eval(), data, out, card)
    print(f"wrote {out}")
