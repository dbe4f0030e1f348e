"""Protection of inputs: no command writes over a file that it reads unless the user allows it."""

from __future__ import annotations

import stat
from collections.abc import Sequence
from pathlib import Path

from bodysense.errors import BodysenseError

FLAG = "--overwrite"
# Options whose file a command writes; every other file is read.
WRITTEN = ("-o", "--out", "--json", "--csv", "--picture", "--overlay", "--html", "--save-person")


UPDATED = {"--person", "--save-person"}  # with one file for both, the command updates it


def check_arguments(arguments: Sequence[str]) -> list[str]:
    """Return the arguments of a command without `--overwrite`.

    Raises BodysenseError if two options write one file, and, without the flag, if an output is also an input, by its
    name, a symbolic link or a hard link. `--person X --save-person X` is allowed.
    """
    _check_outputs_differ(arguments)
    if FLAG in arguments:
        return [argument for argument in arguments if argument != FLAG]
    seen: dict[tuple[int, int], tuple[str, str]] = {}  # by identity: name and option
    for before, argument in zip(["", *arguments], arguments, strict=False):
        option, name = _option_and_value(before, argument)
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
    """Raise BodysenseError if one of the outputs, whose names follow from an option, is the input `file`."""
    for out in outputs:
        if _identity(str(out)) is not None and _identity(str(out)) == _identity(str(file)):
            raise BodysenseError(f"{out}: would be written over {file}, which is read; give -o another name")


def _check_outputs_differ(arguments: Sequence[str]) -> None:
    """Raise BodysenseError if two options name one output, which would be written twice."""
    options: dict[Path, str] = {}
    for before, argument in zip(["", *arguments], arguments, strict=False):
        option, name = _option_and_value(before, argument)
        if option not in WRITTEN or not name or name.startswith("--"):
            continue
        first = options.setdefault(Path(name).absolute(), option)
        if first != option:
            raise BodysenseError(f"{name}: written by {first} and by {option}; give each a name of its own")


def _option_and_value(before: str, argument: str) -> tuple[str, str]:
    """Return the option of an argument and its value, from `--out=a.bvh` or from `--out a.bvh`."""
    option, equals, value = argument.partition("=")
    return (option, value) if equals and argument.startswith("--") else (before, argument)


def _identity(name: str) -> tuple[int, int] | None:
    """Return device and inode of a regular file; None for anything else, and for names without an ending."""
    if not Path(name).suffix:
        return None
    try:
        found = Path(name).stat()
    except (OSError, ValueError):
        return None
    return (found.st_dev, found.st_ino) if stat.S_ISREG(found.st_mode) else None
