"""Write the figures of docs/reproduce.md from the numbers that the commands wrote.

    python scripts/reproduce_figures.py FIGURES

FIGURES is the folder that `readme_figures.py` describes. A row whose file is missing stays unchanged.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

from bodysense.cli.show import processor

PAGE = Path(__file__).parents[1] / "docs" / "reproduce.md"
COLUMN = 3  # of a row's cells: its figure
Numbers = dict[str, float]

# Row of the page: the file of its numbers, and its figure.
FIGURES: dict[str, tuple[str, Callable[[Numbers], str]]] = {
    "1.3": ("hidden", lambda n: f"self-contact {100 * n['all_self_contact']:.0f} %"),
    "1.9": ("unoc-table2", lambda n: f"{n['last_known_body_occluded_rmsjpe_cm']:.1f} cm (last known)"),
    "1.10": ("unoc-table2", lambda n: f"GRU {_ratio(n):.2f} of last known, body"),
    "1.12": ("ik", lambda n: f"p50 {n['p50_ms']:.2f} ms ({processor()})"),
    "1.14": (
        "unoc-smoothness",
        lambda n: f"{n['gru_strong_acceleration_percent']:.1f} %, truth {n['truth_strong_acceleration_percent']:.1f} %",
    ),
    "1.15": ("unoc-table6", lambda n: f"all {_pair(n, 'network_all')}"),
    "1.16": ("finger-synthesis", lambda n: _pair(n, "network")),
    "2.10": ("hmd-vae", lambda n: f"{n['model4_full_position_cm']:.2f} cm, model 4"),
}


def main(folder: Path) -> None:
    """Replace the figures whose numbers are in `folder`."""
    text = PAGE.read_text(encoding="utf-8")
    for row, (name, figure) in FIGURES.items():
        path = folder / f"{name}.json"
        if path.is_file():
            text = with_figure(text, row, figure(json.loads(path.read_text(encoding="utf-8"))))
    PAGE.write_text(text, encoding="utf-8")


def with_figure(text: str, row: str, figure: str) -> str:
    """Return the page with another figure in a row. Raises ValueError if the page has no such row."""
    lines = text.split("\n")
    place = next((k for k, line in enumerate(lines) if line.startswith(f"| {row} |")), None)
    if place is None:
        raise ValueError(f"{PAGE}: no row {row}")
    cells = lines[place].strip("| ").split(" | ")
    cells[COLUMN] = figure
    lines[place] = f"| {' | '.join(cells)} |"
    return "\n".join(lines)


def _ratio(numbers: Numbers) -> float:
    gru, known = (numbers[f"{who}_body_occluded_rmsjpe_cm"] for who in ("gru", "last_known"))
    return gru / known


def _pair(numbers: Numbers, key: str) -> str:
    return f"{numbers[f'{key}_rmsjpe_cm']:.1f} / {numbers[f'{key}_mpjpe_cm']:.1f} cm"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
