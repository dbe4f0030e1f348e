"""Store: a folder of motion prepared for training, as one chunked Zarr group (version 3).

    rotation       (N, 52, 4) float32   all frames of all clips, concatenated, at one frame rate
    root_position  (N, 3)     float32
    rest_offset    (C, 65, 3) float32   the body of each clip
    attributes     format, rate, joints, end_sites, clips (a row each: start, length, person, …), skipped (reasons),
                   bodies (height and floor of each person in AMASS, inferred from the motions: `io.placement`)

`preparation` writes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError, missing_package
from bodysense.geometry.rotation import normalize
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split

if TYPE_CHECKING:
    from bodysense.io.placement import BodyPlacement

FORMAT = "bodysense-motion-1"
ARRAYS = {"rotation": (52, 4), "root_position": (3,), "rest_offset": (65, 3)}  # shape of one row of each array


@dataclass(frozen=True)
class StoredClip:
    """A row of the store's table."""

    name: str
    source: str  # path in the original folder
    sha256: str  # of that file
    start: int  # first frame
    length: int
    person: str
    split: Split
    category: str
    has_fingers: bool


@dataclass(frozen=True)
class Skipped:
    """A file that could not be read, and the reason."""

    source: str
    sha256: str
    reason: str


@dataclass(frozen=True)
class Table:
    """Table of a store's clips."""

    rate: float  # Hz
    clips: tuple[StoredClip, ...] = ()
    skipped: tuple[Skipped, ...] = ()
    bodies: Mapping[str, BodyPlacement] = field(default_factory=dict)  # by person, of AMASS without known skeletons

    @property
    def frames(self) -> int:
        """Number of frames of all clips."""
        return sum(row.length for row in self.clips)


@dataclass(frozen=True, eq=False)
class Store:
    """A store open for reading. The arrays are on disk; slices of them are read on demand."""

    table: Table
    rotation: Any  # (N, 52, 4) float32, Zarr
    root_position: Any  # (N, 3) float32, Zarr
    rest_offset: np.ndarray  # (C, 65, 3)

    def clip(self, index: int) -> Clip:
        """Return one clip in canonical form."""
        row = self.table.clips[index]
        frames = slice(row.start, row.start + row.length)
        skeleton = default_skeleton().with_offsets(self.rest_offset[index])
        rotation = normalize(np.asarray(self.rotation[frames], dtype=np.float64))
        pose = Pose(skeleton, np.asarray(self.root_position[frames], dtype=np.float64), rotation)
        return Clip(row.name, pose, self.table.rate, row.person, row.category, row.has_fingers)


def read_store(path: str | Path) -> Store:
    """Open a store for reading. Raises BodysenseError if `path` is not a finished store."""
    zarr = zarr_package()
    if not is_store(path):
        raise BodysenseError(f"{path}: not a store of motion; make one with `bodysense data prepare FOLDER -o {path}`")
    try:
        group = zarr.open_group(Path(path), mode="r")
        if group.attrs.get("format") != FORMAT or not group.attrs.get("complete"):
            raise BodysenseError(f"{path}: not a finished store of this version; run `bodysense data prepare` again")
        table = read_table(group)
        if [group[key].shape for key in ARRAYS] != [
            (table.frames, 52, 4),
            (table.frames, 3),
            (len(table.clips), 65, 3),
        ]:
            raise BodysenseError(f"{path}: its arrays do not match its table; remove it and prepare it again")
        rotation, root_position, rest_offset = (group[key] for key in ARRAYS)
        return Store(table, rotation, root_position, np.asarray(rest_offset[:]))
    except (KeyError, TypeError, ValueError, AttributeError, OSError) as error:
        raise BodysenseError(f"{path}: the store is damaged ({error!r}); remove it and prepare it again") from error


def is_store(path: str | Path) -> bool:
    """Return whether a folder is a Zarr group, as a store is."""
    return (Path(path) / "zarr.json").is_file()


def read_table(group: Any) -> Table:
    """Return the table in the attributes of a group."""
    from bodysense.io.placement import BodyPlacement

    clips = tuple(StoredClip(**row) for row in group.attrs["clips"])
    skipped = tuple(Skipped(**row) for row in group.attrs["skipped"])
    bodies = {person: BodyPlacement(**row) for person, row in group.attrs.get("bodies", {}).items()}
    return Table(float(group.attrs["rate"]), clips, skipped, bodies)


def zarr_package() -> Any:
    """Import Zarr. Raises BodysenseError, naming the extra, if it is not installed."""
    try:
        import zarr
    except ImportError as error:
        raise missing_package(error) from None
    return zarr
