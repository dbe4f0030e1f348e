"""Tables for the terminal, and numbers as one flat JSON object."""

from __future__ import annotations

import json
import os
import platform
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bodysense.files import written_beside

if TYPE_CHECKING:
    from rich.console import Console

_WIDTH = 160  # characters; width of tables that are not printed to a terminal


def wide_console() -> Console:
    """Return a console that does not fold tables to 80 characters if the output is no terminal."""
    from rich.console import Console

    console = Console()
    return console if console.is_terminal or "COLUMNS" in os.environ else Console(width=_WIDTH)


def write_numbers(path: Path | None, numbers: dict[str, float], *, timed: bool = True) -> None:
    """Write one flat JSON object, if a path is given, with processor name and processor time. NaN values are dropped.

    `timed=False` drops the time, for work that other processes shared.
    """
    if path is not None:
        machine = {"processor": processor()} | ({"cpu_seconds": cpu_seconds()} if timed else {})
        finite = {name: value for name, value in numbers.items() if np.isfinite(value)}
        with written_beside(path) as beside:
            beside.write_text(json.dumps(machine | finite, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def cpu_seconds() -> float:
    """Return the processor time of this process and of its ended children, s."""
    return round(sum(os.times()[:4]), 2)


def processor() -> str:
    """Return the name of the processor, for measured figures."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
