"""Templates of generated text between the markers `<!-- begin NAME -->` and `<!-- end NAME -->` of a page.

A command that measures writes its numbers with `--json` as one flat object, with the processor and its own time on it.
`tables.toml` has the text of each block with figures in braces, `{KEY:FORMAT}`:

- KEY is a number of the block's first file, `FILE/KEY` one of another. Other text is an expression over numbers,
  where `n('KEY')` stands for a key that is no Python name. `{sample}` and `{limit}` name the clips of a file.
- `@ KEY = LABEL; KEY; …` repeats the next line with $1 for the key and $2 for the label, by default the key with
  spaces. `@@` before it repeats both with $3 and $4.
- A cell with a missing figure is a dash. A row without any figure is omitted, and so are a table without rows and a
  line of prose with a missing figure.

A block ends with the processors of its files, and their time if each file has it.
"""

from __future__ import annotations

import json
import re
import textwrap
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
TEMPLATES = Path(__file__).with_name("tables.toml")
WIDTH = 120  # characters of a line of prose
_PLACE = re.compile(r"\{([^{}]+?)(?::([^{}:/']*))?\}")
Numbers = Mapping[str, float]


@dataclass(frozen=True)
class Measured:
    """Numbers of a file, the processor on which they were measured, and the command's processor time."""

    numbers: Numbers
    processor: str
    cpu_seconds: float | None = None  # missing in older files

    @property
    def line(self) -> str:
        """The last line of a block of these numbers alone."""
        hours = None if self.cpu_seconds is None else self.cpu_seconds / 3600
        return processor_line(self.processor, hours=hours)


@dataclass(frozen=True)
class Block:
    """Text between two markers of a page."""

    page: str  # path from the repository's root
    name: str  # of its markers
    text: str
    files: tuple[str, ...]  # names without .json; a block with a missing one stays unchanged
    more: tuple[str, ...] = ()  # optional files; a block with only these stays unchanged if all are missing

    def rendered(self, measured: Mapping[str, Measured]) -> str:
        """Return the text with figures, and the processors of the files that are measured."""
        found = {name: measured[name] for name in (*self.files, *self.more) if name in measured}
        text = filled(self.text, {name: one.numbers for name, one in found.items()})
        seconds = [one.cpu_seconds for one in found.values() if one.cpu_seconds is not None]
        hours = sum(seconds) / 3600 if len(seconds) == len(found) else None
        return f"{text}\n\n{processor_line(*sorted({one.processor for one in found.values()}), hours=hours)}"


def read_templates(path: Path = TEMPLATES) -> tuple[list[Block], dict[str, Any]]:
    """Return the blocks of all pages, and the figures of the papers' rows."""
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    rows, _ = content.pop("rows"), content.pop("commands")
    blocks = [
        Block(page, one["name"], one["text"].strip("\n"), tuple(one.get("from", ())), tuple(one.get("more", ())))
        for page, found in content.items()
        for one in found
    ]
    return blocks, rows


def read_commands(path: Path = TEMPLATES) -> dict[str, str]:
    """Return the command that writes each file, by the file's name."""
    return tomllib.loads(path.read_text(encoding="utf-8"))["commands"]


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
            page = root / block.page
            page.write_text(put(page.read_text(encoding="utf-8"), block.name, block.rendered(measured)), "utf-8")


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


def filled(text: str, files: Mapping[str, Numbers]) -> str:
    """Return a block's text with the figures of its files, in their order."""
    names = _names(files)
    blocks = (_paragraph(lines, names) for lines in re.split(r"\n{2,}", repeated(text)))
    return "\n\n".join(block for block in blocks if block)


def repeated(text: str) -> str:
    """Return a text whose lines after `@` and `@@` are repeated."""
    text = re.sub(
        r"^@@ (.*)\n(@ .*\n.*)$", lambda found: _each(found[1], found[2], "$3", "$4"), text, flags=re.MULTILINE
    )
    return re.sub(r"^@ (.*)\n(.*)$", lambda found: _each(found[1], found[2], "$1", "$2"), text, flags=re.MULTILINE)


def _each(items: str, text: str, key: str, label: str) -> str:
    pairs = (item.partition(" = ") for item in items.split("; "))
    return "\n".join(
        text.replace(key, name).replace(label, title or name.replace("_", " ")) for name, _, title in pairs
    )


def _names(files: Mapping[str, Numbers]) -> dict[str, float | str]:
    """Return numbers and texts by key and by `FILE/KEY`."""
    names: dict[str, float | str] = {}
    for file, numbers in files.items():
        texts = {"sample": sampled(numbers), "limit": limit_option(numbers)} if "clips" in numbers else {}
        found = {**numbers, **texts}
        names |= ({} if names else found) | {f"{file}/{key}": value for key, value in found.items()}
    return names


def _paragraph(text: str, names: Mapping[str, float | str]) -> str:
    """Return lines of prose or of a table with figures; empty if all of them are missing."""
    lines = text.split("\n")
    if not lines[0].startswith("|"):
        return "\n".join(wrapped for line in lines if (wrapped := textwrap.fill(_line(line, names) or "", WIDTH)))
    rows = [row for line in lines[2:] if (row := _row(line, names)) is not None]
    return "\n".join([*lines[:2], *rows]) if rows else ""


def filled_line(line: str, names: Mapping[str, Any]) -> str:
    """Return a line with figures. Raises KeyError if one is missing."""
    return _PLACE.sub(lambda found: format(value_of(found[1], names), found[2] or ""), line)


def _line(line: str, names: Mapping[str, float | str]) -> str | None:
    """Return a line with figures, or None if one is missing."""
    try:
        return filled_line(line, names)
    except KeyError:
        return None


def _row(line: str, names: Mapping[str, float | str]) -> str | None:
    """Return a row with figures, or None if it has places for some and all are missing."""
    cells = [_line(cell, names) for cell in line.split(" | ")]
    if "{" in line and all(one is None for one, cell in zip(cells, line.split(" | "), strict=True) if "{" in cell):
        return None
    return re.sub(r" \| –$", " | – |", " | ".join("–" if cell is None else cell for cell in cells))


def value_of(key: str, names: Mapping[str, Any]) -> Any:
    """Return a number or a text by its key, or the value of an expression. Raises KeyError if one is missing."""
    if key in names:
        return names[key]
    try:
        return eval(key, {"__builtins__": {}}, {**FUNCTIONS, "n": names.__getitem__, **names})
    except (NameError, SyntaxError):  # a missing key may be no expression
        raise KeyError(key) from None


def weights_file(name: str) -> Path:
    """Return the path of a packaged network or card."""
    (path,) = [*ROOT.glob(f"src/bodysense/weights/{name}"), *ROOT.glob(f"packages/lab/src/*/weights/{name}")]
    return path


def hours(seconds: float) -> str:
    """Return seconds as hours with two digits, or whole ones from 10 on."""
    return f"{seconds / 3600:.0f}" if seconds >= 36_000 else f"{seconds / 3600:.2g}"


FUNCTIONS: dict[str, Any] = {  # that expressions may call
    "max": max,
    "min": min,
    "format": format,
    "hours": hours,
    "megabytes": lambda name: weights_file(name).stat().st_size / 1e6,
    "kilobytes": lambda name: weights_file(name).stat().st_size / 1e3,
}


def sampled(numbers: Numbers) -> str:
    """Return the number of clips of figures, as a sample if not all clips were scored."""
    clips, total = f"{numbers['clips']:.0f}", numbers.get("clips_in_split", numbers["clips"])
    some = f"{clips} of {total:.0f} clips" if numbers["clips"] < total else f"{clips} clips"
    if "quick" in numbers:
        return f"a sample, the first seconds of {some} (`--quick`)"
    return f"a sample of {some}" if numbers["clips"] < total else some


def limit_option(numbers: Numbers) -> str:
    """Return the option of a command that scored some of the clips; empty if it scored all."""
    few = numbers["clips"] < numbers.get("clips_in_split", numbers["clips"])
    return f" --limit {numbers['clips']:.0f}" if few else ""
