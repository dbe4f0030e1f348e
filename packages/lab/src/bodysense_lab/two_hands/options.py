"""Options of the training and the tables of gloves; read by the command line, so without PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Literal

from tyro.conf import Suppress

from bodysense.errors import BodysenseError
from bodysense_lab.options import Card, Flat, Paced, Run, TableOptions, check_fields

Network = Literal["markers", "joints"]
Form = Literal["shipped", "paper"]


@dataclass(frozen=True, kw_only=True)
class GloveTraining(Run, Card, Paced):
    """Train the networks of a glove (two-hands, 3.2) into a folder: glove_markers.onnx, glove_joints.onnx and so on."""

    data: Path | None = None
    """folder of motion files or a prepared store; of its train split the clips with fingers are learned, left hands
    and right ones, and the weights that do best on its val split are kept; without it synthesised hands alone"""
    network: Network | Literal["both"] = "both"
    """'markers' fills hidden markers, 'joints' tells angles"""
    form: Form = "shipped"
    """'shipped' is larger and reads the lengths of bones and which markers are hidden; 'paper' has the layers of
    Tables 1 and 2"""
    steps: int | None = None
    """optimiser steps; by default the form's own"""
    hand_minutes: float = 40.0
    """minutes of synthesised hands, in addition to the recorded ones"""
    pair_minutes: float = 10.0
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
        super().__post_init__()
        if self.out.suffix == ".onnx":
            raise BodysenseError(f"{self.out}: several networks are written; give a folder")
        check_fields(self, "steps", "check_every")
        for name in ("hand_minutes", "pair_minutes"):
            if not 0 <= getattr(self, name) < inf:
                option = name.replace("_", "-")
                raise BodysenseError(f"--{option} {getattr(self, name):g}: give 0 or more")


@dataclass(frozen=True, kw_only=True)
class GloveEvaluation:
    """A table of gloves with hidden markers."""

    data: str | None = None
    """folder of motion with fingers or prepared store; NAME=FOLDER names it; synthesised hands alone if omitted"""


@dataclass(frozen=True, kw_only=True)
class RingEvaluation(GloveEvaluation):
    """A table of gloves in a ring of cameras."""

    cameras: int = 12
    """cameras in the ring; two must see a marker"""
    seed: int = 1
    """random seed of the synthesised motion"""


@dataclass(frozen=True, kw_only=True)
class GloveOcclusionEvaluation(RingEvaluation):
    """Two hands, Figs 13 and 14: hidden markers. With --data the recorded hands alone are counted."""

    table: Flat[TableOptions] = TableOptions()


@dataclass(frozen=True, kw_only=True)
class GloveLimitsEvaluation(RingEvaluation):
    """Two hands, section 7: limits."""

    markers: Path | None = None
    """network for hidden markers, written by `bodysense train gloves`; the packaged one if omitted"""
    joints: Path | None = None
    """network for angles, written by `bodysense train gloves`; the packaged one if omitted"""
    table: Flat[TableOptions] = TableOptions()


@dataclass(frozen=True, kw_only=True)
class MarkerEvaluation(GloveEvaluation):
    """Two hands, Table 3: hidden markers."""

    model: Path | None = None
    """network written by `bodysense train gloves`; the packaged one if omitted"""
    left_out: Path | None = None
    """folder that `bodysense train gloves --leave-one-out` wrote, to score people by networks that never saw them"""
    table: Flat[TableOptions] = TableOptions()


@dataclass(frozen=True, kw_only=True)
class JointEvaluation(GloveEvaluation):
    """Two hands, Table 4: joints of fingers."""

    markers: Path | None = None
    """network for hidden markers, written by `bodysense train gloves`; the packaged one if omitted"""
    joints: Path | None = None
    """network for angles, written by `bodysense train gloves`; the packaged one if omitted"""
    left_out: Path | None = None
    """folder that `bodysense train gloves --leave-one-out` wrote, to score people by networks that never saw them"""
    table: Flat[TableOptions] = TableOptions()


@dataclass(frozen=True, kw_only=True)
class LayoutEvaluation:
    """Gloves of other marker sets than ours."""

    hands: int | None = None
    """how many hands are drawn; 20 if omitted, 1 with --quick"""
    table: Flat[TableOptions] = TableOptions()

    def __post_init__(self) -> None:
        check_fields(self, "hands")
