"""Marker files by their endings, and their options: facts that a file omits or has wrong.

Opening any source needs these, so the modules that read markers are imported when they are used.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

from bodysense.errors import BodysenseError
from bodysense.io.formats.point_layouts import Layout
from bodysense.io.reading_options import ReadingOptions

if TYPE_CHECKING:
    from bodysense.body.hands.glove_set import GloveSet
    from bodysense.io.markers.raw_markers import MarkerFormat, Unit, Up

ENDINGS = (".c3d", ".csv", ".trc", ".tsv")


def is_marker_file(path: str | Path) -> bool:
    """Whether a file is one of markers, by its ending."""
    return Path(path).suffix.lower() in ENDINGS


@dataclass(frozen=True)
class MarkerOptions:
    """Facts that a marker file (.c3d, .csv, .trc, .tsv) omits or has wrong."""

    marker_set: str | None = None
    """Marker set of gloves (the segment of each marker): a .toml or .json file or a packaged set (docs/gloves.md);
    inferred from the labels if omitted.
    """
    names: Path | None = None
    """Table of a marker file's names and ours, .json or .csv (docs/markers.md)."""
    points: Layout | None = None
    """Layout of an array of points (.npy, .npz, pickles), which omits their names: mediapipe, coco, h36m, halpe, ntu,
    smpl, or humanml3d (263 numbers a frame).
    """
    rate: float | None = None
    """Frames per second, for files without a rate."""
    unlabelled: Literal["left", "right", "both"] | None = None
    """The markers have no identities (passive markers); these gloves are found among them."""

    def form(self, reading: ReadingOptions) -> MarkerFormat:
        """Return these options in the readers' format. Raises BodysenseError for values that marker files lack."""
        from bodysense.io.markers.raw_markers import METRES, MarkerFormat, read_names

        for option, value, valid in (("--unit", reading.unit, (*METRES,)), ("--up", reading.up, ("y", "z"))):
            if value not in (None, *valid):
                raise BodysenseError(f"{option} {value}: of marker files it is one of {', '.join(valid)}")
        if more := [option for option in reading.for_motions() if option != "--figure"]:
            raise BodysenseError(f"{', '.join(more)}: for motions, not for marker files; leave it out")
        names = None if self.names is None else read_names(self.names)
        unit, up = cast("Unit | None", reading.unit), cast("Up | None", reading.up)
        return MarkerFormat(
            names, unit, up, reading.left_handed, self.rate, self.glove_set(), reading.floor, reading.figure
        )

    def glove_set(self) -> GloveSet | None:
        """Return the gloves' marker set, if one is given."""
        if self.marker_set is None:
            return None
        from bodysense.body.hands.glove_set import read_set

        return read_set(self.marker_set)


NO_OPTIONS = MarkerOptions()
