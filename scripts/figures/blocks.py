"""Blocks: generated text between the markers `<!-- begin NAME -->` and `<!-- end NAME -->` of a page.

A command that measures writes its numbers with `--json` as one flat object, with the processor and its own time on it.
A block says of which files its text is made, and ends with the processors of these, and their time if each file has it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
Numbers = dict[str, float]
NOT_RECORDED = "not recorded"  # processor of tables from older files, which do not name it


@dataclass(frozen=True)
class Measured:
    """Numbers of a file, the processor on which they were measured, and the command's processor time."""

    numbers: Numbers
    processor: str
    cpu_seconds: float | None = None  # missing in older files


@dataclass(frozen=True)
class Block:
    """Text between two markers of a page.

    `text` takes the numbers of each of `files`, then those of each of `more`, or None if there is no such file.
    """

    page: str  # path from the repository's root
    name: str  # of its markers
    text: Callable[..., str]
    files: tuple[str, ...] = ()  # names without .json; a block with a missing one stays unchanged
    more: tuple[str, ...] = ()  # optional files; a block with only these stays unchanged if all are missing


def read_measured(folder: Path) -> dict[str, Measured]:
    """Read every file of numbers in a folder, by its name. Raises ValueError for a file without a processor."""
    found = {}
    for path in sorted(folder.glob("*.json")):
        numbers = json.loads(path.read_text(encoding="utf-8"))
        if "processor" not in numbers:
            raise ValueError(f"{path}: no processor; measure again, with the command that wrote it")
        found[path.stem] = Measured(numbers, numbers.pop("processor"), numbers.pop("cpu_seconds", None))
    return found


def write_blocks(blocks: Iterable[Block], measured: Mapping[str, Measured], root: Path = ROOT) -> None:
    """Replace the text of every block whose files exist (at least one of `more` if it has no `files`)."""
    for block in blocks:
        if set(block.files) <= set(measured) and not set(measured).isdisjoint((*block.files, *block.more)):
            named = [measured.get(name) for name in (*block.files, *block.more)]
            text = block.text(*(one and one.numbers for one in named))
            there = [one for one in named if one is not None]
            if there:
                seconds = [one.cpu_seconds for one in there if one.cpu_seconds is not None]
                hours = sum(seconds) / 3600 if len(seconds) == len(there) else None
                text += "\n\n" + processor_line(*sorted({one.processor for one in there}), hours=hours)
            page = root / block.page
            page.write_text(put(page.read_text(encoding="utf-8"), block.name, text), encoding="utf-8")


def processor_line(*names: str, hours: float | None = None) -> str:
    """Return the line of a block with its processors and the CPU hours of its commands."""
    taken = "" if hours is None else f"; {hours:.2g} CPU hours"
    return f"Processor: {', '.join(names)}{taken}."


def put(text: str, name: str, body: str) -> str:
    """Replace the text between the markers of `name`. Raises ValueError for a page without them."""
    begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    before, found, rest = text.partition(begin)
    _, closed, after = rest.partition(end)
    if not (found and closed):
        raise ValueError(f"no markers of {name}")
    return f"{before}{begin}\n{body}\n{end}{after}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])


def sampled(numbers: Numbers) -> str:
    """Return the number of clips of figures, as a sample if not all clips were scored."""
    clips, total = f"{numbers['clips']:.0f}", numbers.get("clips_in_split", numbers["clips"])
    some = f"{clips} of {total:.0f} clips" if numbers["clips"] < total else f"{clips} clips"
    if "quick" in numbers:
        return f"a sample, the first seconds of {some} (`--quick`)"
    return f"a sample of {some}" if numbers["clips"] < total else some


def between(numbers: Numbers, low: str, high: str, what: str) -> str:
    """Return the 95 % interval of a figure as a sentence after a space, or an empty string without an interval."""
    if not (low in numbers and high in numbers):
        return ""
    return f" {what}: between {numbers[low]:.2f} and {numbers[high]:.2f} cm (95 %, over people)."


def figure(numbers: Numbers, key: str, digits: int = 2) -> str:
    """Return a figure as text; a dash if it is missing."""
    return f"{numbers[key]:.{digits}f}" if key in numbers else "–"
