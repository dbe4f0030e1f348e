"""`bodysense conform`: a referee for the output of any body tracker."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.extras import SubcommandApp

from bodysense.errors import BodysenseError
from bodysense.files import check_place

if TYPE_CHECKING:
    from rich.console import Console

    from bodysense_conform.subject import Subject
    from bodysense_conform.verdict import Verdict

Split = Literal["train", "val", "test"]


def add_commands(root: SubcommandApp, data: SubcommandApp) -> None:
    """Put the referee's command into the tree."""
    root.command(conform)


def conform(
    source: Annotated[str, tyro.conf.Positional],
    script: Path | None = None,
    floor: float | None = None,
    html: Path | None = None,
    json: Path | None = None,
    junit: Path | None = None,
    seconds: float = 10.0,
    watch: Literal["replay", "vmc", "markers"] | None = None,
    window: float | None = None,
    splits: tuple[Split, ...] = (),
    limit: int | None = None,
) -> int:
    """Judge the output of a body tracker: is it whole, a body, and does it move as one?

    The exit status is 0 for what passed, 1 for what failed, 2 for what could not be judged, a retake included.

    Args:
        source: motion (.bvh, AMASS .npz, .glb, .gltf, .vrma), recording (.npz, .jsonl), take (.mcap), folder of these,
            or a stream: vmc:PORT, ws://HOST:PORT/ws of a server.
        script: JSON file of what the performer did when (docs/conform.md); TAKE.labels.json beside a file if omitted.
        floor: height of the floor in metres; that of the format, or where the feet stand, if omitted.
        html: report with pictures.
        json: report with every figure, hashes and versions.
        junit: JUnit XML report for continuous integration.
        seconds: how long a stream is recorded.
        watch: which input of a server is watched; its first if omitted.
        window: of a folder: judge pieces of so many seconds, not whole files.
        splits: of a folder of motion data: the splits that are judged, all if omitted.
        limit: of a folder: how many pieces are judged, evenly spread; all if omitted.
    """
    from bodysense_conform.report.html import write_html
    from bodysense_conform.report.text import write_json, write_junit
    from bodysense_conform.script import read_script, script_beside
    from bodysense_conform.verdict import EXIT_STATUS, judge

    for path in (html, json, junit):
        if path is not None:
            check_place(path)
    if Path(source).is_dir():
        _refuse_for_folder(source, script=script, html=html, junit=junit, watch=watch)
        return _judge_folder(Path(source), floor, window, splits, limit, json)
    if window is not None or splits or limit is not None:
        raise BodysenseError(f"{source}: --window, --splits and --limit are for folders; leave them out")
    subject = _subject(source, seconds, watch)
    script = script or (None if _is_stream(source) else script_beside(Path(source)))
    steps = () if script is None else read_script(script)
    subject = replace(subject, steps=steps, floor=subject.floor if floor is None else floor)
    verdict = judge(subject)
    for path, write in ((html, write_html), (json, write_json), (junit, write_junit)):
        if path is not None:
            write(path, verdict)
    _show(verdict)
    for path in (html, json, junit):
        if path is not None:
            print(f"wrote {path}")
    return EXIT_STATUS[verdict.judgement]


def _is_stream(source: str) -> bool:
    return source.startswith(("vmc:", "ws://", "wss://"))


def _subject(source: str, seconds: float, watch: str | None) -> Subject:
    if not _is_stream(source):
        from bodysense_conform.sources.files import read_subject

        return read_subject(Path(source))
    if not 1 <= seconds <= 3600:
        raise BodysenseError(f"--seconds {seconds:g}: a stream is recorded for 1 to 3600 seconds")
    if source.startswith("vmc:"):
        from bodysense_conform.sources.vmc import record_vmc

        return record_vmc(source, seconds)
    from bodysense_conform.sources.websocket import record_websocket

    return record_websocket(source, seconds, watch)


def _show(verdict: Verdict) -> None:
    """Print what is wrong, and the sum of it."""
    from rich.console import Console

    from bodysense_conform.report.text import sentence

    console = Console(highlight=False)
    for finding in verdict.of("fail", "retake"):
        colour = "red" if finding.outcome == "fail" else "yellow"
        console.print(f"[{colour}]{finding.outcome:7}[/] {finding.check.id:32} {sentence(finding)}")
    if verdict.judgement == "not enough":
        for finding in verdict.of("not enough"):
            if finding.check.required:
                console.print(f"[yellow]not enough[/] {finding.check.id:29} {finding.reason}")
    counts = [
        f"{len(verdict.of(outcome))} {outcome}" for outcome in ("pass", "fail", "retake", "measured", "not enough")
    ]
    console.print(f"{verdict.subject.name}: {verdict.judgement} ({', '.join(counts)})")


def _refuse_for_folder(source: str, **options: object) -> None:
    for option, value in options.items():
        if value is not None:
            raise BodysenseError(f"{source}: a folder; --{option} is for one file or stream, leave it out")


def _judge_folder(
    folder: Path,
    floor: float | None,
    window: float | None,
    splits: tuple[Split, ...],
    limit: int | None,
    json: Path | None,
) -> int:
    """Judge every file of a folder, or its pieces; print a line each that does not pass, and how many do."""
    from rich.console import Console

    from bodysense_conform.report.text import versions
    from bodysense_conform.verdict import EXIT_STATUS, judge

    if window is not None and not 1 <= window <= 3600:
        raise BodysenseError(f"--window {window:g}: give 1 to 3600 seconds")
    if limit is not None and limit < 1:
        raise BodysenseError(f"--limit {limit}: give at least 1")
    console = Console(highlight=False)
    counts: dict[str, int] = {}
    rows = []
    for subject in _pieces(folder, window, splits, limit, console):
        verdict = judge(replace(subject, floor=subject.floor if floor is None else floor))
        counts[verdict.judgement] = counts.get(verdict.judgement, 0) + 1
        failed = [finding.check.id for finding in verdict.of("fail", "retake")]
        rows.append({"name": subject.name, "judgement": verdict.judgement, "failed": failed})
        if verdict.judgement != "pass":
            console.print(f"{verdict.judgement:10} {subject.name}: {', '.join(failed)}")
    if not rows:
        raise BodysenseError(f"{folder}: nothing in it could be judged; give another folder, or leave --splits out")
    console.print(f"{len(rows)} judged: {', '.join(f'{count} {name}' for name, count in sorted(counts.items()))}")
    if json is not None:
        import json as text

        from bodysense.files import written_beside

        document = {"format": "bodysense conform folder 1", "versions": versions(), "counts": counts, "rows": rows}
        with written_beside(json) as beside:
            beside.write_text(text.dumps(document, indent=1) + "\n", encoding="utf-8")
        print(f"wrote {json}")
    order = ("fail", "retake", "not enough", "pass")
    return EXIT_STATUS[next(name for name in order if name in counts)]  # type: ignore[index]


def _pieces(
    folder: Path, window: float | None, splits: tuple[Split, ...], limit: int | None, console: Console
) -> Iterator[Subject]:
    """The files of a folder as subjects, whole or in windows; of more than `limit` every n-th."""
    from rich.progress import track

    from bodysense_conform.sources.folder import jobs, subjects

    chosen = jobs(folder, window, splits, limit)
    for job in track(chosen, description=f"judging {folder.name}", console=console, transient=True):
        try:
            yield from subjects(job)
        except BodysenseError as error:
            console.print(f"[yellow]unreadable[/] {error}")
