"""An input is never overwritten, whatever command it is given to, unless the user says so."""

from __future__ import annotations

import stat
from collections.abc import Sequence
from pathlib import Path

from bodysense.errors import BodysenseError

FLAG = "--overwrite"
# Options whose value a command writes; every other file that it is given is read.
WRITTEN = ("-o", "--out", "--json", "--csv", "--picture", "--overlay", "--html", "--junit", "--save-person")


def checked_arguments(arguments: Sequence[str]) -> list[str]:
    """The arguments of a command without `--overwrite`.

    Raises BodysenseError where a file that would be written is another one of them as well, by its name, by a symbolic
    or by a hard link, and that was not said.
    """
    if FLAG in arguments:
        return [argument for argument in arguments if argument != FLAG]
    seen: dict[tuple[int, int], tuple[str, bool]] = {}
    for before, argument in zip(["", *arguments], arguments, strict=False):
        option, equals, value = argument.partition("=") if argument.startswith("--") else (before, "", argument)
        name, written = value if equals or not argument.startswith("--") else argument, option in WRITTEN
        identity = _identity(name)
        if identity is None:
            continue
        if identity in seen and (written or seen[identity][1]):
            other = "" if seen[identity][0] == name else f" the same file as {seen[identity][0]},"
            raise BodysenseError(f"{name}:{other} both read and written; give the output another name, or say {FLAG}")
        seen[identity] = (name, written or seen.get(identity, ("", False))[1])
    return list(arguments)


def check_apart(outputs: Sequence[Path], file: Path) -> None:
    """Raise BodysenseError where a name that follows from an option is that of an input."""
    for out in outputs:
        if _identity(str(out)) is not None and _identity(str(out)) == _identity(str(file)):
            raise BodysenseError(f"{out}: would be written over {file}, which is read; give -o another name")


def _identity(name: str) -> tuple[int, int] | None:
    """What a regular file is known by; None for anything else, and for names without an ending, such as numbers."""
    if not Path(name).suffix:
        return None
    try:
        found = Path(name).stat()
    except (OSError, ValueError):
        return None
    return (found.st_dev, found.st_ino) if stat.S_ISREG(found.st_mode) else None
