"""`bodysense train gloves`: the networks of a glove with hidden markers (two-hands)."""

from __future__ import annotations

from dataclasses import replace

from bodysense.lab.options import Flat
from bodysense.lab.two_hands.options import GloveTraining


def gloves(run: Flat[GloveTraining]) -> None:
    """Train the networks of a glove (two-hands, 3.2) and write each as an .onnx. Training resumes after a stop.

    Written is a folder: glove_markers.onnx, glove_joints.onnx and so on, each with its checkpoint and log beside it.
    """
    from bodysense.lab.two_hands.train import people_with_fingers, run_gloves

    if not run.leave_one_out:
        run_gloves(run)
        return
    for person in people_with_fingers(run.data):
        run_gloves(replace(run, out=run.out / f"without-{person}", without=(person,)))
