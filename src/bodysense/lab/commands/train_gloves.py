"""`bodysense train gloves`: the networks of a glove with hidden markers (two-hands)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from bodysense.errors import BodysenseError


def gloves(
    out: Annotated[Path, tyro.conf.arg(aliases=("-o",))],
    data: Path | None = None,
    network: Literal["both", "markers", "joints", "two-hands", "recurrent"] = "both",
    form: Literal["shipped", "paper"] = "shipped",
    steps: int | None = None,
    hand_minutes: float = 40.0,
    pair_minutes: float = 10.0,
    seed: int = 1,
    threads: int | None = None,
    licence: str = "Apache-2.0",
    data_note: str = "",
    leave_one_out: bool = False,
) -> None:
    """Train the networks of a glove (two-hands, 3.2) and write each as an .onnx. Training resumes after a stop.

    Args:
        out: A folder: glove_markers.onnx, glove_joints.onnx and so on, each with its checkpoint and log beside it.
        data: A folder of motion files or a prepared store; of its train split the clips with fingers are learned, left
            hands and right ones, and the weights that do best on its val split are kept. Without it synthesised hands
            alone are learned.
        network: 'both' is the two that run: 'markers' fills hidden markers, 'joints' tells angles. 'two-hands' fills
            those of one hand from both, 'recurrent' remembers.
        form: 'shipped' is larger and reads the lengths of bones and which markers are hidden; 'paper' is as Tables 1
            and 2 have it.
        steps: Optimiser steps; by default the form's own.
        hand_minutes: minutes of synthesised hands beside the recorded ones.
        pair_minutes: minutes of synthesised pairs of hands that touch.
        seed: random seed.
        threads: PyTorch threads; its own choice if omitted.
        licence: licence of the networks, for their cards.
        data_note: What they were trained on, for their cards.
        leave_one_out: Train as often as there are people in the data, each time without one of them, in a folder
            `without-PERSON` each, for `bodysense evaluate gloves-table3 --left-out`.
    """
    from bodysense.lab.two_hands.train import GloveRun, people_with_fingers, run_gloves

    if out.suffix == ".onnx":
        raise BodysenseError(f"{out}: several networks are written; give a folder")
    networks = ("markers", "joints") if network == "both" else (network,)
    run = GloveRun(networks, data, out, form, steps, hand_minutes, pair_minutes, seed, threads, licence, data_note)
    if not leave_one_out:
        run_gloves(run)
        return
    for person in people_with_fingers(data):
        run_gloves(replace(run, out=out / f"without-{person}", without=(person,)))
