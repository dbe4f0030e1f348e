"""`bodysense train`: training and export of networks."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.extras import SubcommandApp

from bodysense.errors import BodysenseError
from bodysense_lab.commands import arms, completion, gloves, hmd_vae
from bodysense_lab.core.options import Flat, as_trial
from bodysense_lab.papers.unoc.options import BodyTraining, FingersTraining, TablesTraining, UpperBodyTraining


def commands() -> SubcommandApp:
    """Return the group's commands."""
    group = SubcommandApp()
    for command in (completion.completion, completion.completion_fingers, completion.completion_joining):
        group.command(checked(command))
    for command in (body_gru, unoc_tables, fingers, upper_body):
        group.command(checked(command))
    for command in (hmd_vae.hmd_vae, gloves.gloves, arms.arms, arms.arms_table):
        group.command(checked(command))
    group.command(card)
    return group


def checked(train: Callable[[Any], None]) -> Callable[[Any], None]:
    """Wrap a training: check its data before PyTorch is loaded, and take few steps in a trial."""

    @wraps(train)
    def begin(run: Any) -> None:
        if run.data is not None and not run.data.is_dir():
            raise BodysenseError(f"--data {run.data}: no such folder; give a folder of motion, or a prepared store")
        train(as_trial(run))

    return begin


def body_gru(run: Flat[BodyTraining]) -> None:
    """Train the body network (UNOC) and write it as one .onnx file; training resumes after a stop."""
    from bodysense_lab.data.clips import clips_of
    from bodysense_lab.papers.unoc.train import train_body

    train_body(run, clips_of(run))


def unoc_tables(run: Flat[TablesTraining]) -> None:
    """Train the networks of UNOC's Tables 2 to 4 into one folder, for `evaluate unoc-table2` to `unoc-table4`.

    Training resumes after a stop. On several machines, start it on each with `torchrun` and give --nodes.
    """
    from bodysense_lab.papers.unoc.train_tables import train_tables

    train_tables(run)


def fingers(run: Flat[FingersTraining]) -> None:
    """Train finger synthesis (UNOC, section 5.3) and write it as one .onnx file; training resumes after a stop."""
    from bodysense_lab.data.clips import clips_of
    from bodysense_lab.papers.unoc.train import train_points

    train_points(run, clips_of(run))


def upper_body(run: Flat[UpperBodyTraining]) -> None:
    """Train the upper body of a headset and two controllers (UNOC, section 5.2) and write it as one .onnx file.

    Training resumes after a stop.
    """
    from bodysense_lab.data.clips import clips_of
    from bodysense_lab.papers.unoc.train import train_points

    train_points(run, clips_of(run))


def card(network: Annotated[Path, tyro.conf.Positional], figures: Path) -> None:
    """Write test figures into a network file and a model card next to it.

    Args:
        network: .onnx file that `bodysense train` wrote.
        figures: figures of this network, written with --json by `bodysense evaluate completion`, `finger-synthesis`,
            `unoc-table2`, `unoc-table6` or `hmd-vae`.
    """
    from bodysense.files import read_json
    from bodysense_lab.core.model_card import describe

    if not network.is_file():
        raise BodysenseError(f"{network}: no such model file; give the .onnx that `bodysense train` wrote")
    print(f"wrote {describe(network, read_json(figures, 'write figures with --json'))}")
