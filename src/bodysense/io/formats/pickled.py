"""Pickles as dictionaries, lists, numbers and arrays: a reader that builds these and nothing else.

Results of video tools come as pickles of NumPy, joblib or PyTorch (a zip file with a pickle and raw tensors). No code
of the file runs: a pickle names functions to call, and each name is one of a few below, all harmless, or refused.
Sizes of arrays are compared with the bytes that are there, and objects that contain themselves are refused.
"""

from __future__ import annotations

import io
import pickle  # noqa: TID251 - its opcodes; every name is looked up below
import zipfile
import zlib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import IO, Any, ClassVar, NoReturn

import numpy as np

from bodysense.arrays import check_sizes
from bodysense.errors import BodysenseError

ENDINGS = (".pkl", ".pickle", ".pt", ".pth", ".joblib")
_LARGEST = 4 << 30  # bytes; larger files are not results of a motion
_DEEPEST, _MOST = 32, 200_000  # levels and objects of a result that are looked at
_SPREAD = 64  # times by which an expanded tensor may be larger than its numbers
_KINDS = "biufSU"  # of numbers and texts in arrays
_TENSORS = {
    "FloatStorage": "f4",
    "DoubleStorage": "f8",
    "HalfStorage": "f2",
    "LongStorage": "i8",
    "IntStorage": "i4",
    "ShortStorage": "i2",
    "CharStorage": "i1",
    "ByteStorage": "u1",
    "BoolStorage": "?",
}


def read_pickled(path: str | Path) -> Any:
    """Return the content of a pickle: dictionaries, lists, texts, numbers and arrays.

    Raises BodysenseError, naming the file and what it holds, for anything else.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        if size > _LARGEST:
            raise BodysenseError(f"{path}: {size >> 20} MiB is too large for the results of a motion; cut it in parts")
        if zipfile.is_zipfile(path):
            return _plain(_torch(path), path)
        data = path.read_bytes()
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror})") from None
    if data[:1] == b"\x78":  # compressed by joblib
        unpacker = zlib.decompressobj()
        data = unpacker.decompress(data, 64 * size + (1 << 24))
        check_sizes(path, len(data) + (len(unpacker.unconsumed_tail) << 10), size)
    return unpickled(data, path)


def unpickled(data: bytes, path: Path) -> Any:
    """Return the content of a pickle's bytes; `path` names it. Raises as `read_pickled`."""
    return _plain(_load(io.BytesIO(data), path, None), path)


def _load(stream: IO[bytes], path: Path, storage: Callable[[Any], Any] | None) -> Any:
    reader = _Reader(stream, path, storage)
    try:
        return reader.load()
    except BodysenseError:
        raise
    except Exception as error:  # damaged pickles raise many kinds
        reason = f"unknown code {error}" if isinstance(error, KeyError) else " ".join(str(error).split())[:80]
        reason = reason or type(error).__name__
        raise BodysenseError(f"{path}: cannot be read as a pickle ({reason}); copy or export it again") from None


class _Array:
    """An array that is being built."""

    __slots__ = ("value",)

    def __init__(self) -> None:
        self.value: Any = None


class _Call:
    """A harmless function that a pickle may call."""

    __slots__ = ("function",)

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)


class _Reader(pickle._Unpickler):  # in Python, so that the state of every object is set here
    stack: list[Any]
    read: Callable[[int], bytes]
    append: Callable[[Any], None]
    pop_mark: Callable[[], list[Any]]
    dispatch: ClassVar[dict[int, Any]] = dict(pickle._Unpickler.dispatch)

    def __init__(self, stream: IO[bytes], path: Path, storage: Callable[[Any], Any] | None) -> None:
        super().__init__(stream, encoding="latin1")
        self._stream, self._path, self._storage = stream, path, storage

    def find_class(self, module: str, name: str) -> Any:
        """Return a harmless stand-in for a name. Raises BodysenseError for all others."""
        package = module.partition(".")[0]
        if package == "numpy" and name in _NUMPY:
            return _Call(_NUMPY[name])
        if package == "torch":
            if name in _TENSORS:
                return np.dtype(_TENSORS[name])
            if name in ("_rebuild_tensor_v2", "_rebuild_tensor"):
                return _Call(_tensor)
            if name == "_rebuild_parameter":
                return _Call(lambda value, *_: value)
        if (module, name) == ("joblib.numpy_pickle", "NumpyArrayWrapper"):
            return _Wrapper
        if (module, name) in (("collections", "OrderedDict"), ("builtins", "dict"), ("__builtin__", "dict")):
            return _Call(_dictionary)
        if (module, name) == ("_codecs", "encode"):
            return _Call(lambda text, code="latin1": str(text).encode("latin1"))
        raise BodysenseError(
            f"{self._path}: a pickle that holds {module}.{name}, which is no array and may run any code; save its "
            "arrays with numpy.savez, 'poses' (T, 72) and 'trans' (T, 3)"
        )

    def persistent_load(self, pid: Any) -> Any:
        """Return the storage of a tensor."""
        if self._storage is None:
            raise BodysenseError(f"{self._path}: a pickle that refers to other files; export it again")
        return self._storage(pid)

    def load_build(self) -> None:
        """Set the state of an array; nothing else has one."""
        state = self.stack.pop()
        what = self.stack[-1]
        if isinstance(what, _Array) and isinstance(what, _Wrapper):
            kind, shape = state["dtype"], tuple(state["shape"])
            if state.get("numpy_array_alignment_bytes") is not None:
                self._stream.read(self._stream.read(1)[0])
            data = self._stream.read(int(np.prod(shape, dtype=object)) * kind.itemsize)
            self.stack[-1] = _filled(shape, kind, data, state.get("order") == "F")
        elif isinstance(what, _Array):
            _, shape, kind, is_fortran, data = state
            if isinstance(kind, np.dtype) and kind.hasobject:
                what.value = list(data)
            else:
                data = data.encode("latin1") if isinstance(data, str) else data
                what.value = _filled(tuple(shape), kind, data, bool(is_fortran))
        elif isinstance(what, np.dtype):
            if state[1] in (">", "<"):
                self.stack[-1] = what.newbyteorder(state[1])
        elif not isinstance(what, dict):
            _refuse("an object with a state")

    def load_setitem(self) -> None:
        """Set an item of a dictionary by a plain key."""
        value, key = self.stack.pop(), self.stack.pop()
        _check_keys([key])
        self.stack[-1][key] = value

    def load_setitems(self) -> None:
        """Set items of a dictionary by plain keys."""
        items = self.pop_mark()
        _check_keys(items[::2])
        what = self.stack[-1]
        what.update(zip(items[::2], items[1::2], strict=True))

    def load_dict(self) -> None:
        """Build a dictionary with plain keys."""
        items = self.pop_mark()
        _check_keys(items[::2])
        self.append(dict(zip(items[::2], items[1::2], strict=True)))

    def load_buffer(self) -> None:
        """Read a buffer of which all bytes are there."""
        size = int.from_bytes(self.read(8), "little")
        data = self.read(size)
        if len(data) != size:
            _refuse(f"a buffer of {size} bytes, of which {len(data)} are there")
        self.append(data)

    def load_set(self) -> None:
        """Refuse sets, whose members may take forever to hash."""
        _refuse("sets")

    dispatch |= {
        pickle.BUILD[0]: load_build,
        pickle.SETITEM[0]: load_setitem,
        pickle.SETITEMS[0]: load_setitems,
        pickle.DICT[0]: load_dict,
        pickle.EMPTY_SET[0]: load_set,
        pickle.ADDITEMS[0]: load_set,
        pickle.FROZENSET[0]: load_set,
        pickle.BYTEARRAY8[0]: load_buffer,
    }


class _Wrapper(_Array):
    """An array of joblib, whose bytes follow in the stream."""

    __slots__ = ()


def _refuse(what: str) -> NoReturn:
    raise ValueError(f"it holds {what}")


def _check_keys(keys: Sequence[Any]) -> None:
    """Refuse keys other than texts and numbers: nested tuples may take forever to hash."""
    if not all(isinstance(key, (str, bytes, int, float)) for key in keys):
        _refuse("dictionaries whose keys are no texts or numbers")


def _dictionary(pairs: Any = ()) -> dict[Any, Any]:
    """Return a dictionary of pairs with plain keys."""
    pairs = list(pairs.items() if isinstance(pairs, dict) else pairs)
    _check_keys([key for key, _ in pairs])
    return dict(pairs)


def _dtype(code: Any, *_: Any) -> np.dtype:
    kind = np.dtype(str(code))
    if kind.kind not in (*_KINDS, "O") or kind.names:
        _refuse(f"values of type {code}")
    return kind


def _filled(shape: tuple[int, ...], kind: np.dtype, data: bytes, is_fortran: bool) -> np.ndarray:
    count = 1
    for length in shape:
        count *= int(length)
    if kind.hasobject or count < 0 or count * kind.itemsize != len(data):
        _refuse(f"an array of {shape} {kind} in {len(data)} bytes")
    return np.frombuffer(data, kind, count).reshape(shape, order="F" if is_fortran else "C")


def _scalar(kind: np.dtype, data: Any = b"") -> Any:
    return _filled((), kind, data.encode("latin1") if isinstance(data, str) else bytes(data), False).item()


def _from_buffer(data: Any, kind: np.dtype, shape: Any, order: str = "C") -> np.ndarray:
    return _filled(tuple(shape), kind, bytes(data), order == "F")


def _tensor(storage: np.ndarray, offset: int, size: Any, stride: Any, *_: Any) -> np.ndarray:
    size, stride = tuple(map(int, size)), tuple(map(int, stride))
    last = offset + sum((n - 1) * step for n, step in zip(size, stride, strict=True))
    if min((offset, *size, *stride), default=0) < 0 or (0 not in size and last >= storage.size):
        _refuse(f"a tensor of {size} beyond its storage")
    if int(np.prod(size, dtype=object)) > _SPREAD * storage.size:
        _refuse(f"a tensor of {size} of {storage.size} numbers")
    steps = tuple(step * storage.itemsize for step in stride)
    return np.lib.stride_tricks.as_strided(storage[offset:], size, steps, writeable=False)


_NUMPY: dict[str, Callable[..., Any]] = {
    "_reconstruct": lambda *_: _Array(),
    "ndarray": lambda *_: _Array(),
    "dtype": _dtype,
    "scalar": _scalar,
    "_frombuffer": _from_buffer,
}


def _torch(path: Path) -> Any:
    """Return the content of a PyTorch file: a zip file of a pickle and the bytes of its tensors."""
    try:
        with zipfile.ZipFile(path) as archive:
            entries = {entry.filename: entry for entry in archive.infolist()}
            check_sizes(path, sum(entry.file_size for entry in entries.values()), path.stat().st_size)
            main = next((name for name in entries if name.rpartition("/")[2] == "data.pkl"), None)
            if main is None:
                raise BodysenseError(f"{path}: a zip file without the pickle of PyTorch; give an .npz or a motion file")
            folder = main.removesuffix("data.pkl")

            @cache
            def stored(key: str) -> bytes:
                return archive.read(f"{folder}data/{key}")

            def storage(pid: Any) -> np.ndarray:
                _, kind, key, *_ = pid
                data = stored(str(key))
                return np.frombuffer(data, kind, len(data) // kind.itemsize)

            return _load(io.BytesIO(archive.read(main)), path, storage)
    except (zipfile.BadZipFile, KeyError, zlib.error) as error:
        raise BodysenseError(f"{path}: a damaged file of PyTorch ({error}); copy or export it again") from None


def _plain(value: Any, path: Path) -> Any:
    """Return a result without placeholders. Raises BodysenseError if it is deep, endless or of something else."""
    seen = 0

    def plain(one: Any, depth: int) -> Any:
        nonlocal seen
        seen += 1
        if depth > _DEEPEST or seen > _MOST:
            raise BodysenseError(f"{path}: a pickle of more than {_DEEPEST} levels or {_MOST} parts; save its arrays")
        if isinstance(one, _Array):
            return plain(one.value, depth + 1)
        if isinstance(one, dict):
            return {key: plain(part, depth + 1) for key, part in one.items() if isinstance(key, (str, int, float))}
        if isinstance(one, (list, tuple)):
            numbers = all(isinstance(part, (int, float)) for part in one)
            return list(one) if numbers else [plain(part, depth + 1) for part in one]
        return one if isinstance(one, (str, int, float, bool, np.ndarray)) else None

    return plain(value, 0)
