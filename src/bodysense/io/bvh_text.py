"""The text of a BVH file: its tree of nodes and its table of numbers."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.body.rotation import euler_to_quaternion, quaternion_canonical
from bodysense.errors import BodysenseError
from bodysense.files import HUGE, check_plain, sound
from bodysense.io.rigs.figure import Figure, placed

_BLOCK = 256  # frames that are converted at once
MOST_NODES = 20_000  # joints and end sites; no body has a tenth of them

_TOKEN = re.compile(
    r"\s*(?:(?P<open>\{)|(?P<close>\})"
    r"|(?P<root>ROOT\b|JOINT\b)[ \t]*(?P<name>[^\r\n{}]*)|(?P<end>End\s+Site\b)[^\r\n{}]*"
    r"|OFFSET(?P<offset>(?:\s+[^\s{}]+){3})"
    r"|CHANNELS\s+(?P<count>\d{1,2})\b(?P<channels>(?:\s+[XYZ](?:position|rotation)\b)*))",
    re.IGNORECASE,
)
_MOTION = re.compile(rb"(?:^|\r)[ \t]*MOTION\b", re.MULTILINE | re.IGNORECASE)
_NOT_A_NUMBER = re.compile(rb"(?<!\S)[-+]?(?:1\.#\w+|nan\(\w*\))", re.IGNORECASE)  # as some compilers write NaN
_TIMING = re.compile(rb"\s*Frames\s*:\s*(\d{1,12})\s+Frame\s+Time\s*:\s*(\S+)", re.IGNORECASE)


@dataclass
class Node:
    """A joint or End Site of the HIERARCHY section."""

    name: str
    parent: int  # among the nodes; -1 for a root
    is_site: bool
    offset: tuple[float, ...] | None = None
    channels: tuple[str, ...] = ()  # 'Xposition' …


@dataclass(frozen=True, eq=False)
class BvhFile:
    """The content of a BVH file: nodes, parents before children, and one number for each channel and frame."""

    path: Path
    nodes: tuple[Node, ...]
    values: np.ndarray  # (T, C): channels in the order of the nodes
    frame_rate: float  # Hz

    @property
    def roots(self) -> list[int]:
        """The nodes without a parent."""
        return [k for k, node in enumerate(self.nodes) if node.parent < 0]

    def columns(self, node: int) -> slice:
        """The columns of `values` that are a node's channels."""
        start = sum(len(one.channels) for one in self.nodes[:node])
        return slice(start, start + len(self.nodes[node].channels))

    def figure(self, root: int) -> Figure:
        """Return the tree below a root, in file units. End Sites are named after their joints, 'LeftToeBase_end'."""
        inside: set[int] = set()
        for k, node in enumerate(self.nodes):
            if k == root or node.parent in inside:
                inside.add(k)
        joints = [k for k in sorted(inside) if not self.nodes[k].is_site]
        sites = [k for k in sorted(inside) if self.nodes[k].is_site and np.any(self.nodes[k].offset)]
        order = joints + sites
        index = {k: new for new, k in enumerate(order)}
        names = unique([self.nodes[k].name for k in order])
        position, rotation = self._local(joints)
        offset = np.array([self.nodes[k].offset for k in order], dtype=float)
        return Figure(
            name=str(self.path),
            joints=names[: len(joints)],
            end_sites=names[len(joints) :],
            parents=tuple(-1 if k == root else index[self.nodes[k].parent] for k in order),
            offset=offset,
            rotation=rotation,
            position=placed(position, offset),
            frame_rate=self.frame_rate,
            nodes=tuple(order),
        )

    def _local(self, joints: list[int]) -> tuple[dict[int, np.ndarray], np.ndarray]:
        """Place in the parent (T, 3) of joints with position channels, by rank; rotation (T, J, 4) of the joints."""
        starts = np.cumsum([0, *(len(node.channels) for node in self.nodes)]).tolist()
        position: dict[int, np.ndarray] = {}
        rotation = np.zeros((len(self.values), len(joints), 4))
        rotation[..., 0] = 1
        columns_by_order: dict[str, list[tuple[int, list[int]]]] = {}
        for joint, k in enumerate(joints):
            turns: list[tuple[str, int]] = []
            for column, channel in enumerate(self.nodes[k].channels, start=starts[k]):
                if channel.endswith("position"):
                    offset = np.asarray(self.nodes[k].offset, dtype=float)
                    place = position.setdefault(joint, np.tile(offset, (len(self.values), 1)))
                    place[:, "XYZ".index(channel[0])] = self.values[:, column]
                else:
                    turns.append((channel[0], column))
            if turns:
                order = "".join(axis for axis, _ in turns)
                columns_by_order.setdefault(order, []).append((joint, [c for _, c in turns]))
        for start in range(0, len(self.values), _BLOCK):  # in blocks that stay in the processor's cache
            block = slice(start, start + _BLOCK)
            for order, rows in columns_by_order.items():
                angles = np.deg2rad(self.values[block][:, [columns for _, columns in rows]])
                turned = quaternion_canonical(euler_to_quaternion(angles, order))
                rotation[block][:, [joint for joint, _ in rows]] = turned
        return position, rotation


def parse_bvh(data: bytes, path: Path) -> BvhFile:
    """Parse a file's bytes, wherever they are from; `path` names it in messages.

    Raises BodysenseError, naming the file, what is wrong and the fix, for anything that is not such a file.
    """
    check_plain(data[:64], path)
    if not data.removeprefix(b"\xef\xbb\xbf").lstrip()[:9].upper() == b"HIERARCHY":
        raise BodysenseError(f"{path}: is not a BVH file: it does not begin with HIERARCHY")
    motion = _MOTION.search(data)
    if motion is None:
        raise BodysenseError(f"{path}: there is no MOTION section; the file is cut off, copy or export it again")
    nodes = _parse_hierarchy(path, data[: motion.start()].decode("utf-8-sig", errors="replace"))
    values, frame_rate = _parse_motion(path, data, motion.end(), sum(len(node.channels) for node in nodes))
    return BvhFile(path, tuple(nodes), values, frame_rate)


def unique(names: list[str]) -> tuple[str, ...]:
    """The names, numbered from the second on where they repeat: a_end, a_end2."""
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


def _parse_hierarchy(path: Path, text: str) -> list[Node]:
    """The joints and End Sites of a file, parents before children."""
    nodes: list[Node] = []
    stack: list[int] = []
    declared: int | None = None  # a node whose '{' is still to come
    place = re.compile(r"\s*HIERARCHY", re.IGNORECASE).match(text).end()  # type: ignore[union-attr]
    end = len(text.rstrip())
    while place < end:
        token = _TOKEN.match(text, place)

        def broken(what: str, at: int = place) -> BodysenseError:
            line = text.count("\n", 0, at + len(text[at:]) - len(text[at:].lstrip())) + 1
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
        said = "has commas for decimal points; put points" if "," in text else "is not three numbers"
        raise broken(f"OFFSET {' '.join(text.split())!r} {said}") from None
    if not sound(np.array(numbers)).all():
        raise broken(f"OFFSET {' '.join(text.split())!r} is not finite, or beyond {HUGE:g}")
    return numbers


def _parse_motion(path: Path, data: bytes, start: int, channels: int) -> tuple[np.ndarray, float]:
    """The motion block (frames, channels) and the frame rate."""
    timing = _TIMING.match(data, start)
    if timing is None:
        raise BodysenseError(f"{path}: 'Frames:' and 'Frame Time:' must follow MOTION; the file is cut off or damaged")
    frames = int(timing[1])
    try:
        frame_time = float(timing[2])
    except ValueError:
        frame_time = float("nan")
    if not (np.isfinite(frame_time) and 1e-5 <= frame_time <= 1e3):
        raise BodysenseError(
            f"{path}: Frame Time is {timing[2].decode(errors='replace')!r}; it must be seconds, e.g. 0.0333333"
        )
    if not frames or not channels:
        raise BodysenseError(f"{path}: {frames} frames of {channels} channels are no motion; export it again")
    block = with_plain_nan(data[timing.end() :].strip())
    values = np.empty(0)
    if block:  # np.fromstring reads one number from a blank text
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", DeprecationWarning)  # before NumPy 2.3 unread text is only a warning
                values = np.fromstring(block, sep=" ")
        except (ValueError, DeprecationWarning):
            raise BodysenseError(
                f"{path}: {_first_bad_number(block)!r} in the motion is not a number; mend that frame"
            ) from None
    if values.size != frames * channels:
        rows, rest = divmod(values.size, channels)
        raise BodysenseError(
            f"{path}: 'Frames: {frames}' announces {frames * channels} values ({channels} channels), but there are "
            f"{rows} whole frames{f' and {rest} values' if rest else ''}; correct that number, or export the file again"
        )
    values = values.reshape(frames, channels)
    if not (good := sound(values)).all():
        row, column = (int(k) for k in np.argwhere(~good)[0])
        beyond = f" ({values[row, column]:g}, beyond {HUGE:g})" if np.isfinite(values[row, column]) else ""
        raise BodysenseError(
            f"{path}: frame {row} is not finite{beyond}; cut or mend it, or fill it: "
            f"bodysense track {path.name} -o filled.bvh"
        )
    rate = 1 / frame_time
    return values, float(round(rate)) if abs(rate - round(rate)) < 1e-4 * rate else rate


def with_plain_nan(block: bytes) -> bytes:
    """Return a motion block in which every spelling of NaN (1.#IND, -nan(ind)) is 'nan'."""
    return _NOT_A_NUMBER.sub(b"nan", block) if b"#" in block or b"(" in block else block


def _first_bad_number(block: bytes) -> str:
    for word in block.split():
        try:
            float(word)
        except ValueError:
            return word[:40].decode(errors="replace")
    return block[-40:].decode(errors="replace")
