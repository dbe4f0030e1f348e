"""BVH files written frame by frame, and BVH files whose numbers are edited in place.

`BvhStream` writes motion that is too long to keep in memory. `BvhLines` is a file as written: every number keeps its
text until it is replaced, and all other bytes are unchanged. `io.bvh_text` parses the same format without editing.
"""

from __future__ import annotations

import re
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TextIO

import numpy as np

from bodysense.body.gaps import runs
from bodysense.body.pose import Pose
from bodysense.body.rotation import euler_to_quaternion, quaternion_canonical, quaternion_to_euler, slerp, swing_twist
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.files import check_plain, read_bytes, sound, written_beside
from bodysense.io.bvh import hierarchy_text, motion_text
from bodysense.io.bvh_text import parse_bvh, with_plain_nan

_UNIT, _ORDER = 0.01, "ZXY"  # units and channel order of `write_bvh`
_DIGITS = 12  # of the number of frames, which is written last
_SAME = 1e-4  # frames; Unix times are exact to 3e-7 s
_ROUNDED = 0.05  # frames by which the last one may come early: containers round times to a millisecond


class BvhStream(AbstractContextManager["BvhStream"]):
    """A BVH file that is written as motion comes, at a constant rate; it appears when the block ends well.

    Frames may come at any times: rotations between them are interpolated along the shorter arc, the root linearly.
    """

    def __init__(self, path: str | Path, skeleton: Skeleton, frame_rate: float) -> None:
        self._path, self._skeleton, self._rate = Path(path), skeleton, frame_rate
        self._stack = ExitStack()
        self._last: tuple[float, np.ndarray, np.ndarray] | None = None
        self._begun = 0.0
        self.frames = 0

    def __enter__(self) -> BvhStream:
        with ExitStack() as stack:
            part = stack.enter_context(written_beside(self._path))
            self._file: TextIO = stack.enter_context(part.open("w", encoding="utf-8", newline="\n"))
            text, self._order = hierarchy_text(self._skeleton, _UNIT, _ORDER)
            self._file.write(f"{text}MOTION\nFrames: ")
            self._count = self._file.tell()
            self._file.write(f"{'':{_DIGITS}}\nFrame Time: {1 / self._rate:.10g}\n")
            self._stack = stack.pop_all()
        return self

    def append(self, time: np.ndarray, pose: Pose) -> None:
        """Add a motion (T, …) whose frames were taken at increasing `time` (T,) s."""
        roots, rotations = np.asarray(pose.root_position), np.asarray(pose.rotation)[:, self._order]
        lines = []
        for moment, root, rotation in zip(time.tolist(), roots, rotations, strict=True):
            if self._last is None:
                self._begun, self._last = moment, (moment, root, rotation)
            before, root_before, rotation_before = self._last
            due = np.arange(self.frames, int(np.floor((moment - self._begun) * self._rate + _SAME)) + 1)
            share = ((self._begun + due / self._rate - before) / max(moment - before, 1e-9)).clip(0, 1)[:, None]
            shape = (len(due), *rotation.shape)
            turned = slerp(
                np.broadcast_to(rotation_before, shape),
                np.broadcast_to(rotation, shape),
                np.broadcast_to(share, shape[:2]),
            )
            place = (1 - share) * root_before + share * root
            if len(due):
                lines.append(motion_text(place, quaternion_canonical(turned), _UNIT, _ORDER))
            self.frames += len(due)
            self._last = (moment, root, rotation)
        self._file.write("".join(lines))

    def __exit__(self, *error: object) -> None:
        if error[0] is None:
            if self._last is not None and (self._last[0] - self._begun) * self._rate > self.frames - _ROUNDED:
                root, rotation = self._last[1:]
                self._file.write(motion_text(root[None], quaternion_canonical(rotation[None]), _UNIT, _ORDER))
                self.frames += 1
            self._file.seek(self._count)
            self._file.write(f"{self.frames:<{_DIGITS}}")
        self._stack.__exit__(*error)  # type: ignore[arg-type]


_TURN = 2 * np.pi


def euler_near(rotation: np.ndarray, order: str, before: np.ndarray) -> np.ndarray:
    """Angles (T, n) of rotations (T, 4), each nearest to the frame before, the first to `before` (n,); radians.

    A rotation has two triples of angles, and each angle has its whole turns; those are chosen that move least. For
    fewer than three axes the angles about the others, which come last, are left out.
    """
    axes = order + "".join(axis for axis in "XYZ" if axis not in order)
    one = np.asarray(quaternion_to_euler(rotation, axes))
    other = np.stack([one[:, 0] + np.pi, np.pi - one[:, 1], one[:, 2] + np.pi], axis=1)
    start = np.zeros(3)
    start[: len(order)] = before
    last = np.concatenate([start[None], one[:-1]])
    changes = _apart(other, last) < _apart(one, last)  # from one triple to the other since the frame before
    is_other = np.cumsum(changes) % 2 == 1
    angles = np.where(is_other[:, None], other, one)
    return np.unwrap(np.concatenate([start[None], angles]), axis=0)[1:, : len(order)]


def _apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the sum of the angular distances (T,) between angles (T, 3), ignoring whole turns."""
    return np.abs((a - b + np.pi) % _TURN - np.pi).sum(axis=1)


_TIMING = re.compile(rb"Frames\s*:\s*(\d{1,12})\s+Frame\s+Time\s*:\s*(\S+)\s+", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class BvhLines:
    """The joints of a file (no End Sites), parents before children, and its motion in file units and degrees."""

    path: Path
    head: bytes  # everything before the first frame
    lines: tuple[bytes, ...]  # one a frame, line ends included
    joints: tuple[str, ...]
    nodes: tuple[int, ...]  # which node of the file each joint is
    parents: tuple[int, ...]  # -1 for a root
    offset: np.ndarray  # (J, 3) file units
    channels: tuple[tuple[str, ...], ...]  # of each joint, in the file's order
    values: np.ndarray  # (T, C); NaN where the file's value is not a number
    interval: float  # s between frames

    @cached_property
    def columns(self) -> tuple[range, ...]:
        """Each joint's columns in a frame."""
        ends = accumulate((len(channels) for channels in self.channels), initial=0)
        return tuple(range(a, b) for a, b in pairwise(ends))

    @cached_property
    def order(self) -> tuple[str, ...]:
        """The axes that each joint turns about, 'ZXY', in the order of its channels; '' for one that cannot turn."""
        return tuple("".join(c[0] for c in channels if c.endswith("rotation")) for channels in self.channels)

    def columns_of(self, joint: int, kind: str) -> list[int]:
        """The columns of a joint's channels of one kind, 'rotation' or 'position'."""
        return [k for k, name in zip(self.columns[joint], self.channels[joint], strict=True) if name.endswith(kind)]

    @cached_property
    def has_number(self) -> np.ndarray:
        """(T, J) bool: all channels of a joint are numbers."""
        number = np.isfinite(self.values)
        return np.stack([number[:, list(columns)].all(axis=1) for columns in self.columns], axis=1)

    @cached_property
    def mended(self) -> BvhLines:
        """The file with missing numbers interpolated linearly between their neighbours.

        A channel without any number is zero, or for a position the joint's offset.
        """
        missing = ~np.isfinite(self.values)
        return self.with_values(_bridged(self.values, self._rest), missing) if missing.any() else self

    @cached_property
    def _rest(self) -> np.ndarray:
        """(C,) each channel's value where every joint is at rest."""
        return np.array(
            [
                self.offset[joint]["XYZ".index(channel[0])] if channel.endswith("position") else 0.0
                for joint, channels in enumerate(self.channels)
                for channel in channels
            ]
        )

    def without_places(self, gone: np.ndarray) -> BvhLines:
        """The file without the positions of joints where `gone` (T, J)."""
        values = self.values.copy()
        for joint in np.flatnonzero(gone.any(axis=0)).tolist():
            for column in self.columns_of(joint, "position"):
                values[gone[:, joint], column] = np.nan
        return replace(self, values=values)

    @cached_property
    def rotation(self) -> np.ndarray:
        """(T, J, 4) local rotations of the mended file."""
        values = np.deg2rad(self.mended.values)
        rotation = np.zeros((len(values), len(self.joints), 4))
        rotation[..., 0] = 1
        for joint, order in enumerate(self.order):
            if order:
                angles = values[:, self.columns_of(joint, "rotation")]
                rotation[:, joint] = quaternion_canonical(euler_to_quaternion(angles, order))
        return rotation

    def with_values(self, values: np.ndarray, changed: np.ndarray) -> BvhLines:
        """The file with other numbers (T, C) where `changed` (T, C); the text of all others stays."""
        if not np.isfinite(values[changed]).all():
            raise BodysenseError(f"{self.path}: numbers to be written are not finite")
        lines = list(self.lines)
        for frame in np.flatnonzero(changed.any(axis=1)):
            # Split into words and the space between them, so that unchanged words keep their text.
            parts = re.split(rb"(\S+)", lines[frame])
            for column in np.flatnonzero(changed[frame]):
                parts[2 * column + 1] = b"%.6f" % values[frame, column]
            lines[frame] = b"".join(parts)
        return replace(self, lines=tuple(lines), values=np.where(changed, values, self.values))

    def with_rotation(self, rotation: np.ndarray, changed: np.ndarray) -> BvhLines:
        """The file with other local rotations (T, J, 4) where `changed` (T, J).

        Angles are those nearest to the frame before. A joint with one or two axes turns as near as these let it.
        """
        values, columns_changed = self.mended.values.copy(), np.zeros(self.values.shape, dtype=bool)
        for joint in np.flatnonzero(changed.any(axis=0)).tolist():
            order, columns, frames = self.order[joint], self.columns_of(joint, "rotation"), changed[:, joint]
            if not order:
                continue
            turns = rotation[:, joint]
            if len(order) == 1:
                turns = swing_twist(turns, np.eye(3)["XYZ".index(order)])[1]
            for first, end in runs(frames):
                before = np.deg2rad(values[first - 1, columns]) if first else np.zeros(len(order))
                values[first:end, columns] = np.rad2deg(euler_near(turns[first:end], order, before))
            columns_changed[:, columns] = frames[:, None]
        return self.with_values(values, columns_changed)

    def text(self) -> bytes:
        """The whole file."""
        return self.head + b"".join(self.lines)

    def write(self, path: str | Path) -> None:
        """Write the file; it appears whole or not at all."""
        with written_beside(path) as part:
            part.write_bytes(self.text())


def open_bvh(path: str | Path) -> BvhLines:
    """Read a BVH file. Raises BodysenseError, naming the file and the fix, for anything else."""
    path = Path(path)
    data = read_bytes(path)
    check_plain(data[:64], path)
    timing = _TIMING.search(data)
    frames = int(timing[1]) if timing else 0
    begin = timing.end() if timing else 0
    body = with_plain_nan(data[begin:])
    words = body.split()
    numbers = _numbers(words) if frames and words and len(words) % frames == 0 else None
    if numbers is None:
        parse_bvh(data, path)  # raises the specific error
        raise BodysenseError(f"{path}: its motion cannot be read line by line; export it again")
    values = np.where(sound(numbers), numbers, np.nan).reshape(frames, -1)
    lines = _lines(body, words, *values.shape)
    # The hierarchy is parsed together with one complete frame, because the file's own numbers may be missing.
    plain = b"\n".join(b" ".join(b"%.9g" % value for value in row) for row in _bridged(values, 0.0)[:1])
    file = parse_bvh(_TIMING.sub(b"Frames: 1 Frame Time: \\2 ", data[:begin]) + plain, path)
    joints = [k for k, node in enumerate(file.nodes) if not node.is_site]
    place = {k: joint for joint, k in enumerate(joints)}
    return BvhLines(
        path=path,
        head=data[:begin],
        lines=lines,
        joints=tuple(file.nodes[k].name for k in joints),
        nodes=tuple(joints),
        parents=tuple(place.get(file.nodes[k].parent, -1) for k in joints),
        offset=np.array([file.nodes[k].offset for k in joints], dtype=float),
        channels=tuple(file.nodes[k].channels for k in joints),
        values=values,
        interval=1 / file.frame_rate,
    )


def _numbers(words: list[bytes]) -> np.ndarray | None:
    """Return words as numbers, or None if a word is not a number."""
    try:
        return np.array(words, dtype=np.float64)
    except ValueError:
        return None


def _bridged(values: np.ndarray, rest: np.ndarray | float) -> np.ndarray:
    """Columns (T, C) with a line over each gap; `rest` where a column has nothing."""
    bridged, missing = values.copy(), ~np.isfinite(values)
    rest = np.broadcast_to(rest, values.shape[1])
    for column in np.flatnonzero(missing.any(axis=0)):
        known = np.flatnonzero(~missing[:, column])
        there = np.interp(np.arange(len(values)), known, values[known, column]) if known.size else rest[column]
        bridged[:, column] = there
    return bridged


def _lines(body: bytes, words: list[bytes], frames: int, count: int) -> tuple[bytes, ...]:
    """Return one line a frame, unchanged if the file has one line a frame."""
    lines = [line for line in body.splitlines(keepends=True) if line.strip()]
    if len(lines) == frames and all(len(line.split()) == count for line in lines):
        return tuple(lines)
    return tuple(b" ".join(words[k : k + count]) + b"\n" for k in range(0, frames * count, count))
