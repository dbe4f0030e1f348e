"""`bodysense train`: fit a network and export it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.extras import SubcommandApp

from bodysense.cli import arms, completion_fingers, hmd_vae, train_completion, train_gloves, train_more
from bodysense.errors import BodysenseError

Output = Annotated[Path, tyro.conf.arg(aliases=("-o",))]


def commands() -> SubcommandApp:
    """The group's commands."""
    group = SubcommandApp()
    group.command(train_completion.completion)
    group.command(completion_fingers.completion_fingers)
    group.command(body_gru)
    group.command(unoc_tables)
    group.command(train_more.fingers)
    group.command(train_more.upper_body)
    group.command(hmd_vae.hmd_vae)
    group.command(train_gloves.gloves)
    group.command(arms.arms)
    group.command(arms.arms_table)
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
    finger_passes: int = 6,
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
        passes: How often the data is varied (mirrored, other limb lengths, lost hands, frame rates) and seen anew.
        finger_passes: How often more the clips with fingers are, for they are few.
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
    from bodysense.lab.unoc.run import BodyRun, run_body

    if out.suffix != ".onnx":
        raise BodysenseError(f"{out}: the network is written as .onnx; give a name that ends so")
    run_body(
        BodyRun(
            data=data,
            out=out,
            form=form,
            steps=steps,
            epochs=epochs,
            window_stride=window_stride,
            passes=passes,
            finger_passes=finger_passes,
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


def unoc_tables(
    data: Path,
    out: Output,
    tables: tuple[str, ...] = ("2", "3", "4", "smoothness"),
    networks: tuple[str, ...] = (),
    epochs: int = 5,
    window_stride: int = 1,
    batch_scale: float = 1.0,
    seed: int = 1,
    jobs: int = 1,
    threads: int | None = None,
    devices: int = 1,
    nodes: int = 1,
) -> None:
    """Train all networks of UNOC's Tables 2 to 4 into one folder; `bodysense evaluate unoc-table2` … read it.

    Run it again to go on after a stop. For several machines start it on each with `torchrun` and
    give --nodes; they must share the folder --out.

    Args:
        data: A folder of motion files or a prepared store; its train split is learned.
        out: The folder.
        tables: Which tables' networks: 2, 3, 4, smoothness.
        networks: Single networks instead, by name.
        epochs: Epochs; the paper's schedule has 5.
        window_stride: Learn from every n-th window; 1 is the paper's.
        batch_scale: Factor on the paper's batch sizes; with fewer windows, smaller batches keep the number of steps.
        seed: Of everything random.
        jobs: Networks trained side by side, each in a process of its own.
        threads: Of PyTorch in each; its own choice by default.
        devices: Accelerators, where there are any.
        nodes: Machines that share each network's training.
    """
    from bodysense.lab.unoc.sweep import TablesRun, run_tables

    if jobs < 1:
        raise BodysenseError(f"--jobs {jobs}: give at least 1")
    if not batch_scale > 0:
        raise BodysenseError(f"--batch-scale {batch_scale:g}: give a positive number; 1 is the paper's")
    run_tables(
        TablesRun(data, out, tables, networks, epochs, window_stride, batch_scale, seed, jobs, threads, devices, nodes)
    )


def card(network: Annotated[Path, tyro.conf.Positional], figures: Path) -> None:
    """Put test figures into a network file and write its model card beside it.

    Args:
        network: The .onnx file that `bodysense train` wrote.
        figures: what the command that measures such a network wrote with --json: `bodysense evaluate completion`,
            `headset`, `finger-synthesis` or `unoc-table6`, with --model NETWORK where it takes one.
    """
    import json

    from bodysense.lab.model_card import describe

    if not network.is_file():
        raise BodysenseError(f"{network}: no such model file; give the .onnx that `bodysense train` wrote")
    try:
        numbers = json.loads(figures.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BodysenseError(f"{figures}: no figures to read ({error}); write them with --json") from None
    print(f"wrote {describe(network, numbers)}")
