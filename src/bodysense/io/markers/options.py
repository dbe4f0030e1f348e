"""Options of marker files: what a file does not say of itself, or says wrongly."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

from bodysense.body.glove_set import GloveSet, read_set
from bodysense.errors import BodysenseError
from bodysense.io.markers.raw_markers import METRES, MarkerFormat, Unit, Up, read_names
from bodysense.io.rigs.options import ReadingOptions


@dataclass(frozen=True)
class MarkerOptions:
    """What a marker file (.c3d, .csv, .trc, .tsv) does not say of itself, or says wrongly."""

    marker_set: str | None = None
    """Of gloves: which marker sits on which segment, a .toml or .json file or a packaged set's name (docs/gloves.md);
    by their labels if omitted."""
    names: Path | None = None
    """Of a marker file: a table of its names and ours, .json or .csv (docs/markers.md)."""
    left_handed: bool = False
    """Of a marker file: its axes are left-handed, as in Unity and Unreal."""
    rate: float | None = None
    """Of a file that does not say it: frames a second."""
    unlabelled: Literal["left", "right", "both"] | None = None
    """Of a marker file: its points are not told apart (passive markers); these gloves are found among them."""

    def form(self, reading: ReadingOptions) -> MarkerFormat:
        """Return these options as the readers take them. Raises BodysenseError for values that marker files lack."""
        if reading.unit not in (None, *METRES) or reading.up not in (None, "y", "z"):
            raise BodysenseError(f"--unit {reading.unit} --up {reading.up}: marker files are in m, cm or mm, y or z up")
        if more := reading.for_motions():
            raise BodysenseError(f"{', '.join(more)}: for motions, not for marker files; leave it out")
        names = None if self.names is None else read_names(self.names)
        unit, up = cast("Unit | None", reading.unit), cast("Up | None", reading.up)
        return MarkerFormat(names, unit, up, self.left_handed, self.rate, self.worn(), reading.floor)

    def worn(self) -> GloveSet | None:
        """Return the gloves' marker set, if one is given."""
        return None if self.marker_set is None else read_set(self.marker_set)


NO_OPTIONS = MarkerOptions()
