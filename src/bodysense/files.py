"""Files: atomic writing, checks of paths before any work, checked reading of text, and compiled libraries."""

from __future__ import annotations

import ctypes
import errno
import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError

LARGEST_TEXT = 1 << 30  # bytes; largest text file that is read
HUGE = 1e9  # larger angles and positions, in any unit, are damaged values
_GZIP = b"\x1f\x8b"
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_ZIP = b"PK\x03\x04"
_LIBRARY_ENDINGS = {"win32": ".dll", "darwin": ".dylib"}  # by `sys.platform`; else .so


def check_place(path: str | Path) -> Path:
    """Return the path of a file to be written. Raises BodysenseError, before any work, if it cannot be written."""
    path = Path(path)
    if not path.parent.is_dir():
        raise BodysenseError(f"{path}: the folder {path.parent} does not exist; create it or choose another")
    if path.is_dir():
        raise BodysenseError(f"{path} is a folder; give the name of a file in it")
    import tempfile

    try:
        with tempfile.TemporaryFile(dir=path.parent):
            return path
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        reason = f"{path} cannot be written ({error.strerror})"
        raise BodysenseError(f"{reason}; choose a folder that you may write to") from None


def check_picture(path: Path) -> None:
    """Raise BodysenseError, before any work, if a picture cannot be written or its name does not end in .png."""
    if path.suffix.lower() != ".png":
        raise BodysenseError(f"{path}: a picture is a PNG; give a name that ends in .png")
    check_place(path)


def check_folder(path: str | Path) -> Path:
    """Return the path of a folder to be made. Raises BodysenseError, before any work, if it cannot be made."""
    path = Path(path)
    nearest = next(place for place in (path, *path.absolute().parents) if place.exists())
    if not nearest.is_dir():
        raise _no_folder(path, f"{nearest} is a file")
    return path


def make_folder(path: str | Path) -> Path:
    """Make a folder and its parents. Raises BodysenseError if it cannot be made."""
    path = check_folder(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _no_folder(path, error.strerror) from None
    return path


def cache_folder() -> Path:
    """Return our folder in the user's cache, for files that can be made or fetched again."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "bodysense"


def _no_folder(path: Path, reason: str | None) -> BodysenseError:
    return BodysenseError(f"{path}: no folder can be made there ({reason}); choose another --out")


def part_beside(path: Path) -> Path:
    """Return the hidden name next to `path` under which this process writes it.

    Remove hidden files of killed processes of this machine.
    """
    import platform
    import shutil

    machine = re.sub(r"[^A-Za-z0-9]", "-", platform.node())
    part = re.compile(rf"\..*\.{machine}\.(?P<process>\d+)\.bodysense-part(\.[^.]*)?")
    for left in path.parent.glob(".*.bodysense-part*"):
        match = part.fullmatch(left.name)
        if match and not _is_running(int(match["process"])):
            with suppress(OSError):  # of another user, or open
                if left.is_dir():
                    shutil.rmtree(left)
                else:
                    left.unlink()
    # The ending stays last: writers choose their format by it.
    return path.with_name(f".{path.stem}.{machine}.{os.getpid()}.bodysense-part{path.suffix}")


@contextmanager
def written_beside(path: str | Path) -> Iterator[Path]:
    """Yield a hidden path next to `path` to write to. It is renamed to `path` if the block succeeds, else removed.

    Raises BodysenseError if the folder does not exist or cannot be written to.
    """
    path = check_place(path)
    beside = part_beside(path)
    try:
        yield beside
        os.replace(beside, path)
    except OSError as error:
        raise BodysenseError(f"{path} cannot be written ({error.strerror}); choose a place that can") from None
    finally:
        beside.unlink(missing_ok=True)


def write_json(path: str | Path, content: Any) -> None:
    """Write a JSON file, whole or not at all. NaN is refused. Raises BodysenseError as `written_beside` does."""
    with written_beside(path) as beside:
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
        beside.write_text(text + "\n", encoding="utf-8")


def read_json(path: str | Path, fix: str, option: str = "") -> Any:
    """Return the value in a JSON file.

    Raises BodysenseError, with the fix and beginning with the `option` that names the file, for any other file.
    """
    name = f"{option} {path}".lstrip()
    try:
        return json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BodysenseError(f"{name} cannot be read ({error.strerror}); {fix}") from None
    except (ValueError, RecursionError) as error:
        raise BodysenseError(f"{name} is not JSON ({error}); {fix}") from None


def json_or_text(text: str) -> Any:
    """Return a field of a network's card, parsed as JSON if possible; other tools write plain text."""
    try:
        return json.loads(text)
    except ValueError:
        return text


def read_bytes(path: str | Path, largest: int = LARGEST_TEXT, fix: str = "cut it in parts") -> bytes:
    """Return the content of a file of at most `largest` bytes.

    Raises BodysenseError if it is larger, with the fix, if it is empty or if it cannot be read.
    """
    try:
        if Path(path).stat().st_size > largest:
            raise BodysenseError(f"{path}: larger than {largest / 2**30:g} GiB; {fix}")
        data = Path(path).read_bytes()
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror})") from None
    if not data:
        raise BodysenseError(f"{path}: the file is empty; copy or export it again")
    return data


def sound(values: np.ndarray) -> np.ndarray:
    """Return the mask of numbers that are finite and at most `HUGE`."""
    with np.errstate(invalid="ignore"):
        return np.abs(values) <= HUGE


def check_plain(head: bytes, place: str | Path) -> None:
    """Raise BodysenseError, with the fix, for the first bytes of a file that is compressed or in UTF-16."""
    name = Path(place).name
    plain = Path(name).stem if name.endswith(".gz") else name
    if head.startswith(_GZIP):
        raise BodysenseError(f"{place}: compressed by gzip; unpack it: gunzip -c {name} > unpacked_{plain}")
    if head.startswith(_ZIP):
        raise BodysenseError(
            f"{place}: a zip file (or a spreadsheet, .xlsx), not text; unpack it, or export it as text"
        )
    for encoding, zeros in (("UTF-16LE", head[1::2]), ("UTF-16BE", head[0::2])):
        if head.startswith(_UTF16) or (len(head) > 3 and zeros.count(0) > 0.8 * len(zeros)):
            of = "UTF-16" if head.startswith(_UTF16) else encoding
            raise BodysenseError(f"{place}: UTF-16; save it as UTF-8: iconv -f {of} -t UTF-8 {name} > utf8_{name}")


def read_text(path: str | Path, other: str | None = None) -> str:
    """Read a text file in UTF-8, with or without a byte order mark.

    `other` is the encoding that is tried if the file is not in UTF-8.

    Raises BodysenseError, naming the fix, for other files, compressed files, and files larger than `LARGEST_TEXT`.
    """
    data = read_bytes(path)
    check_plain(data[:64], path)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        if other is not None:
            return data.decode(other)
        raise BodysenseError(f"{path}: not text in UTF-8; export it again") from None


def natural_order(name: str) -> list[tuple[int, str]]:
    """Return a sort key for names with numbers: P2 before P10."""
    return [(int(part), "") if part.isdigit() else (-1, part.lower()) for part in re.split(r"(\d+)", name)]


def _is_running(process: int) -> bool:
    """Whether a process with this number runs on this machine."""
    if process == os.getpid():
        return True
    if os.name == "nt":  # open files cannot be removed on Windows, and `os.kill` would end the process
        return False
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def load_library(name: str) -> ctypes.CDLL:
    """Load a compiled library of the package, "_core" or "_fbx". Raises BodysenseError, with the fix, if it fails."""
    path = Path(__file__).parent / f"{name}{_LIBRARY_ENDINGS.get(sys.platform, '.so')}"
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        raise BodysenseError(
            f"the compiled library {path} cannot be loaded ({error}); install bodysense with `pip install .`, or run "
            "`python scripts/build_core.py` in a clone"
        ) from None
