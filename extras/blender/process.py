"""The process that completes a take, its progress, and its one-line error. Pure Python."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

from .fault import Fault

_PERCENT = re.compile(r"^(\d{1,3}) %$", re.MULTILINE)


def command(take: str, out: str, python: str = sys.executable) -> list[str]:
    """Return the command that completes a take with Blender's own Python and the wheels of the extension."""
    found = find_spec("bodysense")
    if found is None or found.origin is None:
        raise Fault("the extension's wheels are not installed; use Get Extensions, Install from Disk, with its .zip")
    packages = Path(found.origin).parents[1]
    return [python, str(Path(__file__).with_name("worker.py")), str(packages), take, out]


def environment(given: Mapping[str, str]) -> dict[str, str]:
    """Return environment variables for texts in UTF-8."""
    return {**given, "PYTHONUTF8": "1"}


def progress(printed: str) -> int | None:
    """Return the newest percentage, or None before the first."""
    found = _PERCENT.findall(printed)
    return int(found[-1]) if found else None


def error_line(printed: str, status: int) -> str:
    """Return the one-line error of a failed run."""
    lines = [line.strip() for line in printed.splitlines() if line.strip() and not _PERCENT.match(line)]
    return lines[-1] if lines else f"bodysense ended with status {status} and no message"
