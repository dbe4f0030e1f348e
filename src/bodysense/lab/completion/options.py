"""What the training of the tracker's network is asked; read by the command line, so without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense.lab.options import Card, Flat, MotionRun, Schedule, check_ending

FINGER_SCHEDULE = Schedule(steps=2000, learning_rate=2e-3, weight_decay=0.1, check_every=500)


@dataclass(frozen=True, kw_only=True)
class CompletionTraining(MotionRun, Card):
    """Train the completion network and write the whole step as one .onnx file."""

    run: Path | None = None
    """folder of checkpoints and of the motion as it was read; OUT without its ending if omitted"""
    schedule: Flat[Schedule] = Schedule(steps=6200)
    begin_with: Path | None = None
    """checkpoint of an earlier run, or a completion network (.onnx), with whose weights the body's network begins"""
    finger_steps: int = FINGER_SCHEDULE.steps
    """optimiser steps of the fingers' network; 0 leaves relaxed fingers"""
    threads: int | None = 1
    """PyTorch threads"""

    @property
    def folder(self) -> Path:
        """Of the run."""
        return self.out.with_suffix("") if self.run is None else self.run

    def __post_init__(self) -> None:
        check_ending(self.out, ".onnx")
        if self.finger_steps < 0:
            raise BodysenseError(f"--finger-steps {self.finger_steps}: give 0 or more")


@dataclass(frozen=True, kw_only=True)
class FingerTraining(MotionRun):
    """Train the finger network of the completion network alone, as a checkpoint from which training resumes."""

    run: Path | None = None
    """folder of the motion as it was read and of generated fingers; OUT's folder if omitted"""
    schedule: Flat[Schedule] = FINGER_SCHEDULE
    leave_out: str = ""
    """person of whom nothing is learned"""
    generated_hours: float = 0.0
    """hours of generated fingers that are mixed with recorded ones; 0: none"""
    threads: int | None = 1
    """PyTorch threads"""

    @property
    def folder(self) -> Path:
        """Of the run."""
        return self.out.parent if self.run is None else self.run

    def __post_init__(self) -> None:
        if self.out.suffix != ".ckpt":
            raise BodysenseError(f"{self.out}: the run is kept as .ckpt; give a name that ends so")
        if not 0 <= self.generated_hours < 1000:
            raise BodysenseError(f"--generated-hours {self.generated_hours:g}: give 0 to 1000")
