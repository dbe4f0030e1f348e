"""`bodysense train completion`, `completion-fingers`: the tracker's network, from recorded motion to its file."""

from __future__ import annotations

from dataclasses import replace

from bodysense.files import check_place
from bodysense.lab.completion.options import FINGER_SCHEDULE, CompletionTraining, FingerTraining
from bodysense.lab.options import Flat


def completion(run: Flat[CompletionTraining]) -> None:
    """Train the completion network, make its expected errors true, and write the whole step as one .onnx file.

    Training resumes from the checkpoints in the folder of the run. The 6200 steps take an hour and a half of one core.
    """
    from bodysense.lab.completion.fingers import FingerConfig, FingerNetwork
    from bodysense.lab.completion.publish import publish
    from bodysense.lab.completion.train import train_completion
    from bodysense.lab.completion.train_fingers import train_fingers

    check_place(run.out)
    body = train_completion(run)
    fingers = FingerNetwork(FingerConfig()).relaxed_only()
    if run.finger_steps:
        schedule = replace(FINGER_SCHEDULE, steps=run.finger_steps, seed=run.schedule.seed)
        checkpoint = run.folder / "fingers.ckpt"
        fingers = train_fingers(FingerTraining(data=run.data, out=checkpoint, schedule=schedule, threads=run.threads))
    card = {"training_data": run.data_note or str(run.data.name), "licence": run.licence}
    card |= {"seed": run.schedule.seed, "steps": run.schedule.steps}
    publish(body.eval(), fingers.eval(), run.data, run.out, card)
    print(f"wrote {run.out}")


def completion_fingers(run: Flat[FingerTraining]) -> None:
    """Train the finger network of the completion network alone, so that it can be scored on people it does not know.

    Training resumes from its checkpoint, the .ckpt that is written.
    """
    from bodysense.lab.completion.train_fingers import train_fingers

    check_place(run.out)
    train_fingers(run)
    print(f"wrote {run.out}")
