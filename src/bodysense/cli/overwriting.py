"""Protection of inputs: no command writes over a file that it reads unless the user allows it."""

from __future__ import annotations

import stat
from collections.abc import Sequence
from pathlib import Path

from bodysense.errors import BodysenseError

FLAG = "--overwrite"
# Options with a file that a command writes; every other file is read.
WRITTEN = ("-o", "--out", "--json", "--csv", "--picture", "--overlay", "--html", "--save-person")


UPDATED = {"--person", "--save-person"}  # with one file for both, the command updates it


def checked_arguments(arguments: Sequence[str]) -> list[str]:
    """Return the arguments of a command without `--overwrite`.

    Raises BodysenseError, unless the flag is given, if a file to be written is also read: by its name, by a symbolic
    or by a hard link. `--person X --save-person X` is allowed.
    """
    if FLAG in arguments:
        return [argument for argument in arguments if argument != FLAG]
    seen: dict[tuple[int, int], tuple[str, str]] = {}  # by identity: name and option
    for before, argument in zip(["", *arguments], arguments, strict=False):
        option, equals, value = argument.partition("=") if argument.startswith("--") else (before, "", argument)
        name = value if equals or not argument.startswith("--") else argument
        identity = _identity(name)
        if identity is None:
            continue
        if identity in seen:
            first, other = seen[identity]
            if (option in WRITTEN or other in WRITTEN) and {option, other} != UPDATED:
                alias = "" if first == name else f" the same file as {first},"
                raise BodysenseError(
                    f"{name}:{alias} both read and written; give the output another name, or add {FLAG}"
                )
        seen[identity] = (name, option) if option in WRITTEN or identity not in seen else seen[identity]
    return list(arguments)


def check_apart(outputs: Sequence[Path], file: Path) -> None:
    """Raise BodysenseError if the name of an output, which an option decides, is that of an input."""
    for out in outputs:
        if _identity(str(out)) is not None and _identity(str(out)) == _identity(str(file)):
            raise BodysenseError(f"{out}: would be written over {file}, which is read; give -o another name")


def _identity(name: str) -> tuple[int, int] | None:
    """Return device and inode of a regular file; None for anything else, and for names without an ending."""
    if not Path(name).suffix:
        return None
    try:
        found = Path(name).stat()
    except (OSError, ValueError):
        return None
    return (found.st_dev, found.st_ino) if stat.S_ISREG(found.st_mode) else None
