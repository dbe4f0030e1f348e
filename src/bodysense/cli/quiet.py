"""`--quiet`, for any command: only warnings are printed, on the error stream."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

QUIET = "--quiet"
_WARNING = "warning"


class _Warnings(io.TextIOBase):
    """A stream that passes warnings to the error stream and drops all other lines."""

    def __init__(self) -> None:
        self._line = ""

    def write(self, text: str, /) -> int:
        *lines, self._line = (self._line + text).split("\n")
        for line in lines:
            if line.lower().startswith(_WARNING):
                print(line, file=sys.stderr)
        return len(text)


@contextmanager
def quietly(on: bool) -> Iterator[None]:
    """Print only warnings while the block lasts, if `on`."""
    if not on:
        yield
        return
    with redirect_stdout(_Warnings()):
        yield
