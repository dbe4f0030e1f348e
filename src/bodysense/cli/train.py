"""`bodysense train`: fit a network and export it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.extras import SubcommandApp

from bodysense.errors import BodysenseError

Output = Annotated[Path, tyro.conf.arg(aliases=("-o",))]
FORMS = ("shipped", "paper", "paper-world-axes")


def commands() -> SubcommandApp:
    """The group's commands."""
    group = SubcommandApp()
    group.command(body_gru)
    group.command(card)
    return group


def body_gru(
    data: Path,
    out: Output,
    form: Literal["shipped", "paper", "paper-world-axes"] = "shipped",
    steps: int = 20_000,
    epochs: int = 5,
    window_stride: int = 1,
    passes: int = 2,
    lanes: int = 256,
    chunk: int = 12,
    hidden: int = 512,
    finger_share: float = 0.3,
    seed: int = 1,
    threads: int | None = None,
    devices: int = 1,
    licence: str = "Apache-2.0",
    data_note: str = "",
) -> None:
    """Train the body network (UNOC) and write it as one .onnx file. Run it again to go on after a stop.

    Args:
        data: A folder of motion files or a prepared store; its train split is learned, its val split watched.
        out: The .onnx file; the checkpoint and the log lie beside it.
        form: 'shipped' carries its state and reads the headset's orientation and the mask; 'paper' sees windows of 27
            frames of positions only, 'paper-world-axes' also in the paper's frame.
        steps: Optimiser steps of the shipped form.
        epochs: Epochs of the paper's form.
        window_stride: The paper's form learns from every n-th window; 1 is the paper's.
        passes: How often the data is varied (mirrored, other limb lengths, lost hands) and seen anew.
        lanes: Clips that the shipped form plays side by side; many make its gradient steady.
        chunk: Frames of each through which it is differentiated; the state carries on beyond them.
        hidden: Size of the recurrent state.
        finger_share: How often a drawn clip has recorded fingers.
        seed: Of everything random.
        threads: Of PyTorch; its own choice by default.
        devices: Accelerators, where there are any.
        licence: Of the network, for its card.
        data_note: What it was trained on, for its card.
    """
    from bodysense.training.run import BodyGruRun, run_body_gru

    if out.suffix != ".onnx":
        raise BodysenseError(f"{out}: the network is written as .onnx; give a name that ends so")
    run_body_gru(
        BodyGruRun(
            data=data,
            out=out,
            form=form,
            steps=steps,
            epochs=epochs,
            window_stride=window_stride,
            passes=passes,
            lanes=lanes,
            chunk=chunk,
            hidden=hidden,
            finger_share=finger_share,
            seed=seed,
            threads=threads,
            devices=devices,
            licence=licence,
            data_note=data_note,
        )
    )


def card(network: Annotated[Path, tyro.conf.Positional], figures: Path) -> None:
    """Put test figures into a network file and write its model card beside it.

    Args:
        network: The .onnx file that `bodysense train` wrote.
        figures: What `bodysense evaluate headset --model NETWORK --json FIGURES` wrote.
    """
    import json

    from bodysense.estimators.learned import load_model
    from bodysense.training.onnx_writing import describe

    load_model(network)
    try:
        numbers = json.loads(figures.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BodysenseError(f"{figures}: no figures to read ({error}); write them with --json") from None
    print(f"wrote {describe(network, numbers)}")
