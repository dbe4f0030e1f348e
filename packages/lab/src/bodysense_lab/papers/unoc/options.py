"""Options of UNOC's trainings; read by the command line, so without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from bodysense.errors import BodysenseError
from bodysense.ranges import Count, Processes, within
from bodysense_lab.core.options import MethodDefault, Training, check_ending

EPOCHS = 5  # of the paper's schedule
Epochs = Annotated[int, within(int, 1, EPOCHS)]


@dataclass(frozen=True, kw_only=True)
class BodyTraining(Training):
    """Options of `bodysense train body-gru`."""

    form: Literal["shipped", "paper", "paper-world-axes"] = "shipped"
    """'shipped' carries its state and reads the headset's orientation and the mask; 'paper' sees windows of 27 frames
    of positions only, 'paper-world-axes' also in the paper's frame"""
    steps: Count | None = None
    """optimiser steps; if omitted 20,000 of the shipped form, all epochs of the paper's"""
    epochs: Epochs = EPOCHS
    """epochs of the paper's form"""
    window_stride: Count = 1
    """the paper's form learns from every n-th window; 1 is the paper's"""
    passes: Count = 2
    """how many augmented copies of each clip are learned: mirrored, other limb lengths, lost hands, frame rates"""
    finger_passes: int = 6
    """how many more of the clips with fingers, which are few"""
    lanes: Count = 256
    """clips that the shipped form plays side by side; many make its gradient steady"""
    chunk: Count = 12
    """frames of truncated backpropagation; the state carries on beyond them"""
    hidden: Count = 512
    """size of the recurrent state"""
    finger_share: float = 0.3
    """share of drawn clips that have recorded fingers"""

    def __post_init__(self) -> None:
        check_ending(self.out, ".onnx")


@dataclass(frozen=True, kw_only=True)
class TablesTraining(Training):
    """Options of `bodysense train unoc-tables`."""

    tables: tuple[str, ...] = ("2", "3", "4", "smoothness")
    """whose networks: 2, 3, 4, smoothness"""
    networks: tuple[str, ...] = ()
    """single networks instead, by name"""
    steps: Count | None = None
    """optimiser steps of each network at most; all epochs if omitted"""
    epochs: Epochs = EPOCHS
    """the paper's schedule has 5"""
    window_stride: Count = 1
    """learn from every n-th window; 1 is the paper's"""
    loss_sum: bool = False
    """losses of bones and of occlusion as sums over joints, as the paper prints them; means if omitted"""
    batch_scale: float = 1.0
    """factor on the paper's batch sizes; with fewer windows, smaller batches keep the number of steps"""
    jobs: Processes = 1
    """networks trained side by side, each in a process of its own"""

    def __post_init__(self) -> None:
        if not self.batch_scale > 0:
            raise BodysenseError(f"--batch-scale {self.batch_scale:g}: give a positive number; 1 is the paper's")
        if self.jobs > 1 and (self.devices > 1 or self.nodes > 1):
            raise BodysenseError(
                f"--jobs {self.jobs} trains networks side by side; with --devices or --nodes leave it at 1"
            )


@dataclass(frozen=True, kw_only=True)
class PointTraining(Training):
    """Options of networks that place some points from others."""

    form: Literal["shipped", "paper"] = "shipped"
    """'shipped' carries its state and knows more of the wearer; 'paper' sees windows of 27 frames"""
    steps: Count
    """optimiser steps"""

    task: ClassVar[Literal["fingers", "upper-body"]]

    def __post_init__(self) -> None:
        check_ending(self.out, ".onnx")


@dataclass(frozen=True, kw_only=True)
class FingersTraining(PointTraining):
    """Options of `bodysense train fingers`; clips with fingers are learned and watched."""

    steps: Count = MethodDefault(500)
    """optimiser steps"""
    task = "fingers"


@dataclass(frozen=True, kw_only=True)
class UpperBodyTraining(PointTraining):
    """Options of `bodysense train upper-body`."""

    steps: Count = MethodDefault(8000)
    """optimiser steps"""
    task = "upper-body"
