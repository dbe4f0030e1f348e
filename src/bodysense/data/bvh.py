"""BVH: reading and writing the text format of Biovision, in the file's own hierarchy and names.

A joint's channels turn it in the order they are listed (intrinsic: Zrotation Xrotation Yrotation is R = Rz · Rx · Ry);
position channels replace its OFFSET, as MotionBuilder and Blender have it.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.rotation import (
    euler_to_quaternion,
    quaternion_canonical,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_euler,
)
from bodysense.body.skeleton import Skeleton
from bodysense.data.clip import Z_UP_TO_Y_UP, Clip
from bodysense.errors import BodysenseError
from bodysense.files import written_beside

# Longest way along the bones from one end of a body to another (fingertip to toe, about 1.3 × stature), metres. It
# tells metres from centimetres whatever the rest pose, and refuses inches (an adult's reads as less than 1.2 m).
PLAUSIBLE_SPAN = (1.2, 4.0)
STRETCH = 0.02  # m: a bone whose length or place varies by more than this cannot be held by a rigid skeleton

_BLOCK = 256  # frames that are converted at once

_TOKEN = re.compile(
    r"\s*(?:(?P<open>\{)|(?P<close>\})"
    r"|(?P<root>ROOT\b|JOINT\b)[ \t]*(?P<name>[^\r\n{}]*)|(?P<end>End\s+Site\b)[^\r\n{}]*"
    r"|OFFSET(?P<offset>(?:\s+[^\s{}]+){3})"
    r"|CHANNELS\s+(?P<count>\d{1,2})\b(?P<channels>(?:\s+[XYZ](?:position|rotation)\b)*))",
    re.IGNORECASE,
)
_MOTION = re.compile(rb"^[ \t]*MOTION\b", re.MULTILINE)
_TIMING = re.compile(rb"\s*Frames\s*:\s*(\d{1,12})\s+Frame\s+Time\s*:\s*(\S+)", re.IGNORECASE)


@dataclass
class _Node:
    name: str
    parent: int  # among the nodes; -1 for the root
    is_site: bool
    offset: tuple[float, ...] | None = None
    channels: tuple[str, ...] = ()  # 'Xposition' …


def read_bvh(path: str | Path, unit: float | None = None, up: Literal["Y", "Z"] = "Y") -> Clip:
    """Read a BVH file: its own joints, names and rest pose; positions in metres.

    `unit` is the length of one file unit in metres. None tells metres, centimetres and millimetres apart by the
    longest way along the bones (`PLAUSIBLE_SPAN`), and is refused where none of them gives a person. `up` is the
    file's upward axis; a Z-up world is turned by -90° about X. An End Site is named after its joint, 'LeftToeBase_end',
    and dropped where it has no length. Frame times that round to a whole rate (0.0333333 s) give that rate.

    Joints other than the root may have position channels. Constant ones replace the offset (or, where they are all
    zero, add nothing to it); varying ones are averaged, and refused where a joint strays more than `STRETCH` from its
    mean. If a root only carries one moving joint, that joint becomes the root.

    Raises BodysenseError, naming the file, what is wrong and the fix, for anything that is not such a file.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror})") from None
    return parse_bvh(data, path, unit, up)


def parse_bvh(data: bytes, path: Path, unit: float | None = None, up: Literal["Y", "Z"] = "Y") -> Clip:
    """What `read_bvh` makes of a file's bytes, wherever they are from; `path` names it in messages and the clip."""
    if not data.removeprefix(b"\xef\xbb\xbf").lstrip()[:9].upper() == b"HIERARCHY":
        raise BodysenseError(f"{path}: is not a BVH file: it does not begin with HIERARCHY")
    motion = _MOTION.search(data)
    if motion is None:
        raise BodysenseError(f"{path}: there is no MOTION section; the file is cut off, copy or export it again")
    nodes = _parse_hierarchy(path, data[: motion.start()].decode("utf-8-sig", errors="replace"))
    values, frame_rate = _parse_motion(path, data, motion.end(), sum(len(node.channels) for node in nodes))
    position, rotation = _local_motion(nodes, values)
    return _clip(path, nodes, position, rotation, frame_rate=frame_rate, unit=unit, up=up)


def hierarchy_of(data: bytes, path: Path) -> tuple[list[tuple[str, int, tuple[str, ...]]], int]:
    """Name, parent among the joints and channels of each joint of a file's bytes, and where its motion begins."""
    if not data.removeprefix(b"\xef\xbb\xbf").lstrip()[:9].upper() == b"HIERARCHY":
        raise BodysenseError(f"{path}: is not a BVH file: it does not begin with HIERARCHY")
    motion = _MOTION.search(data)
    if motion is None:
        raise BodysenseError(f"{path}: there is no MOTION section; the file is cut off, copy or export it again")
    nodes = _parse_hierarchy(path, data[: motion.start()].decode("utf-8-sig", errors="replace"))
    place = {k: joint for joint, k in enumerate(k for k, node in enumerate(nodes) if not node.is_site)}
    return [(nodes[k].name, place.get(nodes[k].parent, -1), nodes[k].channels) for k in place], motion.end()


def timing_of(data: bytes, path: Path, start: int) -> tuple[int, float, int]:
    """Frames, seconds a frame, and where the first frame begins; `start` is where the motion begins."""
    timing = _TIMING.match(data, start)
    if timing is None:
        raise BodysenseError(f"{path}: 'Frames:' and 'Frame Time:' must follow MOTION; the file is cut off or damaged")
    return int(timing[1]), float(timing[2]), timing.end()


def write_bvh(path: str | Path, clip: Clip, unit: float = 0.01, order: str = "ZXY") -> None:
    """Write a clip as a BVH file of its own joints: positions in units of `unit` metres, angles in degrees.

    Every joint has rotation channels in `order`, the root position channels before them; both are written to six
    decimals. The file appears whole or not at all: it is written beside `path` and then renamed. Raises BodysenseError
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
    hierarchy, written = hierarchy_text(pose.skeleton, unit, order)
    with written_beside(path) as part, part.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"{hierarchy}MOTION\nFrames: {len(rotation)}\nFrame Time: {1 / frame_rate:.10g}\n")
        for start in range(0, len(rotation), _BLOCK):
            block = slice(start, start + _BLOCK)
            file.write(motion_text(root[block], rotation[block][:, written], unit, order))


def motion_text(root: np.ndarray, rotation: np.ndarray, unit: float, order: str) -> str:
    """Lines of the MOTION section: root (T, 3) m, local rotations (T, J, 4) in the order of the HIERARCHY section."""
    angles = np.rad2deg(quaternion_to_euler(rotation, order))
    values = np.concatenate([root / unit, angles.reshape(len(angles), -1)], axis=1)
    row = " ".join(["%.6f"] * values.shape[1]) + "\n"
    return row * len(values) % tuple(values.ravel().tolist())  # one formatting call, for speed


def hierarchy_text(skeleton: Skeleton, unit: float, order: str) -> tuple[str, list[int]]:
    """The HIERARCHY section, and the joints in the order in which they stand there."""
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


def _parse_hierarchy(path: Path, text: str) -> list[_Node]:
    """The joints and End Sites of a file, parents before children."""
    nodes: list[_Node] = []
    stack: list[int] = []
    declared: int | None = None  # a node whose '{' is still to come
    place = re.compile(r"\s*HIERARCHY", re.IGNORECASE).match(text).end()  # type: ignore[union-attr]
    while text[place:].strip():
        token = _TOKEN.match(text, place)

        def broken(what: str, at: int = place) -> BodysenseError:
            line = text.count("\n", 0, at + len(text[at:]) - len(text[at:].lstrip())) + 1
            return BodysenseError(f"{path}: line {line}: {what}; mend the file or export it again")

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
            if not stack and nodes:
                raise broken("a second ROOT; only files of one body can be read, so split it")
            if (token["end"] and not stack) or (stack and nodes[stack[-1]].is_site):
                raise broken("an End Site or joint that hangs on no joint")
            parent = stack[-1] if stack else -1
            name = f"{nodes[parent].name}_end" if token["end"] else token["name"].strip()
            if not name:
                raise broken("a joint without a name")
            declared = len(nodes)
            nodes.append(_Node(name, parent, bool(token["end"])))
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
        raise broken(f"OFFSET {' '.join(text.split())!r} is not three numbers") from None
    if not np.isfinite(numbers).all():
        raise broken(f"OFFSET {' '.join(text.split())!r} is not finite")
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
    block = data[timing.end() :].strip()
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
    if not np.isfinite(values).all():
        raise BodysenseError(
            f"{path}: frame {int(np.argwhere(~np.isfinite(values))[0][0])} is not finite; cut or mend it"
        )
    rate = 1 / frame_time
    return values, float(round(rate)) if abs(rate - round(rate)) < 1e-4 * rate else rate


def _first_bad_number(block: bytes) -> str:
    for word in block.split():
        try:
            float(word)
        except ValueError:
            return word[:40].decode(errors="replace")
    return block[-40:].decode(errors="replace")


def _local_motion(nodes: list[_Node], values: np.ndarray) -> tuple[dict[int, np.ndarray], np.ndarray]:
    """Place in the parent (T, 3), file units, of nodes with position channels; rotation (T, J, 4) of the joints."""
    joints = [k for k, node in enumerate(nodes) if not node.is_site]
    position: dict[int, np.ndarray] = {}
    rotation = np.zeros((len(values), len(joints), 4))
    rotation[..., 0] = 1
    columns_by_order: dict[str, list[tuple[int, list[int]]]] = {}
    column = 0
    for joint, k in enumerate(joints):
        turns: list[tuple[str, int]] = []
        for channel in nodes[k].channels:
            if channel.endswith("position"):
                place = position.setdefault(k, np.tile(np.asarray(nodes[k].offset, dtype=float), (len(values), 1)))
                place[:, "XYZ".index(channel[0])] = values[:, column]
            else:
                turns.append((channel[0], column))
            column += 1
        if turns:
            order = "".join(axis for axis, _ in turns)
            columns_by_order.setdefault(order, []).append((joint, [c for _, c in turns]))
    for start in range(0, len(values), _BLOCK):  # in blocks that stay in the processor's cache
        block = slice(start, start + _BLOCK)
        for order, rows in columns_by_order.items():
            angles = np.deg2rad(values[block][:, [columns for _, columns in rows]])
            rotation[block][:, [joint for joint, _ in rows]] = quaternion_canonical(euler_to_quaternion(angles, order))
    return position, rotation


def _clip(
    path: Path,
    nodes: list[_Node],
    position: dict[int, np.ndarray],
    rotation: np.ndarray,
    *,
    frame_rate: float,
    unit: float | None,
    up: Literal["Y", "Z"],
) -> Clip:
    """The clip of a parsed file: one root, rigid bones, metres, +Y up."""
    joints = [k for k, node in enumerate(nodes) if not node.is_site]
    offset = np.array([node.offset for node in nodes], dtype=float)
    for k, place in position.items():
        if k and np.any(place):
            offset[k] = place.mean(axis=0)
    sites = [k for k, node in enumerate(nodes) if node.is_site and np.any(offset[k])]
    unit = _unit(path, nodes, offset) if unit is None else unit
    if not (np.isfinite(unit) and unit > 0):
        raise BodysenseError(f"{path}: unit {unit:g} cannot be; give the metres of one file unit, e.g. 0.01")
    moving = {k: place for k, place in position.items() if k and np.any(place) and _stray(place) * unit > STRETCH}
    root = position.get(0, np.tile(offset[0], (len(rotation), 1)))
    first = 0
    while moving and next(iter(moving)) == first + 1 and [n.parent for n in nodes].count(first) == 1:
        first += 1  # a root that only carries one moving joint: that joint becomes the root
        root_rotation = rotation[:, 0]
        root = root + quaternion_rotate(root_rotation, moving.pop(first))
        rotation = rotation[:, 1:]
        rotation[:, 0] = quaternion_multiply(root_rotation, rotation[:, 0])
    if moving:
        k, place = next(iter(moving.items()))
        raise BodysenseError(
            f"{path}: {nodes[k].name!r} moves by {100 * unit * _stray(place):.1f} cm in its parent; bones may vary by "
            f"at most {100 * STRETCH:g} cm: export the motion with a rigid skeleton"
        )
    keep = [k for k in joints if k >= first] + sites
    index = {k: new for new, k in enumerate(keep)}
    rest_offset = offset[keep] * unit
    root = root * unit
    if up == "Z":
        root = quaternion_rotate(Z_UP_TO_Y_UP, root)
        rotation[:, 0] = quaternion_multiply(Z_UP_TO_Y_UP, rotation[:, 0])
    rotation[:, 0] = quaternion_canonical(rotation[:, 0])
    try:
        skeleton = Skeleton(
            joints=tuple(nodes[k].name for k in joints if k >= first),
            end_sites=_unique([nodes[k].name for k in sites], {nodes[k].name for k in joints}),
            parents=tuple(-1 if k == first else index[nodes[k].parent] for k in keep),
            rest_offset=rest_offset,
        )
    except BodysenseError as error:
        raise BodysenseError(f"{path}: {error}") from None
    return Clip(path.stem, Pose(skeleton, root, rotation), frame_rate)


def _stray(place: np.ndarray) -> float:
    """Largest distance from the mean."""
    return float(np.linalg.norm(place - place.mean(axis=0), axis=1).max())


def _unique(names: list[str], taken: set[str]) -> tuple[str, ...]:
    """The names, numbered from the second on where they repeat: a_end, a_end2."""
    result: list[str] = []
    for name in names:
        number, choice = 1, name
        while choice in taken:
            number += 1
            choice = f"{name}{number}"
        taken = taken | {choice}
        result.append(choice)
    return tuple(result)


def _unit(path: Path, nodes: list[_Node], offset: np.ndarray) -> float:
    """Metres of one file unit, from the longest way along the bones."""
    length = np.linalg.norm(offset, axis=1)
    deepest = np.zeros(len(nodes))
    span = 0.0
    for k in range(len(nodes) - 1, 0, -1):
        reach, parent = deepest[k] + length[k], nodes[k].parent
        span = max(span, float(deepest[parent] + reach))
        deepest[parent] = max(deepest[parent], reach)
    low, high = PLAUSIBLE_SPAN
    for unit in (1.0, 0.01, 0.001):
        if low <= span * unit <= high:
            return unit
    raise BodysenseError(
        f"{path}: from end to end the body measures {span:g} units, a person's neither in metres, centimetres nor "
        f"millimetres ({low:g} to {high:g} m); give unit=, the metres of one unit (0.056444 for CMU by cgspeed)"
    )
