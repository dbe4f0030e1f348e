"""The figures of docs/reproduce.md: cells of tables of other pages, lines of model cards, and settings of the code.

`tables.toml` has a template for each row, in which `at(BLOCK, COLUMN, LABEL, …)` is a cell.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from inspect import signature
from pathlib import Path
from typing import Any

from bodysense.body.arms import HAND_POINTS
from bodysense.body.hands.glove import ALIGNMENT, MARKERS
from bodysense.body.hands.hand import FREEDOMS
from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.headset_camera import HeadsetCamera
from bodysense_lab.commands.paper_bodies import generate
from bodysense_lab.papers.hmd_vae.frames import HELD_OUT, TRAIN_LENGTH
from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig
from bodysense_lab.papers.pahmt.options import ArmNetworkConfig, ArmSchedule
from bodysense_lab.papers.two_hands.system import SETTINGS
from bodysense_lab.papers.two_hands.task import PAPER_JOINT_SCHEDULE
from bodysense_lab.papers.unoc.network.losses import LossWeights
from bodysense_lab.papers.unoc.network.network import PAPER
from bodysense_lab.papers.unoc.task import BodySchedule

from .tables import ROOT, filled_line, weights_file

PAGE = Path("docs") / "reproduce.md"
COLUMN, HOURS_COLUMN = 3, 7  # of a row's cells: its figure, and the hours of its training
_BLOCK = re.compile(r"<!-- begin (\S+) -->\n(.*?)<!-- end \1 -->", re.DOTALL)
_PROCESSOR = re.compile(r"^Processor: (.*?)(?:; (\S+) CPU hours)?\.$", re.MULTILINE)
CODE: dict[str, Any] = {  # settings of the code, by their names in templates
    "CAMERA": HeadsetCamera(),
    "LOSSES": LossWeights(),
    "SCHEDULE": BodySchedule(),
    "VAE": BodyVaeConfig(),
    "ARMS": ArmNetworkConfig(),
    "ARM_LOSSES": ArmSchedule(),
    "PAPER": PAPER,
    "PAPER_JOINT_SCHEDULE": PAPER_JOINT_SCHEDULE,
    "SETTINGS": SETTINGS,
    "BODY": BODY,
    "HAND_POINTS": HAND_POINTS,
    "MARKERS": MARKERS,
    "ALIGNMENT": ALIGNMENT,
    "FREEDOMS": FREEDOMS,
    "HELD_OUT": HELD_OUT,
    "TRAIN_LENGTH": TRAIN_LENGTH,
    "generate": generate,
    "float": float,
    "len": len,
    "str": str,
}


def write_rows(rows: Mapping[str, Mapping[str, str]], root: Path = ROOT) -> None:
    """Replace the figures of all rows."""
    page = root / PAGE
    page.write_text(with_figures(page.read_text(encoding="utf-8"), rows, root), encoding="utf-8")


def with_figures(text: str, rows: Mapping[str, Mapping[str, str]], root: Path = ROOT) -> str:
    """Return the page with the figures that the tables have now. Raises ValueError for a missing row or cell."""
    blocks = {
        name: body
        for path in sorted((root / "docs").rglob("*.md"))
        for name, body in _BLOCK.findall(path.read_text(encoding="utf-8"))
    }
    names = names_of(blocks)
    for row, template in rows["figures"].items():
        text = with_figure(text, row, filled_line(template, names))
    for row, block in rows["blocks"].items():
        text = with_figure(text, row, cell_of(blocks[block], "CPU hours"), HOURS_COLUMN)
    for row, training in rows["trainings"].items():
        if f"`{training}`" in blocks["hours"]:
            text = with_figure(text, row, cell_of(blocks["hours"], "CPU hours", f"`{training}`"), HOURS_COLUMN)
    return text


def names_of(blocks: Mapping[str, str]) -> dict[str, Any]:
    """Return what the templates of rows may name."""

    def at(block: str, column: str, *labels: str, head: str | None = None) -> str:
        return cell_of(blocks[block], column, *labels, head=head)

    def text(block: str, pattern: str) -> str:
        return re.findall(pattern, blocks[block].replace("\n", " "))[0]

    def change(block: str, column: str, *labels: str) -> str:
        """Return what a cell has in brackets, or the cell if it has none."""
        cell = at(block, column, *labels)
        return re.findall(r"\((.*)\)", cell)[0] if "(" in cell else cell

    def span(block: str, last: str, *labels: str) -> str:
        return f"{at(block, '0.1 s', *labels)} to {at(block, last, *labels)} cm"

    return CODE | {"at": at, "text": text, "change": change, "span": span, "card": card, "default": default}


def cell_of(block: str, column: str, *labels: str, head: str | None = None) -> str:
    """Return the cell of the first row that begins with labels, or a block's processor or CPU hours.

    `head` is the first heading of the row's table, None any. Raises ValueError.
    """
    if column == "processor":
        return _PROCESSOR.findall(block)[-1][0]
    if column == "CPU hours" and not labels:
        return _PROCESSOR.findall(block)[-1][1] or "–"
    for table in re.findall(r"(?:^\|.*\n)+", block, re.MULTILINE):
        heads, _, *rows = ([cell.strip() for cell in line[1:-1].split("|")] for line in table.splitlines())
        for row in rows:
            if column in heads and head in (None, heads[0]) and tuple(row[: len(labels)]) == labels:
                return row[heads.index(column)]
    raise ValueError(f"no cell {column!r} of {labels}")


def with_figure(text: str, row: str, figure: str, column: int = COLUMN) -> str:
    """Return the page with another figure in a row. Raises ValueError if the page has no such row."""
    lines = text.split("\n")
    place = next((k for k, line in enumerate(lines) if line.startswith(f"| {row} |")), None)
    if place is None:
        raise ValueError(f"{PAGE}: no row {row}")
    cells = lines[place].strip("| ").split(" | ")
    cells[column] = figure
    lines[place] = f"| {' | '.join(cells)} |"
    return "\n".join(lines)


def card(name: str, pattern: str) -> str:
    """Return the first match of a pattern in a model card."""
    return re.findall(pattern, weights_file(name).read_text(encoding="utf-8"))[0]


def default(command: Callable[..., None], option: str) -> object:
    """Return the default of a command's option."""
    return signature(command).parameters[option].default
