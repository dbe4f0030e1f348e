"""Many files by one command: inputs of folders, names of outputs, and a record by which a stopped run goes on."""

from __future__ import annotations

import errno
import io
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from bodysense.errors import BodysenseError
from bodysense.files import make_folder
from bodysense.parallel import parallel_map

RECORD = "bodysense_files.jsonl"  # in the folder of outputs; a line for each file that was written
Work = Callable[[Path, Path], Mapping[str, Any]]  # input, output → values with 'frames', 'frame_rate', 'warnings'


@dataclass(frozen=True)
class FileTask:
    """A file to be written from another one."""

    file: Path
    out: Path


@dataclass(frozen=True)
class FileOutcome:
    """Result of one file."""

    file: str
    out: str
    frames: int = 0
    frame_rate: float = 0.0  # Hz
    seconds: float = 0.0  # that the work took
    warnings: tuple[str, ...] = ()
    error: str = ""  # why nothing was written
    is_earlier: bool = False  # it was written by an earlier run


def files_of(sources: Sequence[Path], endings: Sequence[str]) -> tuple[list[tuple[Path, Path]], Counter[str]]:
    """Return files with their paths below the folder of outputs, and counts of other endings in folders.

    A folder stands for its files with one of `endings`, at any depth; hidden ones are left out.

    Raises BodysenseError for a folder without such files.
    """
    found: dict[Path, Path] = {}
    others: Counter[str] = Counter()
    for source in sources:
        if not source.is_dir():
            found.setdefault(source, Path(source.name))
            continue
        inside = [path for path in sorted(source.rglob("*")) if path.is_file() and path.name != RECORD]
        inside = [path for path in inside if not any(part.startswith(".") for part in path.relative_to(source).parts)]
        fitting = [path for path in inside if path.suffix.lower() in endings]
        if not fitting:
            raise BodysenseError(f"{source}: a folder without files that are read ({', '.join(endings)})")
        others.update(path.suffix.lower() or "without ending" for path in inside if path not in fitting)
        found |= {path: path.relative_to(source) for path in fitting}
    return list(found.items()), others


def tasks_of(files: Sequence[tuple[Path, Path]], folder: Path, ending: str) -> list[FileTask]:
    """Return the output of each file in a folder, with an ending; equal names get the input's: walk_c3d.bvh.

    Raises BodysenseError for names that remain equal, and for an output that is one of the inputs.
    """
    stems = Counter(below.with_suffix("") for _, below in files)
    tasks: list[FileTask] = []
    taken: dict[Path, Path] = {}
    for file, below in files:
        name = below.stem if stems[below.with_suffix("")] == 1 else f"{below.stem}_{below.suffix.lstrip('.')}"
        out = folder / below.with_name(name + ending)
        if out in taken:
            raise BodysenseError(f"{file}: {out} is of {taken[out]}; rename one, or give -o another folder for it")
        taken[out] = file
        tasks.append(FileTask(file, out))
    inputs = {file.resolve() for file, _ in files}
    for task in tasks:
        if task.out.resolve() in inputs:
            raise BodysenseError(f"{task.out}: both read and written; give -o another folder")
    return tasks


def do_all(
    work: Work, tasks: Sequence[FileTask], folder: Path, options: str, jobs: int = 1, scheduler: str | None = None
) -> Iterator[FileOutcome]:
    """Yield the outcome of each task, in order; what an earlier run wrote by the same options is not done again.

    Args:
        work: picklable; prints are dropped.
        tasks: the files.
        folder: of all outputs; it has the record.
        options: text that differs if outputs would differ.
        jobs: processes.
        scheduler: address of a Dask scheduler whose machines do the work instead; they share the files.

    A file that cannot be read or written is an outcome with an error. Raises OSError if the disk is full.
    """
    record = make_folder(folder) / RECORD
    known = _earlier(record, options)
    for task in tasks:
        make_folder(task.out.parent)
    todo = [task for task in tasks if (task.file, task.out) not in known]
    results = parallel_map(partial(_done, work), todo, jobs, scheduler)
    with record.open("a", encoding="utf-8") as lines:
        for task in tasks:
            if (task.file, task.out) in known:
                yield known[task.file, task.out]
                continue
            done, outcome = next(results)
            if not outcome.error:
                row = {"identity": _identity(done.file), "options": options, **asdict(outcome)}
                lines.write(json.dumps(row, ensure_ascii=False) + "\n")
                lines.flush()
            yield outcome


def _done(work: Work, task: FileTask) -> FileOutcome:
    """Do one task without printing."""
    begun, silent = time.perf_counter(), io.StringIO()
    try:
        with redirect_stdout(silent), redirect_stderr(silent):
            values = work(task.file, task.out)
    except (BodysenseError, OSError) as error:
        cause = error if isinstance(error, OSError) else error.__context__
        if isinstance(cause, OSError) and cause.errno in (errno.ENOSPC, errno.EDQUOT):
            raise OSError(cause.errno, cause.strerror, str(task.out)) from None
        return FileOutcome(str(task.file), str(task.out), seconds=time.perf_counter() - begun, error=str(error))
    seconds = time.perf_counter() - begun
    warnings = tuple(values["warnings"])
    return FileOutcome(str(task.file), str(task.out), values["frames"], values["frame_rate"], seconds, warnings)


def _earlier(record: Path, options: str) -> dict[tuple[Path, Path], FileOutcome]:
    """Return the outcomes in a record whose input and options are unchanged and whose output exists."""
    known: dict[tuple[Path, Path], FileOutcome] = {}
    if not record.is_file():
        return known
    for line in record.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            row = json.loads(line)
            identity, given = row.pop("identity"), row.pop("options")
            outcome = FileOutcome(**row | {"warnings": tuple(row["warnings"]), "is_earlier": True})
        except (ValueError, KeyError, TypeError, AttributeError):  # the line of a killed run
            continue
        file, out = Path(outcome.file), Path(outcome.out)
        known.pop((file, out), None)
        if given == options and out.is_file() and identity == _identity(file):
            known[file, out] = outcome
    return known


def _identity(file: Path) -> list[Any]:
    """Return values that change if a file is another one."""
    try:
        found = file.stat()
    except OSError:
        return []
    return [str(file.resolve()), found.st_size, found.st_mtime_ns]
