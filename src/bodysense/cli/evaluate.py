"""`bodysense evaluate`: the tables."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tyro.extras import SubcommandApp

from bodysense.cli import (
    arms,
    completion_fingers,
    evaluate_completion,
    evaluate_holes,
    evaluate_more,
    gloves,
    render,
    unoc,
)
from bodysense.cli.options import tracker_settings
from bodysense.errors import BodysenseError
from bodysense.files import check_place


def commands() -> SubcommandApp:
    """The group's commands."""
    group = SubcommandApp()
    group.command(evaluate_completion.completion)
    group.command(completion_fingers.fingers)
    group.command(headset)
    group.command(evaluate_holes.holes)
    group.command(evaluate_more.finger_synthesis)
    group.command(evaluate_more.hmd_vae)
    group.command(arms.pahmt_table1)
    group.command(render.video_rendered)
    unoc.add_commands(group)
    gloves.add_commands(group)
    return group


def headset(
    data: Path,
    split: Literal["train", "val", "test", "all"] = "test",
    model: Path | None = None,
    half_life: float | None = None,
    jobs: int | None = None,
    json: Path | None = None,
) -> None:
    """Score the tracker on what a headset's cameras do not see (UNOC, Table 2), beside the last-known baselines.

    Args:
        data: A folder of motion files, or a prepared store.
        split: Which people.
        model: A network written by `bodysense train`; the packaged one by default.
        half_life: Of the tracker's smoother, seconds; the tracker's own by default.
        jobs: Processes; all processors by default.
        json: Write the numbers here, as one flat object.
    """
    import os

    from rich.console import Console
    from rich.progress import Progress

    from bodysense.cli.show import headset_table, write_numbers
    from bodysense.lab.clips import open_clips
    from bodysense.lab.unoc.headset import evaluate_headset

    if json is not None:
        check_place(json)
    if jobs is not None and jobs < 1:
        raise BodysenseError(f"--jobs {jobs}: give at least 1")
    with Progress() as progress:
        bar = progress.add_task("tracking", total=None)
        table = evaluate_headset(
            open_clips(data, split),
            model,
            tracker_settings(half_life),
            jobs or os.cpu_count() or 1,
            lambda clip: progress.update(bar, advance=1, description=f"tracked {clip.name}"),
        )
    title = f"{data.name}, {split}: {table.clips} clips, {table.seconds / 60:.0f} minutes"
    Console().print(headset_table(table, title))
    write_numbers(json, table.numbers())
