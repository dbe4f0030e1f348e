"""`bodysense train fingers`, `train upper-body`: the networks that place some points from others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from bodysense.errors import BodysenseError

Output = Annotated[Path, tyro.conf.arg(aliases=("-o",))]


def fingers(
    data: Path,
    out: Output,
    form: Literal["shipped", "paper"] = "shipped",
    steps: int = 500,
    seed: int = 1,
    threads: int | None = None,
    licence: str = "Apache-2.0",
    data_note: str = "",
) -> None:
    """Train finger synthesis (UNOC, section 5.3) and write it as one .onnx file. Run it again to go on after a stop.

    Args:
        data: A folder of motion files or a prepared store; of its train split the clips with fingers are learned, the
            weights that do best on those of its val split are kept.
        out: The .onnx file; the checkpoint and the log lie beside it.
        form: 'shipped' carries its state, is small and reads the body as the wrists see it too; 'paper' sees windows
            of 27 frames.
        steps: Optimiser steps.
        seed: Of everything random.
        threads: Of PyTorch and processes that prepare the data; their own choice by default.
        licence: Of the network, for its card.
        data_note: What it was trained on, for its card.
    """
    from bodysense.lab.unoc.point_run import PointRun, run_points

    run_points(PointRun("fingers", data, _onnx(out), form, _positive(steps), seed, threads, licence, data_note))


def upper_body(
    data: Path,
    out: Output,
    form: Literal["shipped", "paper"] = "shipped",
    steps: int = 8000,
    seed: int = 1,
    threads: int | None = None,
    licence: str = "Apache-2.0",
    data_note: str = "",
) -> None:
    """Train the upper body of a headset and two controllers (UNOC, section 5.2) and write it as one .onnx file.

    Run it again to go on after a stop.

    Args:
        data: A folder of motion files or a prepared store; its train split is learned, the weights that do best on its
            val split are kept.
        out: The .onnx file; the checkpoint and the log lie beside it.
        form: 'shipped' carries its state and knows the head's height and the wearer's bones; 'paper' sees windows of
            27 frames.
        steps: Optimiser steps.
        seed: Of everything random.
        threads: Of PyTorch and processes that prepare the data; their own choice by default.
        licence: Of the network, for its card.
        data_note: What it was trained on, for its card.
    """
    from bodysense.lab.unoc.point_run import PointRun, run_points

    run_points(PointRun("upper-body", data, _onnx(out), form, _positive(steps), seed, threads, licence, data_note))


def _onnx(out: Path) -> Path:
    if out.suffix != ".onnx":
        raise BodysenseError(f"{out}: the network is written as .onnx; give a name that ends so")
    return out


def _positive(steps: int) -> int:
    if steps < 1:
        raise BodysenseError(f"--steps {steps}: give at least 1")
    return steps
