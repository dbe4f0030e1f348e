"""`bodysense evaluate finger-synthesis`: fingers from the motion of the body alone."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

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
    from bodysense.estimators.point_model import load_point_model
    from bodysense.evaluation.datasets import named_data
    from bodysense.evaluation.finger_synthesis import evaluate_finger_synthesis, examples_of

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
