"""Python interface of the C core: `bodysense.h` by ctypes, with NumPy arrays. Calls release the GIL."""

from __future__ import annotations

import ctypes
import mmap
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from struct import pack
from typing import Any

import numpy as np

from bodysense.body.person import SENSOR, Person
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import load_library
from bodysense.geometry.rigid import RigidTransform
from bodysense.observing.observation import Observation

VERSION = 1  # BS_VERSION of the header that this module mirrors
POINTS, JOINTS, CONTACTS, LENGTHS = 65, 52, 4, 32
ALIGNMENT = 64  # bytes
HUGE_PAGE = 2**21  # bytes
OK, STATE_FOREIGN, TIME_DISORDERED = 0, 6, 7

_Pointer, _Size = ctypes.c_void_p, ctypes.c_size_t


class Length(ctypes.Structure):
    """`bs_length`."""

    _fields_ = [
        ("start", ctypes.c_int32),
        ("end", ctypes.c_int32),
        ("value", ctypes.c_double),
        ("deviation", ctypes.c_double),
    ]


class Mount(ctypes.Structure):
    """`bs_mount`."""

    _fields_ = [
        ("worn", ctypes.c_uint8),
        ("rotation_only", ctypes.c_uint8),
        ("translation", ctypes.c_double * 3),
        ("rotation", ctypes.c_double * 4),
    ]


class PersonStruct(ctypes.Structure):
    """`bs_person`."""

    _fields_ = [
        ("rest_offset", ctypes.c_double * 3 * POINTS),
        ("deviation", ctypes.c_double * POINTS),
        ("height", ctypes.c_double),
        ("height_deviation", ctypes.c_double),
        ("lengths", ctypes.c_int32),
        ("length", Length * LENGTHS),
        ("mount", Mount * JOINTS),
    ]


class SettingsStruct(ctypes.Structure):
    """`bs_settings`."""

    _fields_ = [
        ("floor", ctypes.c_double),
        ("ease", ctypes.c_double),
        ("longest_gap", ctypes.c_double),
        ("first", ctypes.c_double),
        ("longest", ctypes.c_double),
        ("hold_feet", ctypes.c_int32),
        ("infer", ctypes.c_int32),
    ]


class ObservationStruct(ctypes.Structure):
    """`bs_observation`."""

    _fields_ = [
        ("frames", ctypes.c_int32),
        ("points", ctypes.c_int32),
        ("point", _Pointer),
        ("time", _Pointer),
        ("position", _Pointer),
        ("rotation", _Pointer),
        ("has_position", _Pointer),
        ("has_rotation", _Pointer),
        ("accuracy", _Pointer),
        ("acceleration", _Pointer),
    ]


# Members of `bs_estimate` with their shapes for one frame. All are doubles, except the bytes of `measured`.
ESTIMATE: dict[str, tuple[int, ...]] = {
    "root_position": (3,),
    "rotation": (JOINTS, 4),
    "points": (POINTS, 3),
    "measured": (POINTS,),
    "confidence": (POINTS,),
    "bound": (POINTS,),
    "contact": (CONTACTS,),
    "rest_offset": (POINTS, 3),
}

_FUNCTIONS: dict[str, tuple[Any, Sequence[Any]]] = {
    "bs_version": (ctypes.c_int, ()),
    "bs_message": (ctypes.c_char_p, (ctypes.c_int,)),
    "bs_point_name": (ctypes.c_char_p, (ctypes.c_int,)),
    "bs_model_size": (_Size, (_Pointer, _Size)),
    "bs_model_open": (ctypes.c_int, (_Pointer, _Size, _Pointer, _Size, _Pointer)),
    "bs_model_kernel": (ctypes.c_char_p, (_Pointer,)),
    "bs_person_likeliest": (ctypes.c_int, (_Pointer, _Pointer)),
    "bs_state_size": (_Size, (_Pointer,)),
    "bs_state_start": (ctypes.c_int, (_Pointer, _Pointer, _Pointer, _Size, _Pointer)),
    "bs_state_open": (ctypes.c_int, (_Pointer, _Pointer, _Size, _Pointer)),
    "bs_state_time": (ctypes.c_double, (_Pointer,)),
    "bs_state_person": (None, (_Pointer, _Pointer)),
    "bs_state_contradicts_height": (ctypes.c_int, (_Pointer,)),
    "bs_state_update_person": (ctypes.c_int, (_Pointer, _Pointer, _Pointer)),
    "bs_scratch_size": (_Size, (_Pointer, ctypes.c_int)),
    "bs_step": (
        ctypes.c_int,
        (_Pointer, _Pointer, ctypes.c_int, _Pointer, _Pointer, _Pointer, _Pointer, _Size, _Pointer),
    ),
}


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """Load the compiled core, once. Raises BodysenseError if it was not built or is of another version."""
    loaded = load_library("_core")
    for function, (result, arguments) in _FUNCTIONS.items():
        found = getattr(loaded, function)
        found.restype, found.argtypes = result, list(arguments)
    if loaded.bs_version() != VERSION:
        raise BodysenseError(
            f"the compiled core has version {loaded.bs_version()}, wanted {VERSION}; install bodysense again, "
            "or run `python scripts/build_core.py` in a clone"
        )
    return loaded


def message(result: int) -> str:
    """Return the message of a result code of the core."""
    return library().bs_message(result).decode()


def empty(size: int) -> np.ndarray:
    """Return bytes (size,) at an aligned address; large ones in huge pages, if the system has them.

    A step reads all weights of a model. In pages of 4 kB, that alone would fill the processor's table of pages.
    """
    huge = size >= HUGE_PAGE and hasattr(mmap, "MADV_HUGEPAGE")
    alignment = HUGE_PAGE if huge else ALIGNMENT
    if huge:
        pages = mmap.mmap(-1, size + HUGE_PAGE)
        try:
            pages.madvise(mmap.MADV_HUGEPAGE)
        except OSError:  # a kernel without them
            alignment = ALIGNMENT
        memory = np.frombuffer(pages, np.uint8)
    else:
        memory = np.empty(size + ALIGNMENT, np.uint8)
    start = -address(memory) % alignment
    return memory[start : start + size]


def address(values: np.ndarray) -> int:
    """Return the address of a contiguous, writable array; 0 if it is empty. Faster than `values.ctypes.data`."""
    return ctypes.addressof(ctypes.c_char.from_buffer(values.data)) if values.size else 0


def person_struct(person: Person) -> PersonStruct:
    """Return a person as the core's struct. Raises BodysenseError for more lengths than it takes."""
    if len(person.lengths) > LENGTHS:
        raise BodysenseError(f"person: {len(person.lengths)} lengths are known; give at most {LENGTHS}")
    skeleton, height = person.skeleton, person.height
    one = PersonStruct(
        height=np.nan if height is None else height.value,
        height_deviation=np.nan if height is None else height.deviation,
        lengths=len(person.lengths),
    )
    np.frombuffer(one.rest_offset)[:] = skeleton.rest_offset.ravel()
    np.frombuffer(one.deviation)[:] = person.bone_deviation
    for k, ((start, end), value) in enumerate(person.lengths.items()):
        one.length[k] = Length(skeleton.index(start), skeleton.index(end), value.value, value.deviation)
    for joint, mount in person.mounts.items():
        if not joint.endswith(SENSOR):  # the core does not use mounts of inertial sensors
            one.mount[skeleton.index(joint)] = Mount(1, 0, tuple(mount.translation), tuple(mount.rotation))
    return one


def believed_person(one: PersonStruct, person: Person) -> Person:
    """Return a person with the core's current proportions and the other known properties of `person`."""
    offset = np.frombuffer(one.rest_offset).reshape(POINTS, 3)
    mounts = dict(person.mounts)
    for joint in mounts:
        if not joint.endswith(SENSOR):
            mount = one.mount[default_skeleton().index(joint)]
            mounts[joint] = RigidTransform(np.array(mount.translation), np.array(mount.rotation))
    known: dict[str, Any] = {}
    if not person.is_known:
        known = {"height": None if np.isnan(one.height) else person.height, "lengths": person.lengths}
    return Person(
        person.skeleton.with_offsets(offset),
        bone_deviation=np.frombuffer(one.deviation).copy(),
        mounts=mounts,
        hands=person.hands,
        **known,
    )


class Model:
    """A completion network, open in the core's memory. Threads may share it."""

    def __init__(self, weights: bytes, name: str) -> None:
        """Open the bytes of a weights file. Raises BodysenseError, beginning with `name`, for any other bytes."""
        core = library()
        size = core.bs_model_size(weights, len(weights))
        self._memory, pointer = empty(size), _Pointer()
        result = core.bs_model_open(weights, len(weights), address(self._memory), size, ctypes.byref(pointer))
        if result != OK:
            raise BodysenseError(f"{name}: {message(result)}")
        self.pointer = pointer
        self.state_size: int = core.bs_state_size(pointer)
        self._scratch = threading.local()  # scratch memory of each thread

    @property
    def kernel(self) -> str:
        """Name of the matrix kernel in use."""
        return library().bs_model_kernel(self.pointer).decode()

    def start(self, person: Person) -> np.ndarray:
        """Return the state (N,) uint8 before the first frame of a person."""
        memory = empty(self.state_size)
        result = library().bs_state_start(
            self.pointer, ctypes.byref(person_struct(person)), address(memory), len(memory), ctypes.byref(_Pointer())
        )
        if result != OK:
            raise BodysenseError(f"person: {message(result)}")
        return memory

    def opened(self, stored: bytes) -> np.ndarray:
        """Return a stored state. Raises BodysenseError for any other bytes, and for a state of another model."""
        memory = empty(len(stored))
        memory[:] = np.frombuffer(stored, np.uint8)
        result = library().bs_state_open(self.pointer, address(memory), len(memory), ctypes.byref(_Pointer()))
        if result != OK:
            raise BodysenseError(f"tracker state: {message(result)}")
        return memory

    def person(self, state: np.ndarray, person: Person) -> Person:
        """Return the person of a state as inferred so far; `person` is the one with whom it was started."""
        one = PersonStruct()
        library().bs_state_person(address(state), ctypes.byref(one))
        return believed_person(one, person)

    def updated(self, state: np.ndarray, person: Person) -> np.ndarray:
        """Return the state with new known properties of its person."""
        after = copied(state)
        one = person_struct(person)
        result = library().bs_state_update_person(self.pointer, address(after), ctypes.byref(one))
        if result != OK:
            raise BodysenseError(f"person: {message(result)}")
        return after

    def step(
        self,
        settings: SettingsStruct,
        observations: Sequence[Observation],
        states: Sequence[np.ndarray],
        outputs: Outputs | None = None,
        after: tuple[np.ndarray, ...] | None = None,
    ) -> tuple[int, int, Outputs, tuple[np.ndarray, ...]]:
        """Complete the next T frames of B people.

        `outputs` and `after` are memory of estimates and states that is written to; `after` may be `states`. New memory
        is used if they are omitted. Returns a result code, the index of the person whom it concerns, estimates, and the
        states after the frames.
        """
        people, frames = len(observations), len(observations[0])
        structs, _keep = _observations(observations)
        made = outputs or Outputs.of(people, frames)
        for k, state in enumerate(states):
            if len(state) != self.state_size:
                return STATE_FOREIGN, k, made, tuple(states)
        after = after or tuple(empty(self.state_size) for _ in states)
        for own, state in zip(after, states, strict=True):
            if own is not state:
                own[:] = state
        (scratch, size, _), refused = self._scratch_for(people), ctypes.c_int()
        result = library().bs_step(
            self.pointer,
            ctypes.byref(settings),
            people,
            structs,
            (_Pointer * people)(*map(address, after)),
            made.structs,
            scratch,
            size,
            ctypes.byref(refused),
        )
        return result, refused.value, made, after

    def _scratch_for(self, people: int) -> tuple[int, int, np.ndarray]:
        """Return address, bytes and memory of this thread's scratch for a step of `people` people."""
        own: tuple[int, int, np.ndarray] | None = getattr(self._scratch, "largest", None)
        if own is None or people > self._scratch.people:
            memory = empty(library().bs_scratch_size(self.pointer, people))
            own = self._scratch.largest = (address(memory), len(memory), memory)
            self._scratch.people = people
        return own


def time_of(state: np.ndarray) -> float:
    """Return the time (s) of the last frame of a state; NaN before the first."""
    return library().bs_state_time(address(state))


def contradicts_height(state: np.ndarray) -> bool:
    """Whether the head was higher than the known height allows, so that the height is inferred now."""
    return bool(library().bs_state_contradicts_height(address(state)))


def copied(state: np.ndarray) -> np.ndarray:
    """Return a copy of a state."""
    memory = empty(len(state))
    memory[:] = state
    return memory


def _observations(observations: Sequence[Observation]) -> tuple[ctypes.Array, list[Any]]:
    """Return structs of observations (T, P, …), and the memory to which they point, which must outlive them."""
    rows, keep = [], []
    for one in observations:
        frames, points = one.has_position.shape
        point, names = _point_indices(one.points)
        block = one.block
        if block is not None:
            first, number = address(block[0]), 8 * frames * points
            masks = ctypes.addressof(ctypes.c_char.from_buffer(block[1]))
            fields = (
                first + 8 * number,
                first,
                first + 3 * number,
                masks,
                masks + frames * points,
                first + 7 * number,
                None,
            )
            keep.append((block, names))
        else:
            numbers = (one.time, one.position, one.rotation, one.accuracy, one.acceleration)
            masks = (one.has_position, one.has_rotation)
            arrays = [None if values is None else np.ascontiguousarray(values, np.float64) for values in numbers]
            arrays += [np.ascontiguousarray(values, np.bool_) for values in masks]
            time, position, rotation, accuracy, acceleration, has_position, has_rotation = (
                None if one is None else address(one) if one.flags.writeable else one.ctypes.data for one in arrays
            )
            fields = (time, position, rotation, has_position, has_rotation, accuracy, acceleration)
            keep.append((arrays, names))
        rows.append(ObservationStruct(frames, points, point, *fields))
    return (ObservationStruct * len(rows))(*rows), keep


@dataclass(frozen=True, eq=False)
class Outputs:
    """Memory of the estimates of B people in T frames."""

    shape: tuple[int, int]  # B and T
    memory: np.ndarray  # (B, N) bytes of each person
    structs: bytes  # `bs_estimate` of each person: 8 pointers

    @classmethod
    def of(cls, people: int, frames: int) -> Outputs:
        """Return new memory."""
        _, starts, size = _layout(frames)
        memory = np.empty((people, size), np.uint8)
        first = address(memory)
        pointers = [row + start for row in range(first, first + people * size, size) for start in starts]
        return cls((people, frames), memory, pack(f"{len(pointers)}P", *pointers))

    @cached_property
    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays (B, T, …) by the names of `ESTIMATE`."""
        parts, _, size = _layout(self.shape[1])
        return {
            name: np.ndarray((self.shape[0], *shape), kind, self.memory, start, (size, *strides))
            for name, kind, start, shape, strides in parts
        }

    @cached_property
    def of_first(self) -> dict[str, np.ndarray]:
        """Arrays (T, …) of the first person."""
        memory = self.memory
        return {
            name: np.ndarray(shape, kind, memory, start) for name, kind, start, shape, _ in _layout(self.shape[1])[0]
        }


_Part = tuple[str, np.dtype, int, tuple[int, ...], tuple[int, ...]]


@lru_cache(maxsize=16)
def _layout(frames: int) -> tuple[list[_Part], list[int], int]:
    """Return the members of `ESTIMATE` in the memory of T frames, their starts, and the bytes of that memory.

    A part is a name, kind, start (bytes), shape (T, …) and strides (bytes).
    """
    parts, size = [], 0
    for name, shape in ESTIMATE.items():
        like = np.empty((frames, *shape), np.bool_ if name == "measured" else np.float64)
        parts.append((name, like.dtype, size, like.shape, like.strides))
        size += -(-like.nbytes // 8) * 8
    return parts, [start for _, _, start, _, _ in parts], size


@lru_cache(maxsize=256)
def _point_indices(points: tuple[str, ...]) -> tuple[int, np.ndarray]:
    """Return the address of the core's indices (P,) of points, and their memory.

    Raises BodysenseError for unknown points.
    """
    indices = default_skeleton().indices(points).astype(np.int32)
    return address(indices), indices
