"""Arrays in .npz and .npy files. Sizes are checked before unpacking, and nothing is unpickled."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO

import numpy as np

from bodysense.errors import BodysenseError

FREE = 256 << 20  # bytes to which any archive may unpack
RATIO = 50  # largest ratio of unpacked to packed size, for archives beyond `FREE`
LARGEST = 16 << 30  # bytes; largest size of all arrays together
_HEADER = 1 << 16  # bytes; largest header of an array
_MAGIC = b"\x93NUMPY"


def read_arrays(path: str | Path, keys: Sequence[str] | None = None) -> dict[str, np.ndarray]:
    """Read the arrays of an .npz file, or those of `keys` that it holds.

    Raises BodysenseError if the file is empty or no .npz file, unpacks to far more than its size, holds arrays of
    objects (only unpickling reads them), or announces a shape that its data does not have.
    """
    path = Path(path)
    if path.is_file() and path.stat().st_size == 0:
        raise BodysenseError(f"{path}: the file is empty; copy or export it again")
    try:
        with zipfile.ZipFile(path) as archive:
            entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
            wanted = {key: entries[key] for key in (entries if keys is None else keys) if key in entries}
            check_sizes(path, sum(entry.file_size for entry in wanted.values()), path.stat().st_size)
            arrays = {}
            for key, entry in wanted.items():
                with archive.open(entry) as stream:
                    arrays[key] = _read(stream, entry.file_size, f"{path}: {key!r}", path)
            return arrays
    except FileNotFoundError:
        raise BodysenseError(f"{path}: no such file") from None
    except BodysenseError:
        raise
    except Exception as error:  # damaged zip files raise many kinds: zlib, struct, zipfile, ValueError, MemoryError
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BodysenseError(f"{path}: cannot be read as an .npz file ({reason}); copy or export it again") from error


def read_array(path: str | Path) -> np.ndarray:
    """Read the array of an .npy file. Raises BodysenseError like `read_arrays`."""
    path = Path(path)
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            return _read(stream, size, str(path), path)
    except FileNotFoundError:
        raise BodysenseError(f"{path}: no such file") from None
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror})") from None


def holds_objects(path: str | Path) -> bool:
    """Whether an .npy file is an array of Python's objects."""
    try:
        with Path(path).open("rb") as stream:
            head = stream.read(_HEADER)
        return head.startswith(_MAGIC) and _header(head)[2].hasobject
    except Exception:  # a damaged file; reading it reports the damage
        return False


def object_pickle(path: str | Path) -> bytes:
    """Return the pickle in an .npy file of objects."""
    data = Path(path).read_bytes()
    return data[_header(data[:_HEADER])[3] :]


def array_shapes(path: str | Path) -> dict[str, tuple[int, ...]]:
    """Return the announced shapes of the arrays of an .npz file by name; empty for any other file."""
    shapes: dict[str, tuple[int, ...]] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.infolist():
                with archive.open(entry) as stream:
                    shapes[entry.filename.removesuffix(".npy")] = _header(stream.read(_HEADER))[0]
    except Exception:  # a damaged file; reading it later reports the damage
        return shapes
    return shapes


def check_sizes(place: Path, unpacked: int, packed: int) -> None:
    """Raise BodysenseError for a file of `packed` bytes that unpacks to far more."""
    if unpacked > LARGEST or unpacked > max(FREE, RATIO * packed):
        raise BodysenseError(
            f"{place}: {_size(packed)} that unpack to {_size(unpacked)}; beyond {_size(FREE)} no more than {RATIO} "
            f"times is unpacked, and {_size(LARGEST)} at most: was it made to fill memory? Export it again"
        )


def check_member(place: Path, entry: zipfile.ZipInfo) -> None:
    """Raise BodysenseError for a member of a zip file that unpacks to far more than its packed size."""
    check_sizes(place, entry.file_size, entry.compress_size)


def _read(stream: IO[bytes], size: int, what: str, path: Path) -> np.ndarray:
    """Read one array of the .npy format from `size` bytes; the header is checked before memory is allocated."""
    if size > LARGEST:
        raise BodysenseError(f"{what} has {_size(size)}; at most {_size(LARGEST)} are read: cut it in parts")
    head = stream.read(min(size, _HEADER))
    if not head.startswith(_MAGIC):
        raise BodysenseError(f"{what} is no array of NumPy's; export it again")
    try:
        shape, fortran, dtype, at = _header(head)
    except Exception as error:  # NumPy raises many kinds for a damaged header
        reason = " ".join(str(error).split())[:80]
        raise BodysenseError(f"{what} has a damaged header ({reason}); export it again") from None
    if dtype.hasobject:
        raise BodysenseError(
            f"{what} holds objects of Python, which only unpickling reads, and that may run any code; "
            f"{conversion(path)}"
        )
    count = 1
    for length in shape:
        count *= length
    data = head[at:]
    announced, there = count * dtype.itemsize, size - at
    if announced != there:
        raise BodysenseError(
            f"{what} announces {shape} of {dtype}, {_size(announced)}, but has {_size(there)}; export it again"
        )
    data += stream.read()
    if len(data) != there:
        raise BodysenseError(f"{what} is cut short; copy it again")
    values = np.frombuffer(bytearray(data), dtype=dtype, count=count)
    return values.reshape(shape[::-1]).T if fortran else values.reshape(shape)


def _header(head: bytes) -> tuple[tuple[int, ...], bool, np.dtype, int]:
    """Return shape, order (True: Fortran), type and first byte of the data of an array in the .npy format."""
    start = io.BytesIO(head)
    version = np.lib.format.read_magic(start)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read(start)
    return shape, fortran, dtype, start.tell()


def conversion(path: Path) -> str:
    """Return the fix for a file that only unpickling can read: a command that converts it."""
    if path.suffix in (".npy", ".npz"):
        load = f"r = np.load('{path.name}', allow_pickle=True)"
        load += "; r = r.item()" if path.suffix == ".npy" else ""
    elif path.suffix in (".pt", ".pth"):
        load = f"import torch; r = torch.load('{path.name}', map_location='cpu')"
    else:
        load = f"import joblib; r = joblib.load('{path.name}')"
    keep = "{k: np.asarray(v) for k, v in r.items() if np.asarray(v).dtype != object}"
    return (
        "if you trust it, convert it once: "
        f"python -c \"import numpy as np; {load}; np.savez('{path.stem}_plain.npz', **{keep})\""
    )


def _size(count: int) -> str:
    for unit, name in ((1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")):
        if count >= unit:
            return f"{count / unit:.3g} {name}"
    return f"{count} bytes"
