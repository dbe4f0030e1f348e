"""What a user says of a motion file; what is left out is found in the file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from bodysense.errors import BodysenseError

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
UpAxis = Literal["x", "y", "z", "-x", "-y", "-z"]


@dataclass(frozen=True)
class ReadingOptions:
    """What a motion file does not say of itself, or says wrongly."""

    unit: str | None = None
    """length unit of the file: m, cm, mm, in, ft, or metres, as 0.056444; found from the body if omitted."""
    up: UpAxis | None = None
    """upward axis of the file; found from the motion if omitted."""
    floor: float | None = None
    """height of the floor in the file, metres along the upward axis; found from the feet if omitted."""
    height: float | None = None
    """height of the body in metres, to which the motion is scaled; the file's if omitted."""
    joints: Path | None = None
    """which joint is which: a JSON file, drafted by `bodysense data joints`; found from the skeleton if omitted."""
    figure: int | None = None
    """which body of a file of several, counted from 1."""

    def __post_init__(self) -> None:
        if self.unit is not None:
            _ = self.metres
        if self.figure is not None and self.figure < 1:
            raise BodysenseError(f"--figure {self.figure}: bodies are counted from 1")
        if self.height is not None and not 0.3 <= self.height <= 3.0:
            raise BodysenseError(f"--height {self.height:g}: not a person's; give metres between 0.3 and 3.0")
        if self.floor is not None and not abs(self.floor) <= 1000:
            raise BodysenseError(f"--floor {self.floor:g}: give metres between -1000 and 1000")

    @property
    def metres(self) -> float | None:
        """Metres of one unit of the file; None where it is not told."""
        if self.unit is None:
            return None
        try:
            metres = UNITS.get(self.unit) or float(self.unit)
        except ValueError:
            metres = 0.0
        if not 1e-6 < metres < 1e4:
            raise BodysenseError(f"--unit {self.unit}: give {', '.join(UNITS)}, or the metres of one unit, as 0.056444")
        return metres


AS_FOUND = ReadingOptions()
