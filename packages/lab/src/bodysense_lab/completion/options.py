"""Options of the tracker's training and names in its tables; read by the command line, so without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from bodysense.errors import BodysenseError
from bodysense.ranges import Count, Hours, Processes, within
from bodysense_lab.options import Card, Flat, MethodDefault, MotionRun, Schedule, check_ending

Body = Literal["own", "stranger", "height", "nothing"]
BODIES: tuple[Body, ...] = ("own", "stranger", "height", "nothing")
Fault = Literal["error", "leap"]  # by which a clip's worst frame is found

FINGER_SCHEDULE = Schedule(steps=MethodDefault(2000), learning_rate=2e-3, weight_decay=0.1, check_every=500)

TABLE_SETS = (
    "head",
    "three_point",
    "three_point_imu_feet",
    "three_point_imu_feet_pelvis",
    "four_point",
    "six_point",
    "ten_point",
    "headset_camera",
)


@dataclass(frozen=True, kw_only=True)
class _FolderRun(MotionRun):
    """A run with a folder of its own."""

    run: Path | None = None
    """folder of checkpoints; OUT without its ending if omitted"""
    threads: Processes | None = 1
    """PyTorch threads"""

    @property
    def folder(self) -> Path:
        """The run's folder."""
        return self.out.with_suffix("") if self.run is None else self.run


@dataclass(frozen=True, kw_only=True)
class CompletionTraining(_FolderRun, Card):
    """Train the completion network and write both networks as one .safetensors file."""

    schedule: Flat[Schedule] = Schedule(steps=MethodDefault(6200))
    begin_with: Path | None = None
    """checkpoint of an earlier run, or a completion network (.safetensors), whose weights the body begins with"""
    keep: Annotated[float, within(float, 0, 1)] = 0.0
    """share of the weights of --begin-with in the network that is written, the rest of the trained ones"""
    backward: bool = False
    """train the network that tracks recordings backward in time"""
    finger_steps: Annotated[int, within(int, 0, 10_000_000)] = FINGER_SCHEDULE.steps
    """optimiser steps of the fingers' network; with 0 fingers are those of a --begin-with .safetensors, or relaxed"""

    def __post_init__(self) -> None:
        check_ending(self.out, ".safetensors")
        if self.keep and self.begin_with is None:
            raise BodysenseError(f"--keep {self.keep:g} is a share of earlier weights; give --begin-with, too")


@dataclass(frozen=True, kw_only=True)
class FingerTraining(_FolderRun):
    """Train the finger network of the completion network alone, as a checkpoint from which training resumes."""

    run: Path | None = None
    """folder of generated fingers; OUT's folder if omitted"""
    schedule: Flat[Schedule] = FINGER_SCHEDULE
    leave_out: str = ""
    """person excluded from training"""
    generated_hours: Hours = 0.0
    """hours of generated fingers that are mixed with recorded ones; 0: none"""

    @property
    def folder(self) -> Path:
        """The run's folder."""
        return self.out.parent if self.run is None else self.run

    def __post_init__(self) -> None:
        check_ending(self.out, ".ckpt")


@dataclass(frozen=True, kw_only=True)
class JoiningTraining(_FolderRun, Card):
    """Train the network that joins both answers of a take and write it as one .safetensors file."""

    run: Path | None = None
    """folder of checkpoint and takes; OUT without its ending if omitted"""
    schedule: Flat[Schedule] = Schedule(steps=MethodDefault(4000), check_every=500)
    frames: Count = MethodDefault(500_000)
    """frames of takes to learn from, each completed in both directions first"""

    @property
    def checkpoint(self) -> Path:
        """Where training resumes from."""
        return self.folder / "joining.ckpt"

    def __post_init__(self) -> None:
        check_ending(self.out, ".safetensors")
