"""Command lines of `bodysense`, the progress that it prints, and its one-line error. Pure Python."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from .fault import Fault

LONGEST_MISSING = 30_000  # characters: Windows takes command lines of 32,767
_COLOUR = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
_PERCENT = re.compile(r"(\d{1,3})%")


def launcher(path: str, installed: str | None, uvx: str | None, source: str) -> list[str]:
    """Return the words that start bodysense.

    Args:
        path: the program of the preferences, or empty.
        installed: the program `bodysense` on the PATH, if any.
        uvx: the program `uvx` on the PATH, if any.
        source: what `uvx --from` installs, a folder or an address; or empty.
    """
    if path:
        return [path]
    if installed is not None:
        return [installed]
    if uvx is not None and source:
        return [uvx, "--from", source, "bodysense"]
    raise Fault(
        "bodysense is not on the PATH; in the add-on's preferences, give its program, or a source for uvx if uvx is "
        "installed"
    )


def fill_command(start: Sequence[str], take: str, out: str, missing: str) -> list[str]:
    """Return the command that fills holes of a take."""
    if len(missing) > LONGEST_MISSING:
        raise Fault("the holes are too many for one command; fill a shorter range of frames, or selected bones")
    return [*start, "track", take, "-o", out, "--missing", missing]


def complete_command(start: Sequence[str], take: str, out: str, device: str) -> list[str]:
    """Return the command that completes a take from the points that a device tracks."""
    return [*start, "track", take, "-o", out, "--device", device, "--rig", "source"]


def environment(given: Mapping[str, str]) -> dict[str, str]:
    """Return environment variables that make bodysense print its progress without a terminal."""
    return {**given, "FORCE_COLOR": "1", "COLUMNS": "100", "PYTHONUTF8": "1"}


def progress(printed: str) -> int | None:
    """Return the newest percentage of a progress bar, or None before the first."""
    found = _PERCENT.findall(_COLOUR.sub("", printed))
    return int(found[-1]) if found else None


def error_line(printed: str, status: int) -> str:
    """Return the one-line error of a failed run."""
    lines = [line.strip() for line in _COLOUR.sub("", printed).splitlines() if line.strip()]
    return lines[-1] if lines else f"bodysense ended with status {status} and no message"
