"""Options of the training of the completion networks, and names in the tables. Imports no PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.ranges import Count, Processes, within
from bodysense_lab.core.options import Card, Data, Flat, Json, MethodDefault, MotionRun, Schedule, Split, check_ending

Body = Literal["own", "stranger", "height", "nothing"]
BODIES: tuple[Body, ...] = ("own", "stranger", "height", "nothing")
# Titles of the bodies in tables. An unseen body (`stranger`) was not used in training; the last two are unseen, too.
BODY_TITLES: dict[Body, str] = {
    "own": "own body",
    "stranger": "unseen body",
    "height": "only height known",
    "nothing": "nothing known",
}
Fault = Literal["error", "leap"]  # which error defines the worst frame of a clip

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
class _ThreadedRun(MotionRun):
    """A training in threads of one process."""

    threads: Processes | None = 1
    """PyTorch threads"""


@dataclass(frozen=True, kw_only=True)
class _FolderRun(_ThreadedRun):
    """A training with a folder for its checkpoints."""

    run: Path | None = None
    """folder of checkpoints; OUT without its ending if omitted"""

    @property
    def folder(self) -> Path:
        """The run's folder."""
        return self.out.with_suffix("") if self.run is None else self.run


@dataclass(frozen=True, kw_only=True)
class CompletionTraining(_FolderRun, Card):
    """Train the completion network and write both networks as one .safetensors file."""

    schedule: Flat[Schedule] = Schedule(steps=MethodDefault(6200))
    begin_with: Path | None = None
    """checkpoint of an earlier run, or completion network (.safetensors), with the body's initial weights"""
    keep: Annotated[float, within(float, 0, 1)] = 0.0
    """share of the weights of --begin-with in the average with the trained weights that is written"""
    update_rank: Annotated[int, within(int, 0, 512)] = 0
    """rank of the updates that act while the head's pose is not tracked; they are trained, and all other weights are
    those of --begin-with; 0: train all weights"""
    streams: Count = 96
    """sequences in parallel"""
    draw_processes: Annotated[int, within(int, 0, 1024)] = 0
    """processes that draw sequences for the one that trains; 0: it draws them itself"""
    plays: Count = 1
    """how often a sequence of DRAW_PROCESSES may be played while new ones are drawn"""
    backward: bool = False
    """train the network that tracks recordings backward in time"""
    finger_steps: Annotated[int, within(int, 0, 10_000_000)] = FINGER_SCHEDULE.steps
    """optimiser steps of the fingers' network; 0: fingers of a --begin-with .safetensors, or else relaxed ones"""

    def __post_init__(self) -> None:
        check_ending(self.out, ".safetensors")
        if self.keep and self.begin_with is None:
            raise BodysenseError(f"--keep {self.keep:g} is a share of earlier weights; give --begin-with, too")
        if self.update_rank % 16:
            raise BodysenseError(
                f"--update-rank {self.update_rank}: not a multiple of 16, in which the core counts rows"
            )
        if self.update_rank and self.begin_with is None:
            raise BodysenseError(f"--update-rank {self.update_rank}: updates of which network? Give --begin-with, too")


@dataclass(frozen=True, kw_only=True)
class FingerTraining(_ThreadedRun):
    """Train the finger network alone; write a checkpoint from which training resumes."""

    schedule: Flat[Schedule] = FINGER_SCHEDULE
    leave_out: str = ""
    """person excluded from training"""

    def __post_init__(self) -> None:
        check_ending(self.out, ".ckpt")


@dataclass(frozen=True, kw_only=True)
class JoiningTraining(_FolderRun, Card):
    """Train the network that joins the forward and the backward estimate of a take; write it as .safetensors."""

    run: Path | None = None
    """folder of checkpoint and takes; OUT without its ending if omitted"""
    schedule: Flat[Schedule] = Schedule(steps=MethodDefault(4000), check_every=500)
    frames: Count = MethodDefault(500_000)
    """frames of takes to train on; each take is first completed forward and backward in time"""

    @property
    def checkpoint(self) -> Path:
        """The checkpoint from which training resumes."""
        return self.folder / "joining.ckpt"

    def __post_init__(self) -> None:
        check_ending(self.out, ".safetensors")


@dataclass(frozen=True, kw_only=True)
class EvaluationScope:
    """Motion, sensors and bodies that `evaluate completion` scores."""

    data: Data
    split: Split = "test"
    """people, and unseen bodies, to score"""
    sets: tuple[str, ...] = TABLE_SETS
    """sensor sets"""
    bodies: tuple[Body, ...] = BODIES
    """bodies: the recording's own, known; an unseen one (stranger), known; unseen ones, height or nothing known"""
    limit: Count | None = None
    """number of clips, spread evenly, for a sample with its intervals; all if omitted"""
    takes: bool = False
    """score takes as well, completed with past and future, which takes three times as long"""
    mean_body: bool = True
    """compare hidden joints with the mean body of the train split, which is read whole the first time"""

    def __post_init__(self) -> None:
        unknown = [name for name in self.sets if name not in SENSOR_SETS]
        if unknown:
            raise BodysenseError(f"--sets {unknown[0]}: unknown; valid are {', '.join(SENSOR_SETS)}")
        if not self.bodies:
            raise BodysenseError(f"--bodies: give at least one of {', '.join(BODIES)}")


@dataclass(frozen=True, kw_only=True)
class KindsScope:
    """Motion and sensors that `evaluate kinds` scores."""

    data: Data
    split: Split = "test"
    """people, and unseen bodies, to score"""
    clips: Count = 8
    """number of clips, spread evenly over those of at least 10 s, of which the first 10 s are scored"""
    members: Annotated[int, within(int, 0, 1000)] = 6
    """random sets of each family"""
    pairs: Annotated[int, within(int, 0, 100_000)] = 200
    """random pairs of a set and the same set with one more sensor"""
    model: Path | None = None
    """completion network of your own; the packaged one if omitted"""
    jobs: Processes | None = None
    """processes; all processors if omitted"""
    json: Json = None


@dataclass(frozen=True, kw_only=True)
class EvaluationNetworks:
    """Networks that `evaluate completion` scores."""

    model: Path | None = None
    """completion network of your own; the packaged one if omitted"""
    backward_model: Path | None = None
    """completion network of your own for time that runs backward, in takes; MODEL if omitted"""
    joining_model: Path | None = None
    """joining network of your own, in takes; the packaged one if omitted"""


@dataclass(frozen=True, kw_only=True)
class EvaluationWork:
    """Where `evaluate completion` computes, and where it keeps results of clips."""

    keep: Path | None = None
    """folder that keeps the results of every clip; clips that are in it are not scored again"""
    jobs: Processes | None = None
    """processes; all processors if omitted. Steps are timed afterwards, alone"""
    scheduler: str | None = None
    """address of a Dask scheduler to run on instead of this machine, like tcp://host:8786"""


@dataclass(frozen=True, kw_only=True)
class EvaluationFiles:
    """Files that `evaluate completion` writes."""

    json: Json = None
    csv: Path | None = None
    """file for the table of all measures"""
    worst: Count = 12
    """number of frames on the sheet, at most one of a clip"""
    worst_by: Fault = "error"
    """frames on the sheet: those with the largest mean error, or the largest leap of a joint within a frame"""
    sheet: Path | None = None
    """file for a sheet of the worst frames, truth next to result (PNG)"""

    def __post_init__(self) -> None:
        if self.sheet is not None:
            check_ending(self.sheet, ".png", what="a picture")
