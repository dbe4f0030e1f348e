"""BVH files as text: joints and numbers. Numbers are replaced without changing any other byte."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import HUGE, check_plain, read_bytes, sound, written_beside
from bodysense.io.rigs.joint_file import JointFile, Node

MOST_NODES = 20_000  # joints and end sites; no body has a tenth of them

_TOKEN = re.compile(
    r"\s*(?:(?P<open>\{)|(?P<close>\})"
    r"|(?P<root>ROOT\b|JOINT\b)[ \t]*(?P<name>[^\r\n{}]*)|(?P<end>End\s+Site\w*)[^\r\n{}]*"
    r"|OFFSET(?P<offset>(?:\s+[^\s{}]+){3})"
    r"|CHANNELS\s+(?P<count>\d{1,2})\b(?P<channels>(?:\s+[XYZ](?:position|rotation)\b)*))",
    re.IGNORECASE,
)
_HIERARCHY = re.compile(
    rb"(?:\xef\xbb\xbf)?(?:\s*(?:#|//|;|%)[^\r\n]*)*\s*HIERARCHY\b", re.IGNORECASE
)  # comments before
_MOTION = re.compile(rb"(?:^|\r)[ \t]*MOTION\b", re.MULTILINE | re.IGNORECASE)
_NOT_A_NUMBER = re.compile(rb"(?<!\S)[-+]?(?:1\.#\w+|nan\(\w*\))", re.IGNORECASE)  # as some compilers write NaN
_SPACE = re.compile(rb"\s")
_PART = 1 << 22  # bytes of text that are parsed at once
_LARGE_TEXT = 1 << 25  # bytes; the text of a larger file is read again when it is written
_A_RATE = 5.0  # s; a longer frame time is a number of frames a second
_TIMING = re.compile(rb"(\s*Frames\s*:\s*)(\d{1,12})(\s+Frame\s+Time\s*:\s*)(\S+)(\s*)", re.IGNORECASE)


@dataclass(frozen=True)
class FrameText:
    """The text of frames in a file, which is read again when it is written: it is as large as its numbers."""

    path: Path
    start: int  # byte at which it begins
    stamp: tuple[int, int]  # size and time of change of the file

    def parts(self) -> Iterator[bytes]:
        """Yield the text in parts. Raises BodysenseError if the file has changed."""
        if _stamp(self.path) != self.stamp:
            raise BodysenseError(f"{self.path}: changed since it was read; run the same command again")
        with self.path.open("rb") as file:
            file.seek(self.start)
            while part := file.read(_PART):
                yield part


def _stamp(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_size, found.st_mtime_ns


def _lines(text: bytes | FrameText) -> Iterator[bytes]:
    """Yield the lines of a text that are not blank, with their ends."""
    rest = b""
    for part in (text[k : k + _PART] for k in range(0, len(text), _PART)) if isinstance(text, bytes) else text.parts():
        *whole, rest = (rest + part).splitlines(keepends=True)
        if rest.endswith(b"\n"):
            whole, rest = [*whole, rest], b""
        yield from (_plain(line) for line in whole if line.strip())
    if rest.strip():
        yield _plain(rest)


@dataclass(frozen=True, eq=False)
class BvhFile(JointFile):
    """A BVH file: its joints and motion, and its text."""

    head: bytes  # everything before the first frame
    motion: bytes | FrameText  # the frames
    changed: np.ndarray | None = None  # (T, C) bool: numbers that replace those of the text; None: none

    @property
    def lines(self) -> Iterator[bytes]:
        """One line a frame, line ends included; unchanged if the file has one line a frame."""
        for frame, line in enumerate(self._given_lines()):
            columns = [] if self.changed is None else np.flatnonzero(self.changed[frame]).tolist()
            if not columns:
                yield line
                continue
            # Split into words and the space between them, so that unchanged words keep their text.
            parts = re.split(rb"(\S+)", line)
            for column in columns:
                parts[2 * column + 1] = b"%.6f" % self.values[frame, column]
            yield b"".join(parts)

    def _given_lines(self) -> Iterator[bytes]:
        """Yield one line a frame of the text."""
        frames, count = self.values.shape
        if [len(line.split()) for line in _lines(self.motion)] == [count] * frames:
            yield from _lines(self.motion)
            return
        words = b"".join(_lines(self.motion)).split()
        yield from (b" ".join(words[k : k + count]) + b"\n" for k in range(0, frames * count, count))

    def with_values(self, values: np.ndarray, changed: np.ndarray) -> BvhFile:
        """Return the file with numbers (T, C) that differ where `changed` (T, C); the text of all others stays."""
        for column in np.flatnonzero(changed.any(axis=0)).tolist():
            self.check_finite(values[changed[:, column], column])
        every = changed if self.changed is None else self.changed | changed
        return replace(self, values=values, changed=every)

    def with_frames(self, row: np.ndarray, count: int, frame_rate: float) -> BvhFile:
        """Return the file with `count` frames of one row (C,) of values."""
        head = _TIMING.sub(rb"\g<1>%d\g<3>%.10g\g<5>" % (count, 1 / frame_rate), self.head)
        line = b" ".join(b"%.6f" % value for value in row) + b"\n"
        values = np.tile(row, (count, 1))
        return replace(self, head=head, motion=line * count, values=values, changed=None, frame_rate=frame_rate)

    def text(self) -> bytes:
        """The whole file."""
        return self.head + b"".join(self.lines)

    def write(self, path: str | Path) -> None:
        """Write the file; it appears whole or not at all."""
        with written_beside(path) as part, part.open("wb") as file:
            file.write(self.head)
            file.writelines(self.lines)


def parse_bvh(data: bytes, path: Path) -> BvhFile:
    """Parse a file's bytes; `path` names it in messages.

    Raises BodysenseError, naming the file, what is wrong and the fix, for anything that is not such a file, and for
    values that are not numbers.
    """
    file = _parsed(data, path, (0, 0))
    if not (good := sound(file.values)).all():
        row, column = (int(k) for k in np.argwhere(~good)[0])
        value = file.values[row, column]
        beyond = f" ({value:g}, beyond {HUGE:g})" if np.isfinite(value) else ""
        raise BodysenseError(
            f"{path}: frame {row} is not finite{beyond}; cut or mend it, or fill it: "
            f"bodysense track {path.name} -o filled.bvh"
        )
    return file


def open_bvh(path: str | Path) -> BvhFile:
    """Read a BVH file, whose values may be missing. Raises as `parse_bvh` for anything else."""
    path = Path(path)
    before = _stamp(path) if path.exists() else (0, 0)
    data = read_bytes(path)
    file = _parsed(data, path, before if len(data) > _LARGE_TEXT else None)
    del data  # as large as its numbers
    return replace(file, values=np.where(sound(file.values), file.values, np.nan))


def _parsed(data: bytes, path: Path, stamp: tuple[int, int] | None = None) -> BvhFile:
    """Parse a file's bytes; values may be NaN, infinite or huge. `stamp`: the file's, from which text is read again."""
    check_plain(data[:64], path)
    hierarchy = _HIERARCHY.match(data)
    if hierarchy is None:
        raise BodysenseError(f"{path}: is not a BVH file: it does not begin with HIERARCHY")
    motion = _MOTION.search(data, hierarchy.end())
    if motion is None:
        raise BodysenseError(f"{path}: there is no MOTION section; the file is cut off, copy or export it again")
    first_line = data.count(b"\n", 0, hierarchy.end()) + 1
    tree = _parse_hierarchy(path, data[hierarchy.end() : motion.start()].decode(errors="replace"), first_line)
    timing = _TIMING.match(data, motion.end())
    if timing is None:
        raise BodysenseError(f"{path}: 'Frames:' and 'Frame Time:' must follow MOTION; the file is cut off or damaged")
    rate, frames, channels = _frame_rate(path, timing[4]), int(timing[2]), sum(len(node.channels) for node in tree)
    if not frames or not channels:
        raise BodysenseError(f"{path}: {frames} frames of {channels} channels are no motion; export it again")
    values = _numbers(path, data, timing.end(), (frames + 1) * channels + 1)
    head, doubts = data[: timing.end()], ()
    if values.size == (frames + 1) * channels:  # some programs announce the frames after the first
        doubts = (f"'Frames: {frames}' announces one frame fewer than there are; all {frames + 1} are read",)
        head = head[: timing.start(2)] + b"%d" % (frames + 1) + head[timing.end(2) :]
        frames += 1
    if values.size != frames * channels:
        widths = [len(line.split()) for line in data[timing.end() :].splitlines() if line.strip()]
        if len(widths) == frames and set(widths) != {channels} and len(set(widths)) == 1:
            raise BodysenseError(
                f"{path}: 'Frames: {frames}' announces {frames * channels} values ({channels} channels), but each row "
                f"has {widths[0]}; the hierarchy is of another motion: export the file again"
            )
        rows, rest = divmod(values.size, channels)
        raise BodysenseError(
            f"{path}: 'Frames: {frames}' announces {frames * channels} values ({channels} channels), but there are "
            f"{rows} whole frames{f' and {rest} values' if rest else ''}; correct that number, or export the file again"
        )
    nodes = tuple(k for k, node in enumerate(tree) if not node.is_site)
    joint = {k: joint for joint, k in enumerate(nodes)}
    return BvhFile(
        path=path,
        head=head,
        motion=data[timing.end() :] if stamp is None else FrameText(path, timing.end(), stamp),
        tree=tuple(tree),
        nodes=nodes,
        joints=tuple(tree[k].name for k in nodes),
        parents=tuple(joint.get(tree[k].parent, -1) for k in nodes),
        offset=np.array([tree[k].offset for k in nodes], dtype=float),
        channels=tuple(tree[k].channels for k in nodes),
        values=values.reshape(frames, channels),
        frame_rate=rate,
        warnings=doubts,
    )


def _parse_hierarchy(path: Path, text: str, first_line: int) -> list[Node]:
    """Return the joints and End Sites of the text after HIERARCHY, parents before children."""
    nodes: list[Node] = []
    stack: list[int] = []
    declared: int | None = None  # a node whose '{' is still to come
    place = 0
    end = len(text.rstrip())
    while place < end:
        token = _TOKEN.match(text, place)

        def broken(what: str, at: int = place) -> BodysenseError:
            line = text.count("\n", 0, at + len(text[at:]) - len(text[at:].lstrip())) + first_line
            return BodysenseError(f"{path}: line {line}: {what}; mend the file or export it again")

        if len(nodes) > MOST_NODES:
            raise BodysenseError(f"{path}: more than {MOST_NODES} joints and end sites; no body has so many")
        if token is None:
            raise broken(f"{text[place:].split(None, 1)[0][:40]!r} is not understood here")
        if declared is not None and not token["open"]:
            raise broken(f"'{{' is missing after {nodes[declared].name!r}")
        if token["open"]:
            if declared is None:
                raise broken("a '{' that follows no joint")
            stack.append(declared)
            declared = None
        elif token["close"]:
            if not stack:
                raise broken("a '}' too many")
            if nodes[stack.pop()].offset is None:
                raise broken("a joint without OFFSET")
        elif token["root"] or token["end"]:
            if (token["end"] and not stack) or (stack and nodes[stack[-1]].is_site):
                raise broken("an End Site or joint that hangs on no joint")
            parent = stack[-1] if stack else -1
            name = f"{nodes[parent].name}_end" if token["end"] else token["name"].strip()
            if not name:
                raise broken("a joint without a name")
            declared = len(nodes)
            nodes.append(Node(name, parent, bool(token["end"])))
        elif not stack:
            raise broken("OFFSET or CHANNELS outside of a joint")
        elif token["offset"]:
            nodes[stack[-1]].offset = _three_numbers(token["offset"], broken)
        else:
            channels = tuple(name.capitalize() for name in token["channels"].split())
            if len(channels) != int(token["count"]) or len(set(channels)) != len(channels):
                raise broken(f"CHANNELS announces {token['count']} but lists {', '.join(channels) or 'none'}")
            nodes[stack[-1]].channels = channels
        place = token.end()
    if not nodes or stack or declared is not None:
        raise BodysenseError(f"{path}: the hierarchy is cut off before its last '}}'; copy or export the file again")
    return nodes


def _three_numbers(text: str, broken: Callable[[str], BodysenseError]) -> tuple[float, ...]:
    try:
        numbers = tuple(float(word) for word in text.split())
    except ValueError:
        problem = "has commas for decimal points; put points" if "," in text else "is not three numbers"
        raise broken(f"OFFSET {' '.join(text.split())!r} {problem}") from None
    if not sound(np.array(numbers)).all():
        raise broken(f"OFFSET {' '.join(text.split())!r} is not finite, or beyond {HUGE:g}")
    return numbers


def _frame_rate(path: Path, text: bytes) -> float:
    """Return the rate (Hz) of a frame time; a whole one if the time is rounded (0.0333333 s)."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = float("nan")
    if not 1e-5 <= seconds <= 1e3:  # NaN, too
        raise BodysenseError(
            f"{path}: Frame Time is {text.decode(errors='replace')!r}; it must be seconds, e.g. 0.0333333"
        )
    if seconds >= _A_RATE:
        raise BodysenseError(
            f"{path}: Frame Time is {seconds:g} seconds, which is a rate of {1 / seconds:.3g} Hz; if {seconds:g} is "
            f"the rate of frames a second, write Frame Time: {1 / seconds:.7g}"
        )
    rate = 1 / seconds
    return float(round(rate)) if abs(rate - round(rate)) < 1e-4 * rate else rate


def _plain(text: bytes) -> bytes:
    """Return the text of numbers with NaN as Python writes it."""
    return _NOT_A_NUMBER.sub(b"nan", text) if b"#" in text or b"(" in text else text


def _numbers(path: Path, data: bytes, start: int, expected: int) -> np.ndarray:
    """Return the numbers (N,) of the frames, whose text begins at `start` with a number or is empty.

    At most about `expected` numbers are made room for at once, however many the file announces.
    """
    values, count = np.empty(min(expected, (len(data) - start) // 2 + 2)), 0
    while start < len(data):
        space = _SPACE.search(data, min(start + _PART, len(data)))
        end = len(data) if space is None else space.end()
        text = _plain(data[start:end])
        start = end
        if not text.strip():  # np.fromstring reads one number from an empty text
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", DeprecationWarning)  # before NumPy 2.3 unread text is only a warning
                part = np.fromstring(text, sep=" ")
        except (ValueError, DeprecationWarning):
            raise BodysenseError(
                f"{path}: {_first_bad_number(text.rstrip())!r} in the motion is not a number; mend that frame"
            ) from None
        if count + len(part) > len(values):
            values = np.concatenate([values[:count], np.empty(max(len(part), count))])
        values[count : count + len(part)] = part
        count += len(part)
    return values[:count]


def _first_bad_number(block: bytes) -> str:
    for word in block.split():
        try:
            float(word)
        except ValueError:
            return word[:40].decode(errors="replace")
    return block[-40:].decode(errors="replace")
