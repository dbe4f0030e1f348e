"""Options of the tracker's training and tables. The command line imports them, so they do not import PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.ranges import Count, Hours, Processes, within
from bodysense_lab.options import (
    Card,
    Flat,
    MotionEvaluation,
    MotionRun,
    Schedule,
    Split,
    TableOptions,
    Usual,
    check_ending,
)

Body = Literal["own", "stranger", "height", "nothing"]
BODIES: tuple[Body, ...] = ("own", "stranger", "height", "nothing")
Fault = Literal["error", "leap"]  # by which a clip's worst frame is found

FINGER_SCHEDULE = Schedule(steps=Usual(2000), learning_rate=2e-3, weight_decay=0.1, check_every=500)

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

    schedule: Flat[Schedule] = Schedule(steps=Usual(6200))
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
    schedule: Flat[Schedule] = Schedule(steps=Usual(4000), check_every=500)
    frames: Count = Usual(500_000)
    """frames of takes to learn from, each completed in both directions first"""

    @property
    def checkpoint(self) -> Path:
        """Where training resumes from."""
        return self.folder / "joining.ckpt"

    def __post_init__(self) -> None:
        check_ending(self.out, ".safetensors")


@dataclass(frozen=True, kw_only=True)
class CompletionEvaluation(MotionEvaluation):
    """The tracker on any sensors and any proportions."""

    split: Split = "test"
    """people, and unseen bodies, to score"""
    sets: tuple[str, ...] = TABLE_SETS
    """sensor sets"""
    bodies: tuple[Body, ...] = BODIES
    """proportions: the recording's, or an unseen body's of which all, the height or nothing is known"""
    limit: Count | None = None
    """number of clips, spread evenly, for a sample with its intervals; all if omitted"""
    model: Path | None = None
    """completion network of your own; the packaged one if omitted"""
    backward_model: Path | None = None
    """completion network of your own for time that runs backward, in takes; MODEL if omitted"""
    joining_model: Path | None = None
    """joining network of your own, in takes; the packaged one if omitted"""
    lattice: bool = False
    """score 200 random edges of the lattice of sensor sets as well, which takes as long as half of all clips"""
    takes: bool = False
    """score takes as well, completed with past and future, which takes three times as long"""
    keep: Path | None = None
    """folder that keeps the results of every clip; clips that are in it are not scored again"""
    jobs: Processes | None = None
    """processes; all processors if omitted. Steps are timed afterwards, alone"""
    scheduler: str | None = None
    """address of a Dask scheduler to run on instead of this machine, like tcp://host:8786"""
    json: Path | None = None
    """file for the numbers, as one flat object"""
    csv: Path | None = None
    """file for the table of all measures"""
    picture: Path | None = None
    """file for the reliability diagram (PNG)"""
    worst: Count = 12
    """number of frames on the sheet, at most one of a clip"""
    worst_by: Fault = "error"
    """frames on the sheet: those with the largest mean error, or the largest leap of a joint within a frame"""
    sheet: Path | None = None
    """file for a sheet of the worst frames, truth next to result (PNG)"""

    @property
    def outputs(self) -> tuple[Path, ...]:
        """The files to write."""
        return tuple(path for path in (self.json, self.csv, self.picture, self.sheet) if path is not None)

    def __post_init__(self) -> None:
        for name in self.sets:
            if name not in SENSOR_SETS:
                raise BodysenseError(f"--sets {name}: unknown; valid are {', '.join(SENSOR_SETS)}")
        if self.backward_model is not None and not self.takes:
            raise BodysenseError("--backward-model: only takes are tracked backward in time; give --takes as well")
        if self.joining_model is not None and not self.takes:
            raise BodysenseError("--joining-model: only takes have two answers to join; give --takes as well")
        for picture in (self.picture, self.sheet):
            if picture is not None:
                check_ending(picture, ".png", what="a picture")
        if not self.bodies:
            raise BodysenseError(f"--bodies: give at least one of {', '.join(BODIES)}")


@dataclass(frozen=True, kw_only=True)
class AmassEvaluation:
    """AvatarPoser's protocol 1 on AMASS."""

    amass: Path
    """folder of AMASS, with CMU, BMLrub (BioMotionLab_NTroje) and HDM05 (MPI_HDM05)"""
    split_lists: Path
    """folder data_split of a clone of github.com/eth-siplab/AvatarPoser"""
    smpl_model: Path | None = None
    """SMPL-H model whose mean body everybody has, as published: male/model.npz; the default body if omitted"""
    model: Path | None = None
    """completion network of your own; the packaged one, which did not learn from these lists, if omitted"""
    limit: Count | None = None
    """number of clips, spread evenly; all if omitted"""
    jobs: Processes = 1
    """processes"""
    json: Path | None = None
    """file for the numbers, as one flat object"""


@dataclass(frozen=True, kw_only=True)
class SightEvaluation:
    """Scripted wearers, and real headset signals."""

    headset: Path | None = None
    """folder of recorded headsets (headset_takes.npz); these rows are left out if omitted"""
    model: Path | None = None
    """completion network of your own; the packaged one if omitted"""
    json: Path | None = None
    """file for the numbers, as one flat object"""


@dataclass(frozen=True, kw_only=True)
class UntrackedFingerEvaluation:
    """Fingers that are not tracked."""

    data: Path
    """folder of motion with splits; its train split makes the mean hand of the baseline"""
    networks: tuple[Path, ...]
    """checkpoints of `bodysense train completion-fingers --leave-out NAME`"""
    split: Literal["train", "val", "test"] = "test"
    """which clips of these people"""
    json: Path | None = None
    """file for the numbers, as one flat object"""


@dataclass(frozen=True, kw_only=True)
class HoleEvaluation(MotionEvaluation):
    """Filled holes compared with interpolation."""

    clips: Count | None = None
    """number of clips, spread evenly; all if omitted"""
    parts: tuple[Literal["arm", "leg", "legs", "upper_body", "fingers"], ...] = ()
    """parts of the body to remove; all if omitted"""
    table: Flat[TableOptions] = TableOptions()
