"""Tables for the terminal, and one flat object of numbers for machines."""

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

_WIDTH = 160  # characters of a table that no terminal shows


def wide_console() -> Console:
    """A console whose tables are not folded to 80 characters where no terminal shows them."""
    from rich.console import Console

    console = Console()
    return console if console.is_terminal or "COLUMNS" in os.environ else Console(width=_WIDTH)


def write_numbers(path: Path | None, numbers: dict[str, float], *, timed: bool = True) -> None:
    """Write one flat JSON object, if a path was given, with the processor and the time on it; NaN is left out.

    `timed=False` leaves out the time, where other processes did part of the work.
    """
    if path is not None:
        machine = {"processor": processor()} | ({"cpu_seconds": cpu_seconds()} if timed else {})
        finite = {name: value for name, value in numbers.items() if np.isfinite(value)}
        with written_beside(path) as beside:
            beside.write_text(json.dumps(machine | finite, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def cpu_seconds() -> float:
    """Processor time of this process and of its children that ended, s."""
    return round(sum(os.times()[:4]), 2)


def processor() -> str:
    """Name of the processor, for measured figures."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
