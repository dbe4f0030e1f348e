"""`bodysense evaluate finger-synthesis`, `hmd-vae`: fingers from a body, a body from three points."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

from bodysense.cli.reporting import Common, Flat, checked, finish
from bodysense.errors import BodysenseError
from bodysense.files import check_place


def finger_synthesis(
    data: str,
    split: Literal["train", "val", "test", "all"] = "test",
    model: Path | None = None,
    json: Path | None = None,
) -> None:
    """Score finger synthesis (UNOC, Table 5, right) beside the mean hand and the hand of the nearest body.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it. Its clips with fingers are scored, and
            both baselines know those of its train split.
        split: Which people or actions.
        model: A network written by `bodysense train fingers`; the packaged one by default.
        json: Write the numbers here, as one flat object.
    """
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

    from bodysense.cli.show import write_numbers
    from bodysense.lab.datasets import named_data
    from bodysense.lab.unoc.finger_scores import evaluate_finger_synthesis, examples_of
    from bodysense.lab.unoc.point_model import load_point_model

    if json is not None:
        check_place(json)
    scored, known, network = named_data(data, split), named_data(data, "train"), load_point_model("fingers", model)
    with Progress() as progress:
        bar = progress.add_task("reading the train split", total=None)
        examples = examples_of(known.clips())
        table = evaluate_finger_synthesis(
            scored.clips(),
            examples,
            network,
            lambda clip: progress.update(bar, advance=1, description=f"scored {clip.name}"),
        )
    shown = Table(title=f"{scored.name}, {split}: {table.clips} clips with fingers, {table.seconds / 60:.1f} minutes")
    shown.caption = "Finger joints and fingertips from their wrist, cm."
    shown.add_column("method")
    for heading in ("RMSJPE", "MPJPE"):
        shown.add_column(heading, justify="right")
    for method, tally in table.tallies.items():
        shown.add_row(method.replace("_", " "), f"{tally.rmsjpe:.2f}", f"{tally.mpjpe:.2f}")
    Console().print(shown)
    write_numbers(json, table.numbers())


def hmd_vae(
    data: str,
    networks: Path,
    split_file: Path | None = None,
    threads: int | None = None,
    common: Flat = Common(),
) -> None:
    """HMD-VAE, Figs 5 to 7: models 1 to 4 with and without history, from scratch and pretrained, 3 and 6 blocks.

    A second table has the measures of later papers, with published figures.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table.
        networks: The folder into which `bodysense train hmd-vae` wrote the networks.
        split_file: list they were trained with: its motions 'PATH test' are scored instead of a split by person.
        threads: PyTorch threads; its own choice if omitted.
        common: Common options.
    """
    from rich.progress import Progress, track

    from bodysense.lab.datasets import named_data
    from bodysense.lab.hmd_vae.frames import read_split_file
    from bodysense.lab.hmd_vae.scores import read_test, score_vae, vaes_in
    from bodysense.lab.hmd_vae.tables import metrics_report, vae_report

    if split_file is not None and (common.split != "test" or common.quick):
        raise BodysenseError("--split-file scores its own test motions; leave --split and --quick out")
    checked(common)
    chosen, files = named_data(data, common.split, common.quick), vaes_in(networks)
    total = None if split_file is None else list(read_split_file(split_file).values()).count("test")
    with Progress() as progress:
        bar = progress.add_task("reading", total=chosen.count() if total is None else total)
        frames, census = read_test(
            chosen, lambda clip: progress.update(bar, advance=1, description=f"read {clip.name}"), split_file
        )
    scored = [score_vae(name, path, frames, threads) for name, path in track(files.items(), "scoring the networks")]
    figures, later = vae_report(scored, census, chosen), metrics_report(scored, census, chosen)
    if split_file is not None:
        listed = f"Of it, the test motions of {split_file}."
        figures, later = (replace(one, data=(*one.data, listed)) for one in (figures, later))
    finish(later, replace(common, json=None))
    finish(replace(figures, numbers=later.numbers | figures.numbers), common)
