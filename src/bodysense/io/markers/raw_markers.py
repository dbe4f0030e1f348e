"""Raw markers of a file or a stream, and their conversion to our names, unit and axes."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from bodysense.body.hands.glove import MARKERS, side_of, standard_marker
from bodysense.body.hands.glove_set import GloveSet, packaged_sets, standard_set
from bodysense.body.hands.hand import glove_marker
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import read_text
from bodysense.observing.observation import OPTICAL_ACCURACY, Observation, accuracy_like

if TYPE_CHECKING:
    from bodysense.io.markers.body_layout import MarkerLayout

Unit = Literal["m", "cm", "mm", "in", "ft"]
Up = Literal["y", "z"]
METRES: dict[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
_LISTED = 6  # names that a message lists


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of a text file in which the positions of markers are, for writing the file again."""

    delimiter: str
    lines: tuple[int, ...]  # the line of every frame in the file, from 1
    columns: np.ndarray = field(repr=False)  # (M, 3) of x, y and z; -1: not a marker (a bone, a rigid body)
    valid: Mapping[int, int] = field(default_factory=dict)  # marker → its column of 1 (seen) and 0 (hidden)


@dataclass(frozen=True, eq=False)
class FileWorld:
    """The transform between a file's unit and axes and our world, where the floor under the body is y = 0."""

    axes: np.ndarray  # (3, 3) m per unit of the file: ours = file @ axes
    floor: float = 0.0  # m, the floor's height before it was moved to 0

    def to_ours(self, position: np.ndarray) -> np.ndarray:
        """Return positions (..., 3) of the file in our world, metres."""
        with np.errstate(invalid="ignore", over="ignore"):
            return position @ self.axes - np.array([0.0, self.floor, 0.0])

    def to_file(self, position: np.ndarray) -> np.ndarray:
        """Return positions (..., 3) of our world in the file's unit and axes."""
        return (position + np.array([0.0, self.floor, 0.0])) @ np.linalg.inv(self.axes)


@dataclass(frozen=True, eq=False)
class RawMarkers:
    """Unconverted points: any names, unit and axes; NaN where missing."""

    names: tuple[str, ...]
    position: np.ndarray  # (T, M, 3)
    time: np.ndarray  # (T,) s
    frame_rate: float  # Hz
    unit: Unit = "m"
    # (3, 3): our axes, rows, in the file's. None: unknown, and +Y is up.
    axes: np.ndarray | None = field(default=None, repr=False)
    # (T, M, 4) wxyz, the file's world ← the marker, of rigid bodies and bones; NaN where unknown.
    rotation: np.ndarray | None = field(default=None, repr=False)
    cells: Cells | None = field(default=None, repr=False)  # for text files of markers
    remarks: tuple[str, ...] = ()  # doubts about the file
    warnings: tuple[str, ...] = ()  # content of the file that is not read


@dataclass(frozen=True, eq=False)
class MarkerRecording:
    """The content of a marker file."""

    observation: Observation  # (T, …) joints of a body, and points '<hand>_glove_<marker>'; world
    frame_rate: float  # Hz
    sizes: dict[str, float]  # of every hand seen well, as a factor of the default skeleton's
    remarks: tuple[str, ...]  # one sentence each: what was recognised, is doubtful or was left out
    raw: RawMarkers  # unconverted
    world: FileWorld  # between the file and our world
    layout: MarkerLayout | None = None  # of its body, whose proportions can be inferred
    warnings: tuple[str, ...] = ()  # labels that are dropped, and limbs that are guessed
    arms_hang: bool = False  # nothing above the pelvis is known

    @property
    def has_body(self) -> bool:
        """Whether the file has the markers of a body, not of gloves alone."""
        return self.layout is not None


@dataclass(frozen=True)
class MarkerFormat:
    """Facts that a file omits or has wrong. None keeps the file's own; CSV is metres and +Y up."""

    names: Mapping[str, str] | None = None  # its markers' names → ours, 'left_glove_index_tip' …
    unit: Unit | None = None
    up: Up | None = None
    left_handed: bool = False  # axes as Unity's and Unreal's: the world is mirrored
    rate: float | None = None  # Hz, for files without a rate
    glove_set: GloveSet | None = None  # the marker set of the gloves; None: a packaged one, found by the labels
    floor: float | None = None  # m, the floor's height in our world; None: inferred from the body's feet
    figure: int | None = None  # which of several people in a file, from 1

    def __post_init__(self) -> None:
        if self.rate is not None and not 0 < self.rate < float("inf"):
            raise BodysenseError(f"{self.rate:g} Hz is no frame rate; give a positive number, e.g. 60")


def read_names(path: str | Path) -> dict[str, str]:
    """Read a table of names: JSON, {"LEHAR": "left_glove_pinky_base", "M7": "left_elbow", …}, or CSV, one pair a line.

    Raises BodysenseError for other content, for a name that is not a marker's and for a repeated name.
    """
    path = Path(path)
    text = read_text(path)
    if path.suffix.lower() == ".json":
        try:
            pairs = json.loads(text, object_pairs_hook=list)
        except (ValueError, RecursionError):
            raise BodysenseError(f"{path}: not JSON; give an object of names, theirs to ours") from None
    else:
        pairs = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines()) if any(row)]
    well_formed = isinstance(pairs, list) and all(
        isinstance(pair, list | tuple) and len(pair) == 2 and all(isinstance(name, str) for name in pair)
        for pair in pairs
    )
    if not well_formed or not pairs:
        raise BodysenseError(f"{path}: a table of names has pairs: the marker's name in the file, and ours")
    for theirs, ours in pairs:
        if standard_marker(ours) is None and ours not in default_skeleton().points:
            raise BodysenseError(
                f"{path}: {ours!r} (for {theirs!r}) is no marker; give a joint, such as 'left_elbow', or "
                f"'<hand>_glove_<marker>' with the hand 'left' or 'right' and one of {', '.join(MARKERS)}"
            )
    for column in zip(*pairs, strict=True):
        twice = [name for name in column if column.count(name) > 1]
        if twice:
            raise BodysenseError(f"{path}: {twice[0]!r} stands twice; every marker has one name")
    return dict(pairs)


def glove_labels(raw: RawMarkers, form: MarkerFormat) -> dict[str, str]:
    """Return the names of a file that are markers of gloves, and ours."""
    return {name: ours for name, ours in zip(raw.names, _named(raw.names, form), strict=True) if ours is not None}


def observed_markers(raw: RawMarkers, form: MarkerFormat, place: str) -> tuple[Observation, list[str]]:
    """Return the markers with a known name as an Observation, and remarks on the others.

    `place` names the file in messages. Raises BodysenseError for repeated names and for a file without a glove.
    """
    ours = _our_names(raw, form, place)
    here = [k for k, name in enumerate(ours) if name is not None]
    remarks = []
    others = [name for name, known in zip(raw.names, ours, strict=True) if known is None]
    if others:
        remarks.append(f"left out {listed(others)}: no markers of a glove by name")
    points = tuple(name for name in ours if name is not None)
    for hand in dict.fromkeys(point.partition("_glove_")[0] for point in points):
        missing = [name for name in (form.glove_set or standard_set()).names if f"{hand}_glove_{name}" not in points]
        if missing:
            remarks.append(f"the {hand} glove lacks {listed(missing)}")
    return points_alone(points, convert_world(raw.position[:, here], raw, form), raw.time), remarks


def points_alone(names: tuple[str, ...], position: np.ndarray, time: np.ndarray) -> Observation:
    """Return an observation of positions (T, P, 3) m, world, without rotations; NaN where hidden."""
    seen = np.asarray(np.isfinite(position).all(axis=-1))
    return Observation(
        points=names,
        position=np.where(seen[..., None], position, np.nan),
        rotation=np.full((*seen.shape, 4), np.nan),
        has_position=seen,
        has_rotation=np.zeros_like(seen),
        accuracy=accuracy_like(seen, OPTICAL_ACCURACY),
        time=time,
    )


def world_of(raw: RawMarkers, form: MarkerFormat, floor: float = 0.0) -> FileWorld:
    """Return the transform of a file, `floor` m being the floor's height in our axes."""
    return FileWorld(convert_world(np.eye(3), raw, form), floor)


def convert_world(position: np.ndarray, raw: RawMarkers, form: MarkerFormat) -> np.ndarray:
    """Return positions (..., 3) of a file in our world: metres, +Y up, right-handed."""
    with np.errstate(invalid="ignore", over="ignore"):
        return (position * METRES[form.unit or raw.unit]) @ file_axes(raw, form).T


def file_axes(raw: RawMarkers, form: MarkerFormat) -> np.ndarray:
    """Return our axes (3, 3), rows, in the file's; of a left-handed file they are mirrored."""
    axes = AXES[form.up] if form.up is not None else AXES["y"] if raw.axes is None else raw.axes
    return axes * [[-1.0], [1.0], [1.0]] if form.left_handed else axes


AXES = {"y": np.eye(3), "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])}


def _our_names(raw: RawMarkers, form: MarkerFormat, place: str) -> list[str | None]:
    """Return our name of every marker of a file, or None for markers that are not of a glove."""
    twice = [name for name in raw.names if raw.names.count(name) > 1]
    if twice:
        raise BodysenseError(f"{place}: the marker {twice[0]!r} stands twice; every marker has one name")
    ours = _named(raw.names, form)
    known = [name for name in ours if name is not None]
    if not known:
        raise BodysenseError(
            f"{place}: no marker of a glove among {listed(raw.names)}; give their positions with --marker-set, or "
            "a table of names with --names (docs/gloves.md)"
        )
    twice = [name for name in known if known.count(name) > 1]
    if twice:
        pair = [theirs for theirs, name in zip(raw.names, ours, strict=True) if name == twice[0]]
        raise BodysenseError(f"{place}: {listed(pair)} are both {twice[0]!r}; every marker has one name")
    for name in known:
        side_of(name)
    return ours


def _named(names: Sequence[str], form: MarkerFormat) -> list[str | None]:
    """Return our name of every marker, or None: by the given table, by its own name, or by its label in a set."""
    table = form.names or {}
    known: dict[str, str] = {}
    if not table or form.glove_set is not None:
        for one in packaged_sets().values() if form.glove_set is None else (form.glove_set,):
            known = one.points(names) | known
    return [_our_name(name, table, form.glove_set) or known.get(name) for name in names]


def _our_name(name: str, table: Mapping[str, str], glove_set: GloveSet | None) -> str | None:
    """Return our name of a marker by the table or by its own name, ignoring a 'Subject:' prefix; or None."""
    bare = name.rpartition(":")[2].strip()
    for candidate in (name, bare):
        if candidate in table:
            return table[candidate] if glove_marker(table[candidate]) else None
    names = MARKERS if glove_set is None else glove_set.names
    for candidate in (name,) if table else (bare, bare.lower()):
        found = glove_marker(candidate)
        if found and found[1] in names:
            return candidate if candidate not in table.values() else None
    return None


def listed(names: tuple[str, ...] | list[str]) -> str:
    """Join names for a message; of many, the first ones."""
    listed = ", ".join(repr(name) for name in names[:_LISTED])
    return listed if len(names) <= _LISTED else f"{listed} and {len(names) - _LISTED} more"
