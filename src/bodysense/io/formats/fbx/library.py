"""Python interface of `core/fbx/fbx.c`, a C library that reads FBX files with ufbx, by ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import load_library

MOST_NODES = 5000
IS_BONE, IS_EMPTY, IS_SKINNED, HAS_BIND = 1, 2, 4, 8  # flags of nodes
TRANSFORM = 10  # translation (3), rotation wxyz (4), scale (3)
_NODE, _STACK, _SKIN = 0, 1, 2  # kinds of names
_MESSAGE = 200  # bytes
_Pointer, _Size = ctypes.c_void_p, ctypes.c_size_t


class _About(ctypes.Structure):
    """`bs_fbx_about`."""

    _fields_ = [
        ("unit", ctypes.c_double),
        ("rate", ctypes.c_double),
        ("axes", ctypes.c_int32 * 3),
        ("nodes", ctypes.c_uint32),
        ("stacks", ctypes.c_uint32),
        ("skins", ctypes.c_uint32),
    ]


@lru_cache(maxsize=1)
def _library() -> Any:
    """Return the compiled library. Raises BodysenseError with the fix if it is missing."""
    library = load_library("_fbx")
    library.bs_fbx_open.restype = _Pointer
    library.bs_fbx_open.argtypes = [_Pointer, _Size, ctypes.c_char_p, _Size]
    library.bs_fbx_close.argtypes = [_Pointer]
    library.bs_fbx_describe.argtypes = [_Pointer, ctypes.POINTER(_About)]
    library.bs_fbx_name.restype = ctypes.c_char_p
    library.bs_fbx_name.argtypes = [_Pointer, ctypes.c_int, ctypes.c_uint32]
    library.bs_fbx_nodes.argtypes = [_Pointer, *[_Pointer] * 4]
    library.bs_fbx_skin.argtypes = [_Pointer, ctypes.c_uint32, _Pointer]
    library.bs_fbx_stack.argtypes = [_Pointer, ctypes.c_uint32, _Pointer, _Pointer]
    library.bs_fbx_bake.argtypes = [
        *(_Pointer, ctypes.c_uint32, _Pointer, _Size, ctypes.c_double, ctypes.c_double, _Size, _Pointer)
    ]
    for name in ("close", "describe", "nodes", "skin", "stack", "bake"):
        getattr(library, f"bs_fbx_{name}").restype = None
    return library


@dataclass(frozen=True, eq=False)
class FbxFile:
    """An open FBX file; use `opened`. Node 0 is the root of the scene."""

    handle: int

    @cached_property
    def _about(self) -> _About:
        about = _About()
        _library().bs_fbx_describe(self.handle, ctypes.byref(about))
        return about

    @property
    def unit(self) -> float:
        """Metres of one unit of the file."""
        return float(self._about.unit)

    @property
    def rate(self) -> float:
        """Frames a second."""
        return float(self._about.rate)

    @property
    def axes(self) -> tuple[int, int, int]:
        """Directions of right, up and front: 0 x, 1 -x, 2 y, 3 -y, 4 z, 5 -z, 6 unknown."""
        right, up, front = self._about.axes
        return right, up, front

    @property
    def count(self) -> int:
        """Number of nodes, the root of the scene included."""
        return int(self._about.nodes)

    @property
    def stacks(self) -> list[str]:
        """Names of the animations."""
        return self._names(_STACK, self._about.stacks)

    @property
    def skins(self) -> list[str]:
        """Names of the skinned meshes."""
        return self._names(_SKIN, self._about.skins)

    @property
    def names(self) -> list[str]:
        """Names of the nodes."""
        return self._names(_NODE, self.count)

    def _names(self, kind: int, count: int) -> list[str]:
        name = _library().bs_fbx_name
        return [name(self.handle, kind, k).decode("utf-8", errors="replace") for k in range(count)]

    @cached_property
    def nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Parents (N,), flags (N,), resting transforms (N, 10) and world matrices in the bind pose (N, 3, 4)."""
        parents, flags = np.empty(self.count, "i4"), np.empty(self.count, "u1")
        rest, bind = np.empty((self.count, TRANSFORM)), np.empty((self.count, 3, 4))
        _library().bs_fbx_nodes(self.handle, *(array.ctypes.data for array in (parents, flags, rest, bind)))
        return parents, flags, rest, bind

    def carriers(self, skin: int) -> np.ndarray:
        """Return (N,) bool: nodes that carry a skin."""
        found = np.zeros(self.count, "u1")
        _library().bs_fbx_skin(self.handle, skin, found.ctypes.data)
        return found.astype(bool)

    def stack(self, stack: int) -> tuple[np.ndarray, float, float]:
        """Return (N,) bool: nodes that an animation moves; and its first and last time in seconds."""
        moved, span = np.zeros(self.count, "u1"), np.zeros(2)
        _library().bs_fbx_stack(self.handle, stack, moved.ctypes.data, span.ctypes.data)
        return moved.astype(bool), float(span[0]), float(span[1])

    def baked(self, stack: int, nodes: np.ndarray, begin: float, step: float, frames: int) -> np.ndarray:
        """Return local transforms (T, n, 10) of some nodes at `begin` + k · `step` seconds."""
        index = np.ascontiguousarray(nodes, "i4")
        out = np.empty((frames, len(index), TRANSFORM))
        at = (index.ctypes.data, len(index), begin, step, frames, out.ctypes.data)
        _library().bs_fbx_bake(self.handle, stack, *at)
        return out


@contextmanager
def opened(data: bytes, path: Path) -> Iterator[FbxFile]:
    """Open the bytes of a file; `path` names it. Raises BodysenseError if it is not FBX, damaged or too large."""
    library, message = _library(), ctypes.create_string_buffer(_MESSAGE)
    handle = library.bs_fbx_open(data, len(data), message, len(message))
    if not handle:
        reason = message.value.decode("utf-8", errors="replace").replace("\n", " ")
        raise BodysenseError(
            f"{path}: this FBX file cannot be read, or is damaged ({reason}); export it again, the skeleton alone"
        )
    try:
        file = FbxFile(handle)
        if file.count > MOST_NODES:
            raise BodysenseError(f"{path}: {file.count} nodes, more than {MOST_NODES}; export the skeleton alone")
        yield file
    finally:
        library.bs_fbx_close(handle)
