"""`bodysense train completion`, `completion-fingers`: the tracker's network, from recorded motion to its file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.lab.options import Output, check_ending


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
    check_ending(out, ".onnx")
    if steps < 1 or finger_steps < 0:
        raise BodysenseError(f"--steps {steps} --finger-steps {finger_steps}: give at least 1 and 0")
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
