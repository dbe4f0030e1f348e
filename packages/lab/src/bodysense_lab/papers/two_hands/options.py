"""Options of the training of gloves; read by the command line, so without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Suppress

from bodysense.errors import BodysenseError
from bodysense.ranges import Count, within
from bodysense_lab.core.options import Card, Run, ScheduleOptions

Network = Literal["markers", "joints"]
Form = Literal["shipped", "paper"]
Minutes = Annotated[float, within(float, 0, 60_000)]


@dataclass(frozen=True, kw_only=True)
class GloveTraining(Run, Card, ScheduleOptions):
    """Train the networks of a glove (two-hands, 3.2) into a folder: glove_markers.onnx, glove_joints.onnx and so on."""

    data: Path | None = None
    """folder of motion files or a prepared store; of its train split the clips with fingers are learned, left hands
    and right ones, and the weights that do best on its val split are kept; without it synthesised hands alone"""
    network: Network | Literal["both"] = "both"
    """'markers' fills hidden markers, 'joints' tells angles"""
    form: Form = "shipped"
    """'shipped' is larger and reads the lengths of bones and which markers are hidden; 'paper' has the layers of
    Tables 1 and 2"""
    steps: Count | None = None
    """optimiser steps; by default the form's own"""
    hand_minutes: Minutes = 40.0
    """minutes of synthesised hands, in addition to the recorded ones"""
    pair_minutes: Minutes = 10.0
    """minutes of synthesised pairs of hands that touch; --limit takes as many half minutes of each at most"""
    leave_one_out: bool = False
    """train as often as there are people in the data, each time without one of them, in a folder `without-PERSON` each,
    for `bodysense evaluate gloves-table3 --left-out`"""
    without: Suppress[tuple[str, ...]] = ()  # people of the data that are left out

    @property
    def networks(self) -> tuple[Network, ...]:
        """Which are trained."""
        return ("markers", "joints") if self.network == "both" else (self.network,)

    def __post_init__(self) -> None:
        if self.out.suffix == ".onnx":
            raise BodysenseError(f"{self.out}: several networks are written; give a folder")
