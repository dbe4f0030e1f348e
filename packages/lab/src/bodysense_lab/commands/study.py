"""`bodysense study`: user studies of which completed motion looks more natural."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.extras import SubcommandApp

from bodysense.cli.options import Reading
from bodysense.errors import BodysenseError
from bodysense.files import check_place, make_folder
from bodysense.io.reading_options import AS_FOUND
from bodysense.ranges import Count, Processes, Seed
from bodysense_lab.commands.reporting import check_places, tracker_settings
from bodysense_lab.core.options import Json, Output

if TYPE_CHECKING:
    from rich.table import Table

    from bodysense_lab.study.analysis import StudyResult
    from bodysense_lab.study.study import Condition

KeyFile = Annotated[Path, tyro.conf.Positional]


def commands() -> SubcommandApp:
    """Return the group's commands."""
    group = SubcommandApp()
    group.command(build)
    group.command(analyze)
    group.command(simulate)
    return group


def build(
    out: Annotated[Path, tyro.conf.Positional],
    clips: tuple[Path, ...] = (),
    seconds: float = 6.0,
    scenes: Count = 8,
    model: Path | None = None,
    last_known: Literal["world", "head", "heading"] = "heading",
    half_life: float | None = None,
    seed: Seed = 0,
    jobs: Processes | None = None,
    reading: Reading = AS_FOUND,
) -> None:
    """Make a study: the pages for raters, and the key to their animations (docs/study.md).

    Args:
        out: new folder; serve site/, and keep key.json secret.
        clips: motion files (.bvh, AMASS .npz); the packaged performance if omitted.
        seconds: maximum length of a scene; longer clips are cut into scenes of equal length.
        scenes: maximum number of scenes, drawn at random; each rater sees three pairs of each.
        model: network written by `bodysense train`; the packaged one if omitted.
        last_known: axes in which the baseline keeps a hidden joint: the world, the head, or the head's heading.
        half_life: half-life of the tracker's smoother in seconds, of network and baseline; the default one if omitted.
        seed: random seed of names, scenes and orders.
        jobs: processes; all processors if omitted.
        reading: properties that the motion files do not contain.
    """
    import os

    import numpy as np
    from rich.console import Console
    from rich.progress import Progress

    from bodysense.cli.recordings import load_clip
    from bodysense.demo import packaged_performance
    from bodysense_lab.study.scenes import StudySettings, build_study

    settings = StudySettings(
        longest=seconds,
        scenes=scenes,
        model=model,
        last_known=last_known,
        tracker=tracker_settings(half_life),
    )
    check_place(out / "key.json" if out.is_dir() else out)
    loaded = [replace(load_clip(file, reading), name=file.stem) for file in clips] or [packaged_performance()]
    with Progress() as progress:
        bar = progress.add_task("completing the body", total=None)
        key, motions = build_study(
            out,
            loaded,
            settings,
            np.random.default_rng(seed),
            jobs or os.cpu_count() or 1,
            lambda done, total: progress.update(bar, description="rendering", completed=done, total=total),
        )
    console = Console()
    table = _table("", ("scene", "seconds", "joints hidden", "ours", "baseline"))
    for motion in motions:
        error = (f"{motion.error[condition]:.1f} cm" for condition in ("ours", "baseline"))
        table.add_row(motion.name, f"{motion.seconds:.1f}", f"{motion.hidden.mean():.0%}", *error)
    table.caption = "Mean error of hidden joints after IK and smoothing."
    console.print(table)
    console.print(f"wrote {out / 'site'}: {3 * len(key.scenes)} pairs a rater; serve this folder", highlight=False)
    console.print(f"wrote {out / 'key.json'}: the condition of each animation; do not serve it", highlight=False)


def analyze(
    key: KeyFile,
    answers: Annotated[tuple[Path, ...], tyro.conf.Positional] = (),
    json: Json = None,
    out: Path | None = None,
) -> None:
    """Compute mean preferences of raters with standard error and t-test, per scene and over all (UNOC, Fig. 6).

    Args:
        key: the study's key.json.
        answers: files that raters saved.
        out: folder for preferences.csv and preferences.png.
    """
    from rich.console import Console

    from bodysense.cli.show import write_numbers
    from bodysense_lab.study.analysis import analyze as analyze_answers
    from bodysense_lab.study.analysis import write_csv
    from bodysense_lab.study.study import read_all_answers, read_key

    check_places(json)
    study_key = read_key(key)
    result = analyze_answers(study_key, read_all_answers(answers, study_key))
    console = Console()
    console.print(preference_table(result))
    write_numbers(json, result.numbers())
    if out is not None:
        make_folder(out)
        write_csv(out / "preferences.csv", result)
        draw_preferences(out / "preferences.png", result)
        for name in ("preferences.csv", "preferences.png"):
            console.print(f"wrote {out / name}", highlight=False)


def simulate(
    key: KeyFile,
    out: Output,
    preference: str = "",
    raters: Count = 39,
    ties: float = 0.2,
    seed: Seed = 0,
) -> None:
    """Write answers of simulated raters, to test a study or to find the number of raters that it needs.

    Args:
        key: the study's key.json.
        out: folder for answers-simulated-001.json …
        preference: quality of each condition, as 'truth=0.8,ours=0.6,baseline=0'; 0 if omitted. The mean vote on a pair
            is the difference of its qualities.
        raters: number of raters.
        ties: share of 'no difference' between conditions of equal quality.
        seed: random seed of the votes.
    """
    import numpy as np

    from bodysense_lab.study.analysis import simulate_answers
    from bodysense_lab.study.study import read_key, write_answers

    study_key = read_key(key)
    given = simulate_answers(study_key, raters, parse_preference(preference), np.random.default_rng(seed), ties)
    make_folder(out)
    for answers in given:
        write_answers(out / f"answers-{answers.rater}.json", answers)
    print(f"wrote {len(given)} files to {out}")


def parse_preference(text: str) -> dict[Condition, float]:
    """Parse 'truth=0.8,ours=0.6'. Raises BodysenseError for an unknown name or a value that is not a number."""
    from bodysense_lab.study.study import CONDITIONS

    result: dict[Condition, float] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, _, value = part.partition("=")
        known: list[Condition] = [condition for condition in CONDITIONS if condition == name.strip()]
        if not known:
            raise BodysenseError(f"--preference: unknown condition {name!r}; valid are {', '.join(CONDITIONS)}")
        try:
            result[known[0]] = float(value)
        except ValueError:
            raise BodysenseError(f"--preference {part!r}: {value!r} is not a number; write {name}=0.6") from None
    return result


def preference_table(result: StudyResult) -> Table:
    """Return the table of comparisons for every scene, then for all: mean vote, standard error, t-test."""
    from bodysense_lab.study.study import COMPARISONS

    columns = ("scene", "comparison", "mean", "± s. e.", "t", "p", "", "n")
    table = _table(f"{result.raters} raters, {len(result.scenes)} scenes", columns)
    for name, preferences in result.preferences.items():
        for (first, second), one in zip(COMPARISONS, preferences, strict=True):
            tested = (f"{one.standard_error:.2f}", f"{one.t:.2f}", _probability(one.p)) if one.n > 1 else ("–",) * 3
            table.add_row(name or "all", f"{first} over {second}", f"{one.mean:+.2f}", *tested, one.stars, str(one.n))
        table.add_section()
    table.caption = "+1: all prefer the first; −1: the second. * p < .05, ** p < .01."
    return table


def draw_preferences(path: Path, result: StudyResult) -> None:
    """Draw the bars of Fig. 6: every scene, then all."""
    import numpy as np

    from bodysense_lab.core.chart import Bars, draw_bars
    from bodysense_lab.study.study import COMPARISONS

    names = (*result.scenes, None)
    series = []
    for which, (first, second) in enumerate(COMPARISONS):
        each = [result.preferences[name][which] for name in names]
        series.append(
            Bars(
                f"{first} over {second}",
                np.array([one.mean for one in each]),
                np.array([one.standard_error for one in each]),
                tuple(one.stars for one in each),
            )
        )
    title = f"Which is more natural? {result.raters} raters"
    draw_bars(path, [name or "all" for name in names], series, title, "± standard error; t-test: * p < .05, ** p < .01")


def _probability(p: float) -> str:
    return "< .001" if p < 0.001 else f"{p:.3f}"


def _table(title: str, columns: tuple[str, ...]) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title=title or None, box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k == 0 or column == "comparison" else "right", no_wrap=True)
    return table
