"""Writing files so that they appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bodysense.errors import BodysenseError


def check_place(path: str | Path) -> Path:
    """Return the path of a file to be written; raise BodysenseError, before any work, where it has no place."""
    path = Path(path)
    if not path.parent.is_dir():
        raise BodysenseError(f"{path}: the folder {path.parent} does not exist; create it or choose another")
    if path.is_dir():
        raise BodysenseError(f"{path} is a folder; give the name of a file in it")
    return path


@contextmanager
def written_beside(path: str | Path) -> Iterator[Path]:
    """Give a path beside `path` to write to; it takes the name when the block ends well, and is removed when not.

    Raises BodysenseError where the folder does not exist or cannot be written to.
    """
    path = check_place(path)
    # The ending stays last: writers choose their format by it.
    beside = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield beside
        os.replace(beside, path)
    except OSError as error:
        raise BodysenseError(f"{path} cannot be written ({error.strerror}); choose a place that can") from None
    finally:
        beside.unlink(missing_ok=True)
