"""Tables for the terminal, and numbers as one flat JSON object."""

from __future__ import annotations

import os
import platform
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bodysense.files import write_json

if TYPE_CHECKING:
    from rich.console import Console

_WIDTH = 160  # characters; width of tables that are not printed to a terminal
_UNITS = {  # vector units, and the flags by which Linux names them on x86 and ARM
    "AVX2": {"avx2"},
    "AVX-512": {"avx512f"},
    "VNNI": {"avx512_vnni", "avx_vnni"},
    "bf16": {"avx512_bf16", "amx_bf16", "bf16"},
    "dot products": {"asimddp"},
}


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
        write_json(path, machine | finite)


def cpu_seconds() -> float:
    """Return the processor time of this process and of its ended children, s."""
    return round(sum(os.times()[:4]), 2)


def processor(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """Return the processor's name and the vector units that measured speeds depend on, such as `AMD EPYC (AVX2, VNNI)`.

    A name alone says little: processors of one name differ in units, and so by a factor of two in speed.
    """
    try:
        text = cpuinfo.read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or platform.machine()
    fields = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in text.splitlines())}
    name = fields.get("model name") or platform.processor() or platform.machine()
    flags = set((fields.get("flags") or fields.get("Features") or "").split())
    units = [unit for unit, names in _UNITS.items() if flags & names]
    return f"{name} ({', '.join(units)})" if units else name
