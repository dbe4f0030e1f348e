"""`bodysense conform`: a referee for the output of any body tracker."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.extras import SubcommandApp

from bodysense.errors import BodysenseError
from bodysense.files import check_place

if TYPE_CHECKING:
    from bodysense_conform.evaluate import Verdict
    from bodysense_conform.subject import Subject

Split = Literal["train", "val", "test"]


def add_commands(root: SubcommandApp, data: SubcommandApp) -> None:
    """Add the referee's command to the tree."""
    root.command(conform)


def conform(
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")],
    script: Path | None = None,
    floor: float | None = None,
    reference: Path | None = None,
    html: Path | None = None,
    json: Path | None = None,
    seconds: float = 10.0,
    watch: Literal["replay", "vmc", "markers"] | None = None,
    splits: tuple[Split, ...] = (),
) -> int:
    """Judge the output of a body tracker: is it complete, is it a body, and does it move like one?

    The exit status is 0 if it passed, 1 if it failed, 2 if it could not be judged or is to be taken again.

    Args:
        source: motion (.bvh, AMASS .npz, .glb, .gltf, .vrma), recording (.npz, .jsonl), markers (.c3d, .trc), take
            (.mcap), folder of these, or a stream: vmc:PORT, ws://HOST:PORT/ws of a server.
        script: JSON file of what the performer did when (docs/conform.md); TAKE.labels.json if omitted.
        floor: height of the floor in metres; that of the format, or the usual height of the soles, if omitted.
        reference: the same performance from a source with a trusted clock, for judging how late the motion is.
        html: report with pictures.
        json: report with every figure, hashes and versions.
        seconds: length of the recording of a stream.
        watch: input of a server; its first if omitted.
        splits: splits of a folder of motion data; all if omitted.
    """
    from bodysense_conform.evaluate import EXIT_STATUS, judge
    from bodysense_conform.report.html import page
    from bodysense_conform.report.text import as_json, record, write
    from bodysense_conform.script import read_script, script_beside
    from bodysense_conform.sources.files import read_subject

    for path in (html, json):
        if path is not None:
            check_place(path)
    if floor is not None and not abs(floor) <= 1000:
        raise BodysenseError(f"--floor {floor:g}: give the floor's height in metres")
    if not source:
        raise BodysenseError('SOURCE "": give a file, a folder or a stream, such as vmc:39539')
    if Path(source).is_dir():
        for option, value in {"script": script, "html": html, "reference": reference, "watch": watch}.items():
            if value is not None:
                raise BodysenseError(f"{source}: a folder; --{option} is for one file or stream, leave it out")
        return _judge_folder(Path(source), floor, splits, json)
    if splits:
        raise BodysenseError(f"{source}: --splits is for folders; leave it out")
    if watch is not None and not source.startswith(("ws://", "wss://")):
        raise BodysenseError(f"{source}: --watch is for a server, ws://HOST:PORT/ws; leave it out")
    subject = _subject(source, seconds, watch)
    if script is None and not _is_stream(source):
        script = script_beside(Path(source))
    subject = replace(
        subject,
        steps=() if script is None else read_script(script),
        floor=subject.floor if floor is None else floor,
        reference=None if reference is None else read_subject(reference),
    )
    verdict = judge(subject)
    _print(verdict)
    write(html, lambda: page(verdict))
    write(json, lambda: as_json(record(verdict)))
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


def _print(verdict: Verdict) -> None:
    """Print faults, what could not be judged, and the sum."""
    from rich.console import Console

    from bodysense_conform.evaluate import OUTCOMES
    from bodysense_conform.report.text import sentence, shortened

    console = Console(highlight=False, markup=False)
    for finding in verdict.of("fail", "retake"):
        style = "red" if finding.outcome == "fail" else "yellow"
        console.print(f"{finding.outcome:10} {finding.check.id:28} {sentence(finding)}", style=style)
    for reason, ids in verdict.unanswered.items():
        console.print(f"not enough {reason}: {', '.join(shortened(ids))}", style="dim")
    counts = ", ".join(f"{len(verdict.of(outcome))} {outcome}" for outcome in OUTCOMES)
    console.print(f"{verdict.subject.name}: {verdict.judgement} ({counts})")


def _judge_folder(folder: Path, floor: float | None, splits: tuple[Split, ...], json: Path | None) -> int:
    """Judge every file of a folder; print a line for each that does not pass, and the sum."""
    from bodysense_conform.evaluate import EXIT_STATUS, Judgement, judge
    from bodysense_conform.report.text import as_json, versions, write
    from bodysense_conform.sources.files import ENDINGS, folder_subjects
    from bodysense_conform.table import table

    counts: Counter[Judgement] = Counter()
    rows = []
    for name, subject in folder_subjects(folder, splits):
        if isinstance(subject, BodysenseError):
            print(f"unreadable {subject}")
            continue
        verdict = judge(replace(subject, floor=subject.floor if floor is None else floor))
        counts[verdict.judgement] += 1
        failed = [finding.check.id for finding in verdict.of("fail", "retake")]
        rows.append({"name": name, "judgement": verdict.judgement, "failed": failed})
        if verdict.judgement != "pass":
            print(f"{verdict.judgement:10} {name}: {', '.join(failed)}")
    if not rows:
        kinds = ", ".join(ENDINGS)
        raise BodysenseError(f"{folder}: no file in it can be judged; give a folder of {kinds}, or leave --splits out")
    print(f"{len(rows)} judged: {', '.join(f'{count} {name}' for name, count in sorted(counts.items()))}")
    document = {"format": "bodysense conform folder 2", "versions": versions(table()), "counts": counts, "rows": rows}
    write(json, lambda: as_json(document))
    return EXIT_STATUS["fail"] if counts["fail"] else max(EXIT_STATUS[name] for name in counts)
