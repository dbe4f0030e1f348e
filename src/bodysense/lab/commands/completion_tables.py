"""`bodysense evaluate completion`, `fingers`, `holes`: the tables of the tracker."""

from __future__ import annotations

from functools import partial
from itertools import islice
from pathlib import Path
from typing import Literal

from bodysense.errors import BodysenseError
from bodysense.files import check_place
from bodysense.lab.commands.reporting import Common, checked, finish, progress_over
from bodysense.lab.options import Flat


def completion(
    data: str,
    split: Literal["train", "val", "test", "all"] = "test",
    sets: tuple[str, ...] = (),
    bodies: tuple[Literal["own", "stranger", "height", "nothing"], ...] = ("own", "stranger", "height", "nothing"),
    limit: int | None = None,
    model: Path | None = None,
    lattice: bool = True,
    jobs: int = 1,
    scheduler: str | None = None,
    json: Path | None = None,
    csv: Path | None = None,
    picture: Path | None = None,
) -> None:
    """Score the tracker on any sensors and any proportions: errors, motion, feet, confidence, the lattice of sensors.

    Args:
        data: A folder of motion files or a prepared store; NAME=FOLDER names it in the table.
        split: people, and strangers' bodies, to score.
        sets: Sensor sets; those of the table if omitted.
        bodies: Proportions that move, and what the tracker is told: the recording's, told; a stranger's, told; a
            stranger's, only the height told; a stranger's, nothing told.
        limit: Number of clips, spread evenly; all if omitted.
        model: A completion network of your own; the packaged one if omitted.
        lattice: Also score 200 random edges of the lattice of sensor sets.
        jobs: Processes. Times of a step are truest with one.
        scheduler: Address of a Dask scheduler to run on instead of this machine, like tcp://host:8786.
        json: Write the numbers here, as one flat object.
        csv: Write the table of all measures here.
        picture: Write the reliability diagram here (PNG).
    """
    from rich.progress import Progress

    from bodysense.cli.show import print_report, wide_console, write_numbers
    from bodysense.devices.simulated.sensors import TABLE_SETS
    from bodysense.lab.clips import open_clips
    from bodysense.lab.completion.baselines import cached_mean_body
    from bodysense.lab.completion.reliability_diagram import draw_reliability
    from bodysense.lab.completion.reports import completion_reports
    from bodysense.lab.completion.scoring import evaluate_completion, work_of
    from bodysense.lab.completion.tables import CompletionSettings
    from bodysense.lab.completion.tracking import TrackedBy, step_times
    from bodysense.lab.datasets import Census, census_of, named_data
    from bodysense.lab.spread import spread
    from bodysense.lab.table import write_csv

    for path in (json, csv, picture):
        if path is not None:
            check_place(path)
    _check(sets, bodies, limit, jobs)
    track = TrackedBy(model)
    chosen, census = named_data(data, split), Census()
    settings = CompletionSettings(split, sets or TABLE_SETS, bodies, 200 if lattice else 0)
    count = min(chosen.count(), limit or chosen.count())
    with Progress() as progress:
        bar = progress.add_task("reading", total=count)
        clips = []
        for clip in open_clips(chosen.path, split, at_most=limit):
            census += census_of(clip)
            clips.append(clip)
            progress.advance(bar)
        mean_body = None
        if "headset_camera" in settings.sets:
            bar = progress.add_task("averaging bodies", total=None)
            mean_body = cached_mean_body(chosen.path, lambda clip: progress.advance(bar))
            progress.update(bar, total=1, completed=1)
        bar = progress.add_task("scoring", total=work_of(len(clips), settings))

        def advance(done: int, what: str) -> None:
            progress.update(bar, advance=done, description=f"scored {what}")

        table = evaluate_completion(
            clips,
            settings,
            track=track,
            times=partial(step_times, network=track.network),
            spread=partial(spread, jobs=jobs, scheduler=scheduler),
            mean_body=mean_body,
            advance=advance,
        )
    console = wide_console()
    reports = completion_reports(table, census, chosen)
    for report in reports:
        print_report(report, console)
    if csv is not None:
        write_csv(csv, reports[1])
    if picture is not None:
        draw_reliability(picture, table)
    write_numbers(json, reports[0].numbers)
    for path in (json, csv, picture):
        if path is not None:
            console.print(f"wrote {path}", highlight=False)


def _check(sets: tuple[str, ...], bodies: tuple[str, ...], limit: int | None, jobs: int) -> None:
    from bodysense.devices.simulated.sensors import SENSOR_SETS

    for name in sets:
        if name not in SENSOR_SETS:
            raise BodysenseError(f"--sets {name}: unknown; valid are {', '.join(SENSOR_SETS)}")
    if jobs < 1:
        raise BodysenseError(f"--jobs {jobs}: give at least 1")
    if limit is not None and limit < 1:
        raise BodysenseError(f"--limit {limit}: give at least 1")
    if not bodies:
        raise BodysenseError("--bodies: give at least one of own, stranger, height, nothing")


def fingers(
    data: Path,
    networks: tuple[Path, ...],
    split: Literal["train", "val", "test"] = "test",
    run: Path | None = None,
    json: Path | None = None,
) -> None:
    """Score fingers that are not tracked, each network on the person whom it was trained without.

    Args:
        data: folder of motion with splits; its train split makes the mean hand of the baseline.
        networks: checkpoints of `bodysense train completion-fingers --leave-out NAME`.
        split: which clips of these people.
        run: folder that keeps the motion as it was read; nothing is kept if omitted.
        json: write the numbers here, as one flat object.
    """
    from rich.console import Console
    from rich.table import Table

    from bodysense.cli.show import write_numbers
    from bodysense.lab.completion.corpus import read_corpus
    from bodysense.lab.completion.finger_table import SETS, finger_numbers, person_clips, score_fingers
    from bodysense.lab.completion.train_fingers import load_finger_network

    if json is not None:
        check_place(json)
    loaded = {path.name: load_finger_network(path) for path in networks}
    scored, learned = (
        read_corpus(data, part, None if run is None else run / f"{part}.npz") for part in (split, "train")
    )
    for name, (_, task) in loaded.items():
        if not task.left_out or not len(person_clips(scored, task.left_out)[0]):
            raise BodysenseError(
                f"{name}: left out {task.left_out or 'no one'!r}, who has no fingers in the {split} split of {data}; "
                "give networks trained with --leave-out NAME of someone who has"
            )
    scores = score_fingers(loaded, scored, learned)
    table = Table(title=f"Fingers of people of whom nothing was learned ({data.name}, {split}), RMSJPE cm")
    for column in ("network", "left out", "generated h", "fingers", "network", "baseline", "ratio"):
        table.add_column(column)
    for one in scores:
        task = one.task
        figures = (f"{100 * one.error:.2f}", f"{100 * one.baseline:.2f}", f"{one.ratio:.2f}")
        table.add_row(one.network, task.left_out, f"{task.generated_hours:g}", SETS[one.sensors], *figures)
    Console().print(table)
    write_numbers(json, finger_numbers(scores))


def holes(data: str, common: Flat[Common] = Common(), clips: int | None = None) -> None:
    """Score filled holes beside interpolation: an arm, a leg, a hand missing for 1 to 3 seconds.

    Args:
        data: folder of motion files or a prepared store; NAME=FOLDER names it.
        clips: so many clips, evenly spread; all if omitted.
    """
    from bodysense.lab.datasets import named_data
    from bodysense.lab.holes import report_of, score_holes

    checked(common)
    source = named_data(data, common.split)
    wanted = 6 if common.quick else clips
    stride = 1 if wanted is None else max(1, source.count() // wanted)
    with progress_over([source]) as advance:
        gaps = score_holes(islice(source.clips(), 0, None, stride), advance=advance)
    finish(report_of(gaps, source.name), common)
