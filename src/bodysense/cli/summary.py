"""Results of a command: lines about a take, a file for other programs (`--json`), and a table of many files."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense import __version__
from bodysense.cli.options import ManyOptions
from bodysense.cli.show import wide_console
from bodysense.errors import BodysenseError
from bodysense.files import check_folder, check_place, write_json
from bodysense.io.markers.raw_markers import listed

if TYPE_CHECKING:
    from bodysense.body.person import Person
    from bodysense.sources.partial_motion import PartialMotion
    from bodysense.takes.many import FileOutcome
    from bodysense.takes.take import FilledFile, Take

_LISTED = 12  # largest number of joints or markers in a line
_LISTED_FILES = 40  # largest number of files in the table; of more, those with errors or warnings


def write_summary(path: Path | None, outputs: list[Path], values: Mapping[str, Any]) -> None:
    """Write a JSON object with the output files of a command and values about them; nothing if `path` is None."""
    if path is not None:
        write_json(path, {"outputs": [str(out) for out in outputs], **values})


def take_values(take: Take | FilledFile, speed: float, warnings: Sequence[str], of_markers: bool) -> dict[str, Any]:
    """Return values about a completed take: frames, Hz, speed, height in metres, filled frames and warnings.

    If `of_markers`, the filled frames are those of its markers.
    """
    from bodysense.body.shape import stature

    values: dict[str, Any] = {
        "frames": len(take.time),
        "frame_rate": round(take.clip.frame_rate, 6),
        "frames_per_second": round(speed, 1),
        "height": round(float(stature(take.person.skeleton.rest_offset)), 4),
        "height_is_inferred": bool(take.person.bone_deviation.any() and take.person.height is None),
        "warnings": list(warnings),
    }
    filled: dict[str, np.ndarray] = {}
    if take.partial is not None:
        filled = dict(zip(take.partial.rig.joints, take.partial.holes.T, strict=True))
    elif of_markers and take.markers is not None and take.markers.found is not None:
        filled = dict(zip(take.markers.found.raw.names, take.filled_markers.filled.T, strict=True))
    values["filled_frames"] = {name: int(frames.sum()) for name, frames in filled.items() if frames.any()}
    return values


def print_take(take: Take | FilledFile, warnings: tuple[str, ...], markers_out: bool) -> None:
    """Print filled frames, warnings and inferred proportions of a take."""
    if take.partial is not None:
        print(holes_line(take.partial))
    for line in warnings:
        if take.markers is None or line not in take.markers.warnings:  # those were printed when the file was opened
            print(f"WARNING: {line}", file=sys.stderr)
    if markers_out:
        assert take.markers is not None and take.markers.found is not None
        raw = take.markers.found.raw
        listed = frame_counts(raw.names, take.filled_markers.filled, "markers")
        print(f"filled, in frames of {len(raw.time)}: {listed}" if listed else "no marker has a gap: none was filled")
    if take.person.bone_deviation.any():
        print(inferred_line(take.person))


def holes_line(partial: PartialMotion) -> str:
    """Return a line about the joints that a motion lacked."""
    if partial.is_whole:
        return (
            "nothing is missing in this motion: it is unchanged (--missing names joints, --device simulates tracking)"
        )
    if partial.clip.lacks and not partial.holes.any():
        return f"completed {' and '.join(partial.clip.lacks)}, which the motion lacks"
    return f"filled frames, of {len(partial.holes)}: {frame_counts(partial.rig.joints, partial.holes, 'joints')}"


def frame_counts(names: Sequence[str], frames: np.ndarray, kind: str) -> str:
    """Return a text with the number of true frames (T, N) of each joint or marker, largest first; '' without any."""
    counts = sorted(zip(names, frames.sum(axis=0).tolist(), strict=True), key=lambda row: row[1])[::-1]
    found = [f"{name} {count}" for name, count in counts if count]
    more = f" and {len(found) - _LISTED} more {kind}" if len(found) > _LISTED else ""
    return ", ".join(found[:_LISTED]) + more


def remaining_gaps(take: Take | FilledFile) -> tuple[str, ...]:
    """Return a line about markers that still have gaps, if there are any."""
    assert take.markers is not None and take.markers.found is not None
    raw, filled = take.markers.found.raw, take.filled_markers.filled
    still = [raw.names[k] for k in np.flatnonzero(~(np.isfinite(raw.position[..., 0]) | filled).all(axis=0)).tolist()]
    return (f"gaps remain (never seen, not worn on the body, or no markers): {listed(still)}",) if still else ()


def inferred_line(person: Person) -> str:
    """Return a line about the inferred proportions of a wearer."""
    if person.height is None:
        return f"height {person.stature:.2f} m inferred"
    return f"height {person.height.value:.2f} m known, other proportions inferred"


def do_many(
    work: partial[dict[str, Any]],
    sources: Sequence[Path],
    endings: Sequence[str],
    folder: Path,
    options: ManyOptions,
    json: Path | None,
) -> int:
    """Do the work of a command on many files, print one table, and return the exit status: 1 if a file failed.

    Raises BodysenseError, before any work, for outputs that cannot be written.
    """
    from rich.progress import track

    from bodysense.io.motion_files import ENDINGS
    from bodysense.takes.many import do_all, files_of, tasks_of

    command = work.func.__name__.strip("_").partition("_")[0]
    for source in sources:
        if not source.exists():
            hint = f"see bodysense {command} --help, or give a file or folder that exists"
            raise BodysenseError(f"{source}: unknown argument; {hint}")
    files, others = files_of(sources, endings)
    if folder.suffix.lower() in (*endings, *ENDINGS):
        raise BodysenseError(
            f"-o {folder}: {len(files)} files are written to a folder; give its name, and --ending {folder.suffix} for "
            "the kind of file"
        )
    check_folder(folder)
    if json is not None:
        check_place(json)
    tasks, begun = tasks_of(files, folder, options.ending or ".bvh"), time.perf_counter()
    given = f"{__version__} {command} {sorted(work.keywords.items())}"
    results = do_all(work, tasks, folder, given, options.jobs, options.scheduler)
    outcomes = list(track(results, f"{len(tasks)} files", total=len(tasks), transient=True))
    seconds = time.perf_counter() - begun
    _print_many(outcomes, folder, seconds)
    if others:
        listed = ", ".join(f"{ending} ({count})" for ending, count in others.most_common())
        print(f"note: files of other kinds are left out: {listed}")
    rows = [asdict(one) | {"warnings": list(one.warnings)} for one in outcomes]
    write_summary(json, [Path(one.out) for one in outcomes if not one.error], {"files": rows})
    return int(any(one.error for one in outcomes))


def _print_many(outcomes: Sequence[FileOutcome], folder: Path, seconds: float) -> None:
    """Print a table of files, and the errors and warnings on the error stream."""
    from rich import box
    from rich.table import Table

    in_table = outcomes if len(outcomes) <= _LISTED_FILES else [one for one in outcomes if one.error or one.warnings]
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ("file", "frames", "Hz", "seconds", "result"):
        table.add_column(column, justify="left" if column in ("file", "result") else "right", overflow="fold")
    for one in in_table[:_LISTED_FILES]:
        result = "failed" if one.error else "written before" if one.is_earlier else f"wrote {one.out}"
        numbers = ("", "") if one.error else (str(one.frames), f"{one.frame_rate:g}")
        table.add_row(one.file, *numbers, f"{one.seconds:.2f}", result + " (WARNING)" * bool(one.warnings))
    wide_console().print(table)
    for one in outcomes:
        for line in one.warnings:
            print(f"WARNING: {one.file}: {line.removeprefix(f'{one.file}: ')}", file=sys.stderr)
    for one in outcomes:
        if one.error:
            print(f"failed: {one.file}: {one.error.removeprefix(f'{one.file}: ')}", file=sys.stderr)
    wrong, earlier = (sum(map(bool, of)) for of in zip(*((one.error, one.is_earlier) for one in outcomes), strict=True))
    fresh = len(outcomes) - wrong - earlier
    notes = [f"{wrong} failed"] * bool(wrong) + [f"{earlier} written before"] * bool(earlier)
    each = f" ({seconds / fresh:.2f} s each)" if fresh else ""
    print(", ".join([f"wrote {fresh} of {len(outcomes)} files to {folder} in {seconds:.1f} s{each}", *notes]))
