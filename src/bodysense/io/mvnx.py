"""MVNX files of Xsens MVN: places and rotations of 23 segments in a frame, as XML.

Positions are metres, quaternions wxyz take a segment to the world, which is right-handed with +Z up. A segment's origin
is the joint that it turns about. Frames of type `identity`, `tpose` and `npose` are no motion. The file is parsed as a
stream: declarations of entities, which can grow without bound, are refused.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn, Self
from xml.parsers import expat

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import sound
from bodysense.geometry.rotation import (
    normalize,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_euler,
)
from bodysense.io.rigs.joint_file import JointFile, Node
from bodysense.observing.world_axes import UpAxis

ENDING = ".mvnx"
_ORDER = "ZXY"
_MOTION = ("normal", "")  # types of frames
_DEEPEST = 32  # elements inside one another
_RIGID = 1e-3  # m; a segment whose place in its parent varies by less has a constant offset
_UNIT_LENGTH = 0.05  # by which the length of a quaternion may differ from 1
_CARRIERS = {  # segment → the one that carries it
    **{"L5": "Pelvis", "L3": "L5", "T12": "L3", "T8": "T12", "Neck": "T8", "Head": "Neck"},
    **{
        f"{side}{part}": carrier if carrier in ("T8", "Pelvis") else f"{side}{carrier}"
        for side in ("Right", "Left")
        for part, carrier in (
            *(("Shoulder", "T8"), ("UpperArm", "Shoulder"), ("ForeArm", "UpperArm"), ("Hand", "ForeArm")),
            *(("UpperLeg", "Pelvis"), ("LowerLeg", "UpperLeg"), ("Foot", "LowerLeg"), ("Toe", "Foot")),
        )
    },
}


class MvnxFile(JointFile):
    """An MVNX file as joints and channels. It is read only."""

    @property
    def unit(self) -> str | None:
        """Length unit of the format."""
        return "m"

    @property
    def up(self) -> UpAxis | None:
        """Upward axis of the format."""
        return "z"

    def with_values(self, values: np.ndarray, changed: np.ndarray) -> Self:
        """Raise BodysenseError: MVNX is not written."""
        self._refuse()

    def with_frames(self, row: np.ndarray, count: int, frame_rate: float) -> Self:
        """Raise BodysenseError: MVNX is not written."""
        self._refuse()

    def write(self, path: str | Path) -> None:
        """Raise BodysenseError: MVNX is not written."""
        self._refuse()

    def _refuse(self) -> NoReturn:
        raise BodysenseError(f"{self.path}: MVNX is read and not written; give a name that ends in .bvh or .fbx")


@dataclass
class _MvnPerson:
    """A person of a file."""

    rate: str
    segments: list[str] = field(default_factory=list)
    orientation: list[np.ndarray] = field(default_factory=list)
    position: list[np.ndarray] = field(default_factory=list)


def parse_mvnx(data: bytes, path: Path) -> MvnxFile:
    """Parse a file's bytes; `path` names it in messages.

    Raises BodysenseError, naming the file and the fix, for anything that is not such a file.
    """
    parser = _Parser(path)
    subjects = parser.parse(data)
    if not subjects or not any(subject.position for subject in subjects):
        raise BodysenseError(f"{path}: no frames of motion in it; export the take from MVN again, with its frames")
    counts = {len(subject.position) for subject in subjects}
    rates = {subject.rate for subject in subjects}
    if len(counts) > 1 or len(rates) > 1:
        raise BodysenseError(f"{path}: its people have different frames; export each of them alone")
    rate = _rate_of(path, rates.pop())
    tree: list[Node] = []
    values: list[np.ndarray] = []
    for subject in subjects:
        nodes, columns = _joints_of(path, subject, len(tree))
        tree += nodes
        values += columns
    offset = np.array([node.offset for node in tree], dtype=float)
    return MvnxFile(
        path=path,
        tree=tuple(tree),
        nodes=tuple(range(len(tree))),
        joints=tuple(node.name for node in tree),
        parents=tuple(node.parent for node in tree),
        offset=offset,
        channels=tuple(node.channels for node in tree),
        values=np.concatenate(values, axis=1),
        frame_rate=rate,
    )


def _rate_of(path: Path, text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 0 < rate < 1e5:
        raise BodysenseError(f"{path}: frameRate is {text!r}; it must be a number of Hz, such as 60")
    return rate


def _joints_of(path: Path, subject: _MvnPerson, first: int) -> tuple[list[Node], list[np.ndarray]]:
    """Return the joints of a person, the first of which has the number `first`, and their channels (T, C)."""
    names, count = subject.segments, len(subject.segments)
    if "Pelvis" not in names or len(set(names)) < count:
        raise BodysenseError(f"{path}: its segments are {', '.join(names[:6]) or 'missing'} …, not those of MVN")
    sizes = {*(len(row) for row in subject.orientation)} | {*(len(row) * 4 // 3 for row in subject.position)}
    if sizes != {4 * count} or len(subject.orientation) != len(subject.position):
        raise BodysenseError(f"{path}: a frame has not {count} orientations and positions; was the file cut short?")
    turn = np.array(subject.orientation).reshape(-1, count, 4)
    place = np.array(subject.position).reshape(-1, count, 3)
    length = np.linalg.norm(turn, axis=-1)
    if not (sound(turn).all() and sound(place).all() and (np.abs(length - 1) < _UNIT_LENGTH).all()):
        frame = int(np.argmax(~(sound(place).all(axis=(1, 2)) & (np.abs(length - 1) < _UNIT_LENGTH).all(axis=1))))
        raise BodysenseError(f"{path}: frame {frame} is not finite, or no rotation; export the take again")
    turn = normalize(turn)
    order: list[str] = []  # parents before children
    while len(order) < len(names):
        order += [name for name in names if name not in order and _carrier(name, names) in (None, *order)]
    nodes, columns = [], []
    for name in order:
        k = names.index(name)
        carrier = _carrier(name, names)
        local, at = turn[:, k], place[:, k]
        if carrier is not None:
            above = names.index(carrier)
            back = quaternion_conjugate(turn[:, above])
            local, at = quaternion_multiply(back, local), quaternion_rotate(back, at - place[:, above])
        offset = np.median(at, axis=0)
        moves = carrier is None or np.abs(at - offset).max() > _RIGID
        kinds = (["position"] if moves else []) + ["rotation"]
        channels = tuple(f"{axis}{kind}" for kind in kinds for axis in ("XYZ" if kind == "position" else _ORDER))
        parent = -1 if carrier is None else first + order.index(carrier)
        nodes.append(Node(name, parent, False, tuple(offset.tolist()), channels))
        columns += [at] if moves else []
        columns.append(np.rad2deg(quaternion_to_euler(local, _ORDER)))
    return nodes, columns


def _carrier(name: str, names: list[str]) -> str | None:
    """Return the segment of the file that carries another one; unknown segments hang on the pelvis."""
    above = _CARRIERS.get(name, None if name == "Pelvis" else "Pelvis")
    while above is not None and above not in names:
        above = _CARRIERS.get(above)
    return above


class _Parser:
    """A stream parser of the elements that matter; the depth of elements is bounded, and entities are refused."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._depth = 0
        self._is_motion = False
        self._text: list[str] | None = None
        self._subjects: list[_MvnPerson] = []

    def parse(self, data: bytes) -> list[_MvnPerson]:
        """Return the people of a file."""
        parser = expat.ParserCreate()
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
        parser.CharacterDataHandler = self._data
        parser.EntityDeclHandler = self._entity
        parser.buffer_text = True
        try:
            parser.Parse(data, True)
        except expat.ExpatError as error:
            raise BodysenseError(f"{self._path}: not XML of MVN ({error}); export the take again") from None
        return self._subjects

    def _entity(self, *_: object) -> None:
        raise BodysenseError(f"{self._path}: it declares entities, which no MVNX file has; export the take again")

    def _start(self, element: str, values: dict[str, str]) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise BodysenseError(f"{self._path}: more than {_DEEPEST} elements in one another; export the take again")
        if self._depth == 1 and element != "mvnx":
            raise BodysenseError(
                f"{self._path}: it begins with <{element[:40]}>, not with <mvnx>; export the take again"
            )
        if element == "subject":
            self._subjects.append(_MvnPerson(values.get("frameRate", "")))
        elif element == "segment" and self._subjects:
            self._subjects[-1].segments.append(values.get("label", ""))
        elif element == "frame":
            self._is_motion = values.get("type", "") in _MOTION
        elif element in ("orientation", "position") and self._is_motion and self._subjects:
            self._text = []

    def _end(self, element: str) -> None:
        self._depth -= 1
        if element == "frame":
            self._is_motion = False
        if element in ("orientation", "position") and self._text is not None:
            text, self._text = "".join(self._text), None
            try:
                numbers = np.array(text.split(), dtype=float)
            except ValueError:
                frame = len(self._subjects[-1].position)
                raise BodysenseError(
                    f"{self._path}: frame {frame}: not numbers in <{element}>; export it again"
                ) from None
            getattr(self._subjects[-1], element).append(numbers)

    def _data(self, text: str) -> None:
        if self._text is not None:
            self._text.append(text)
