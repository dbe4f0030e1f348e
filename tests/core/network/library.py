"""The core's networks through ctypes: functions that its public header does not have."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

SOURCES = Path(__file__).parents[3] / "core" / "src"
PARTS = (
    "base/kinematics",
    "products/matrix",
    *(f"network/{part}" for part in ("model", "tracked", "features", "layers", "network", "fingers", "errors")),
)
FLAGS = ("-std=c11", "-O1", "-ffp-contract=off", "-fno-math-errno")
BODY_POINTS, JOINTS, HAND_POINTS = 25, 22, 40

TRACKED = np.dtype(
    [
        ("base", "<f8", 3),
        ("interval", "<f4"),
        ("floor", "<f4"),
        ("has_position", "?", 65),
        ("has_rotation", "?", 52),
        ("implied", "?", 52),
        ("position", "<f4", (65, 3)),
        ("rotation", "<f4", (52, 3, 3)),  # axis by axis
        ("knuckle", "<f4", (2, 4, 3)),
        ("has_knuckles", "?", 2),
        ("stands_in", "?", 4),
        ("waning", "<f4"),
        ("at_once", "?"),
        ("accuracy", "<f4", 65),
        ("acceleration", "<f4", (22, 3)),
        ("has_acceleration", "?", 22),
        ("rest_offset", "<f4", (65, 3)),
        ("deviation", "<f4", 65),
    ],
    align=True,
)
FRAME = np.dtype([("origin", "<f4", 3), ("cosine", "<f4"), ("sine", "<f4")], align=True)
PREDICTION = np.dtype(
    [
        ("rotation", "<f4", (22, 3, 3)),
        ("head", "<f4", 3),
        ("contact", "<f4", 4),
        ("error", "<f4", BODY_POINTS),
        ("unlike", "<f4", JOINTS),
        ("missed", "<f4"),
    ],
    align=True,
)
BODY = np.dtype([("rotation", "<f4", (52, 3, 3)), ("point", "<f4", (65, 3))], align=True)


def compiled(folder: Path, command: Sequence[str] = ("cc",), flags: Sequence[str] = FLAGS) -> Path:
    """Compile the networks and return the shared library."""
    out = folder / "networks.so"
    sources = [str(SOURCES / f"{part}.c") for part in PARTS]
    subprocess.run([*command, *flags, "-fPIC", "-shared", *sources, "-lm", "-o", str(out)], check=True)
    return out


def aligned(size: int) -> np.ndarray:
    """Zeros (size,) of bytes at a multiple of 64."""
    whole = np.zeros(size + 64, np.uint8)
    first = -whole.ctypes.data % 64
    return whole[first : first + size]


@dataclass(frozen=True, eq=False)
class NetworkLibrary:
    """An open model of a compiled library."""

    library: ctypes.CDLL
    model: ctypes.c_void_p
    memory: np.ndarray

    def __call__(self, name: str, *arguments: Any, result: Any = ctypes.c_size_t) -> Any:
        """Call a function; arrays are passed by their address."""
        function = getattr(self.library, name)
        function.restype = result
        return function(*(_passed(argument) for argument in arguments))

    def predict(self, seen: np.ndarray, memory: np.ndarray, scratch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frames under the head and predictions of B people, whose memory (B, M) advances."""
        count = len(seen)
        frame, out = np.zeros(count, FRAME), np.zeros(count, PREDICTION)
        self("predict_bodies", self.model, count, seen, frame, _rows(memory), out, scratch, result=None)
        return frame, out

    def fingers(
        self, seen: np.ndarray, frame: np.ndarray, body: np.ndarray, memory: np.ndarray, scratch: np.ndarray
    ) -> np.ndarray:
        """Complete the hands of bodies (B,) in place and return expected errors (B, 40) m."""
        error = np.zeros((len(seen), HAND_POINTS), np.float32)
        self("complete_fingers", self.model, len(seen), seen, frame, body, _rows(memory), error, scratch, result=None)
        return error

    def errors(
        self, seen: np.ndarray, predicted: np.ndarray, fingers: np.ndarray, off: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Expected errors and bounds (65,) m of one person."""
        confidence, bound = np.zeros(65, np.float32), np.zeros(65, np.float32)
        self("expected_errors", self.model, seen, predicted, fingers, off, confidence, bound, result=None)
        return confidence, bound

    def start(self, people: int) -> tuple[np.ndarray, np.ndarray]:
        """Memories (B, M) before the first frame, and scratch."""
        memory = np.full((people, self("network_memory", self.model)), np.nan, np.float32)
        for row in memory:
            self("network_start", self.model, row, result=None)
        return memory, aligned(self("network_scratch", self.model, people))


def open_library(path: Path, file: bytes) -> tuple[int, NetworkLibrary | None]:
    """The result of opening a model, and the model."""
    library = ctypes.CDLL(str(path))
    library.bs_model_size.restype = ctypes.c_size_t
    size = library.bs_model_size(file, ctypes.c_size_t(len(file)))
    memory, model = aligned(size), ctypes.c_void_p()
    result = library.bs_model_open(
        file, ctypes.c_size_t(len(file)), _passed(memory), ctypes.c_size_t(size), ctypes.byref(model)
    )
    return result, NetworkLibrary(library, model, memory) if result == 0 else None


def _rows(memory: np.ndarray) -> Any:
    return (ctypes.c_void_p * len(memory))(*(row.ctypes.data for row in memory))


def _passed(argument: Any) -> Any:
    if not isinstance(argument, np.ndarray):
        return argument
    assert argument.flags.c_contiguous
    return ctypes.c_void_p(argument.ctypes.data)


def filled(dtype: np.dtype, count: int, values: Mapping[str, Any]) -> np.ndarray:
    """Structures (count,) with these members."""
    out = np.zeros(count, dtype)
    for name, value in values.items():
        out[name] = value
    return out
