"""`bodysense evaluate`: the tables."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tyro.extras import SubcommandApp

from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.lab.commands import arms, completion_tables, glove_limits, gloves, hmd_vae, rendering, unoc
from bodysense.lab.commands.reporting import tracker_settings


def commands() -> SubcommandApp:
    """The group's commands."""
    group = SubcommandApp()
    for command in (completion_tables.completion, completion_tables.fingers, headset, completion_tables.holes):
        group.command(command)
    group.command(unoc.finger_synthesis)
    group.command(name="hmd-vae")(hmd_vae.hmd_vae_figures)
    for command in (arms.pahmt_table1, rendering.video_rendered, unoc.unoc_table1, unoc.unoc_table2, unoc.unoc_table3):
        group.command(command)
    for command in (unoc.unoc_table4, unoc.unoc_table5, unoc.unoc_table6, unoc.unoc_smoothness, unoc.reliability):
        group.command(command)
    for command in (unoc.transitions, gloves.gloves_occlusion, glove_limits.gloves_limits, gloves.gloves_table3):
        group.command(command)
    group.command(gloves.gloves_table4)
    group.command(gloves.gloves_layouts)
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
