"""BVH files: read figures and clips, write clips whole or frame by frame.

A joint's channels turn it in the order they are listed (intrinsic: Zrotation Xrotation Yrotation is R = Rz · Rx · Ry);
position channels replace its OFFSET, as MotionBuilder and Blender have it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, suppress
from pathlib import Path
from typing import IO

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.files import read_bytes, written_beside
from bodysense.geometry.rotation import quaternion_canonical, quaternion_to_euler, slerp
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh_text import parse_bvh
from bodysense.io.rigs.figure import LONG, Figure, LazyRotation, Rotation, positions_in_parent
from bodysense.io.rigs.joint_file import JointFile

_UNIT, _ORDER = 0.01, "ZXY"  # m of a file unit, and the channels' order, unless others are given
_BLOCK = 256  # frames written at once
_COUNT = "Frames: "
_DIGITS = 12  # characters of the number of frames: aligned to the right until the file is finished, then to the left
_LONGEST_HEAD = 1 << 20  # bytes; more than the head of any file of ours
_UNFINISHED = re.compile(rb"HIERARCHY\n.*?\nMOTION\nFrames: ( [ \d]{10}\d)\nFrame Time: [^\n]+\n", re.DOTALL)
_SAME = 1e-4  # frames; Unix times are exact to 3e-7 s
_ROUNDED = 0.05  # frames by which the last one may come early: containers round times to a millisecond


def read_bvh(path: str | Path, unit: float = _UNIT) -> Clip:
    """Read a BVH file of one figure: its own joints, names, axes and rest pose; `unit` is metres of a file unit.

    An End Site is named after its joint, 'LeftToeBase_end', and dropped if it has no length. Frame times that round
    to a whole rate (0.0333333 s) give that rate. Joints other than the root may have position channels: of a joint
    that moves in its parent, the median place is its offset. `bodysense.read` recognises unit, axes and joints.

    Raises BodysenseError, naming the file, what is wrong and the fix, for anything that is not such a file.
    """
    path = Path(path)
    figure, *others = figures_of(parse_bvh(read_bytes(path), path))
    if others:
        names = ", ".join(one.joints[0] for one in (figure, *others))
        raise BodysenseError(f"{path}: {len(others) + 1} figures ({names}), not one; split the file")
    if not (np.isfinite(unit) and unit > 0):
        raise BodysenseError(f"{path}: unit {unit:g} cannot be; give the metres of one file unit, e.g. 0.01")
    try:
        skeleton = Skeleton(figure.joints, figure.end_sites, figure.parents, figure.bone * unit)
    except BodysenseError as error:
        raise BodysenseError(f"{path}: {error}") from None
    root = figure.position.get(0, np.tile(figure.offset[0], (len(figure), 1))) * unit
    return Clip(path.stem, Pose(skeleton, root, figure.rotation[:]), figure.frame_rate)


def figures_of(file: JointFile) -> list[Figure]:
    """Return the trees of a file, in file units. End Sites are named after their joints, 'LeftToeBase_end'."""
    return [_figure(file, root) for root, node in enumerate(file.tree) if node.parent < 0]


def _figure(file: JointFile, root: int) -> Figure:
    inside = {root}
    for k, node in enumerate(file.tree):
        if node.parent in inside:
            inside.add(k)
    joints = [joint for joint, k in enumerate(file.nodes) if k in inside]
    sites = [k for k in sorted(inside) if file.tree[k].is_site and np.any(file.tree[k].offset)]
    nodes = [*(file.nodes[joint] for joint in joints), *sites]
    point = {k: point for point, k in enumerate(nodes)}
    names = _unique([file.tree[k].name for k in nodes])
    offset = np.array([file.tree[k].offset for k in nodes], dtype=float)
    position = {rank: file.place(joint) for rank, joint in enumerate(joints) if file.axes_of(joint)}
    rotation: Rotation = LazyRotation(
        (len(file.values), len(joints), 4), lambda frames: file.rotation_in(frames)[:, joints]
    )
    if len(file.values) <= LONG:  # else the rotations are computed when they are taken
        rotation = file.rotation[:, joints]
    return Figure(
        name=str(file.path),
        joints=names[: len(joints)],
        end_sites=names[len(joints) :],
        parents=tuple(-1 if k == root else point[file.tree[k].parent] for k in nodes),
        offset=offset,
        rotation=rotation,
        position=positions_in_parent(position, offset),
        frame_rate=file.frame_rate,
        nodes=tuple(nodes),
    )


def _unique(names: list[str]) -> tuple[str, ...]:
    """Return the names; repeated ones are numbered from the second on: a_end, a_end2."""
    taken: set[str] = set()
    result: list[str] = []
    for name in names:
        number, choice = 1, name
        while choice in taken:
            number += 1
            choice = f"{name}{number}"
        taken.add(choice)
        result.append(choice)
    return tuple(result)


def write_bvh(path: str | Path, clip: Clip, unit: float = _UNIT, order: str = _ORDER) -> None:
    """Write a clip as a BVH file of its own joints: positions in units of `unit` metres, angles in degrees.

    Every joint has rotation channels in `order`, the root position channels before them; both are written to six
    decimals. The file appears whole or not at all: it is written next to `path` and then renamed. Raises BodysenseError
    for a clip that is not one finite motion, a wrong order, or a folder that cannot be written.
    """
    path, pose, frame_rate = Path(path), clip.pose, clip.frame_rate
    rotation, root = np.asarray(pose.rotation, dtype=float), np.asarray(pose.root_position, dtype=float)
    if rotation.ndim != 3 or not len(rotation) or not np.isfinite(rotation).all() or not np.isfinite(root).all():
        raise BodysenseError(
            f"{path}: a BVH file holds one motion of finite numbers, rotation (T, J, 4); got {rotation.shape}"
            f"{'' if rotation.ndim != 3 else ', not all finite'}"
        )
    if sorted(order) != ["X", "Y", "Z"]:
        raise BodysenseError(f"order {order!r} must name X, Y and Z once each, e.g. 'ZXY'")
    if not (np.isfinite([frame_rate, unit]).all() and frame_rate > 0 and unit > 0):
        raise BodysenseError(f"frame rate {frame_rate:g} Hz and unit {unit:g} m must be positive")
    hierarchy, written = _hierarchy(pose.skeleton, unit, order)
    with written_beside(path) as part, part.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"{hierarchy}MOTION\nFrames: {len(rotation)}\nFrame Time: {1 / frame_rate:.10g}\n")
        file.writelines(_frame_rows(root, rotation, written, unit, order))


class BvhWriter:
    """Writer of BVH frames to an open file at a constant rate. After each call the file is a valid BVH of its frames.

    Frames may come at any times: rotations between them are interpolated along the shorter arc, the root linearly.
    If a call raises OSError, the file is unchanged by it, unless the disk does not allow that either.

    Args:
        file: an empty file, opened in a binary mode for writing.
        skeleton: of all poses.
        frame_rate: Hz.
    """

    def __init__(self, file: IO[bytes], skeleton: Skeleton, frame_rate: float) -> None:
        self._file, self._rate = file, frame_rate
        self._last: tuple[np.ndarray, ...] | None = None  # time (1,), root (1, 3) and rotation (1, J, 4)
        self._begun = 0.0
        self.frames = 0
        hierarchy, self._order = _hierarchy(skeleton, _UNIT, _ORDER)
        head = f"{hierarchy}MOTION\n{_COUNT}".encode()
        self._count_place = len(head)
        self.size = 0  # bytes
        self._put(head + f"{0:>{_DIGITS}}\nFrame Time: {1 / frame_rate:.10g}\n".encode(), 0)

    def append(self, time: np.ndarray, pose: Pose) -> None:
        """Add a motion (T, …) whose frames were taken at increasing `time` (T,) s."""
        if not len(time):
            return
        parts = time, np.asarray(pose.root_position), np.asarray(pose.rotation)
        last, begun = self._last, self._begun
        if last is None:
            begun, last = float(time[0]), tuple(part[:1] for part in parts)
        time, root, rotation = (np.concatenate(pair) for pair in zip(last, parts, strict=True))
        # The last frame of the file that is due at each moment, and the moment before each frame that is due now.
        last_due = np.maximum.accumulate(np.floor((time[1:] - begun) * self._rate + _SAME))
        due = np.arange(self.frames, int(last_due[-1]) + 1)
        before = np.searchsorted(last_due, due)
        after = before + 1
        step = np.maximum(time[after] - time[before], 1e-9)
        share = ((begun + due / self._rate - time[before]) / step).clip(0, 1)[:, None]
        turned = quaternion_canonical(slerp(rotation[before], rotation[after], share))
        self._write((1 - share) * root[before] + share * root[after], turned)
        self._begun, self._last = begun, (time[-1:], root[-1:], rotation[-1:])

    def finish(self) -> None:
        """Add the last frame if it was rounded to come early, and mark the file as finished."""
        if self._last is not None:
            time, root, rotation = self._last
            if (time[0] - self._begun) * self._rate > self.frames - _ROUNDED:
                self._write(root, quaternion_canonical(rotation))
        self._put_count(f"{self.frames:<{_DIGITS}}")

    def _write(self, root: np.ndarray, rotation: np.ndarray) -> None:
        if not len(root):
            return
        rows = "".join(_frame_rows(root, rotation, self._order, _UNIT, _ORDER)).encode()
        self._put(rows, len(root))

    def _put(self, data: bytes, frames: int) -> None:
        """Append bytes, and then count their frames; undo both if the disk fails."""
        size = self.size
        try:
            _write_all(self._file, data)
            if frames:
                self._put_count(f"{self.frames + frames:>{_DIGITS}}")
        except OSError:
            with suppress(OSError):
                self._file.seek(size)
                self._file.truncate()
            raise
        self.size, self.frames = size + len(data), self.frames + frames

    def _put_count(self, count: str) -> None:
        self._file.seek(self._count_place)
        _write_all(self._file, count.encode())
        self._file.seek(0, os.SEEK_END)


class BvhStream(AbstractContextManager["BvhStream"]):
    """Writer of a BVH file frame by frame (`BvhWriter`); the file appears when the block ends without an error."""

    def __init__(self, path: str | Path, skeleton: Skeleton, frame_rate: float) -> None:
        self._path, self._skeleton, self._rate = Path(path), skeleton, frame_rate
        self._stack = ExitStack()

    def __enter__(self) -> BvhStream:
        with ExitStack() as stack:
            part = stack.enter_context(written_beside(self._path))
            self._writer = BvhWriter(stack.enter_context(part.open("wb")), self._skeleton, self._rate)
            self._stack = stack.pop_all()
        return self

    @property
    def frames(self) -> int:
        """Number of frames in the file."""
        return self._writer.frames

    def append(self, time: np.ndarray, pose: Pose) -> None:
        """Add a motion (T, …) whose frames were taken at increasing `time` (T,) s."""
        self._writer.append(time, pose)

    def __exit__(self, *error: object) -> None:
        with self._stack:
            if isinstance(error[1], BaseException):
                raise error[1]
            self._writer.finish()


def mend_bvh(path: Path) -> bool:
    """Complete a file whose `BvhWriter` was killed: cut off half a frame, and correct the count.

    Return False, without a change, for a file that was finished or that `BvhWriter` did not write.
    Raises OSError if the file cannot be read or written.
    """
    with path.open("r+b") as file:
        head = _UNFINISHED.match(file.read(_LONGEST_HEAD))
        if head is None:
            return False
        file.seek(head.end())
        frames, end, place = 0, head.end(), head.end()
        while block := file.read(1 << 20):
            frames += block.count(b"\n")
            if (last := block.rfind(b"\n")) >= 0:
                end = place + last + 1
            place += len(block)
        file.seek(end)
        file.truncate()
        file.seek(head.start(1))
        file.write(f"{frames:<{_DIGITS}}".encode())
    return True


def _write_all(file: IO[bytes], data: bytes) -> None:
    """Write all bytes; an unbuffered file may take them in parts."""
    rest = memoryview(data)
    while rest:
        rest = rest[file.write(rest) :]


def _frame_rows(root: np.ndarray, rotation: np.ndarray, written: list[int], unit: float, order: str) -> Iterator[str]:
    """Yield lines of frames: root (T, 3) m, rotations (T, J, 4) of joints `written`, in the order of the HIERARCHY."""
    for start in range(0, len(root), _BLOCK):
        block = slice(start, start + _BLOCK)
        angles = np.rad2deg(quaternion_to_euler(rotation[block][:, written], order))
        values = np.concatenate([root[block] / unit, angles.reshape(len(angles), -1)], axis=1)
        # One formatting call, for speed, and constant numbers (fingers that nothing tracks) are formatted once.
        held = (values.view(np.int64) == values[:1].view(np.int64)).all(axis=0)
        row = " ".join(
            f"{x:.6f}" if still else "%.6f" for x, still in zip(values[0].tolist(), held.tolist(), strict=True)
        )
        yield (row + "\n") * len(values) % tuple(values[:, ~held].ravel().tolist())


def _hierarchy(skeleton: Skeleton, unit: float, order: str) -> tuple[str, list[int]]:
    """Return the HIERARCHY section, and the joints in its order."""
    odd = [name for name in skeleton.joints if name != name.strip() or not name or any(c in name for c in "{}\r\n")]
    if odd:
        raise BodysenseError(f"the joint name {odd[0]!r} cannot stand in a BVH file; rename it")
    rotations = " ".join(f"{axis}rotation" for axis in order)
    count = len(skeleton.joints)
    children: list[list[int]] = [[] for _ in skeleton.points]
    for point, parent in enumerate(skeleton.parents[1:], start=1):
        children[parent].append(point)
    lines, written = ["HIERARCHY"], []
    todo: list[tuple[int, int]] = [(0, 0)]  # (point, depth); a point of -1 closes a brace
    while todo:
        point, depth = todo.pop()
        indent = "\t" * depth
        if point < 0:
            lines.append(f"{indent}}}")
            continue
        is_site = point >= count
        head = "End Site" if is_site else f"{'JOINT' if depth else 'ROOT'} {skeleton.points[point]}"
        offset = " ".join(f"{x:.6f}" for x in skeleton.rest_offset[point] / unit)
        lines += [f"{indent}{head}", f"{indent}{{", f"{indent}\tOFFSET {offset}"]
        if not is_site:
            written.append(point)
            position = "" if depth else "Xposition Yposition Zposition "
            lines.append(f"{indent}\tCHANNELS {3 if depth else 6} {position}{rotations}")
            if not children[point]:  # many readers want an End Site on the last joint
                lines += [f"{indent}\tEnd Site", f"{indent}\t{{", f"{indent}\t\tOFFSET 0 0 0", f"{indent}\t}}"]
        todo.append((-1, depth))
        todo += [(child, depth + 1) for child in reversed(children[point])]
    return "\n".join(lines) + "\n", written
