"""Options of rendering videos."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from bodysense.errors import BodysenseError
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.ranges import Count, Seed
from bodysense_lab.core.options import Flat, Output, Split


@dataclass(frozen=True, kw_only=True)
class Rendering:
    """Videos of motion, with their truth."""

    out: Output
    """folder of the set: NAME.mp4 and NAME.npz"""
    motion: Positional[Path | None] = None
    """folder of motion files, prepared store, or one file; scripted gestures of arms if omitted"""
    videos: Count = 24
    """number of videos, spread over the clips"""
    seconds: float = 6.0
    """maximum length of each video"""
    split: Split = "test"
    """people to draw"""
    pixels: int = 480
    """height of the pictures, which are 4:3"""
    seed: Seed = 1
    """random seed"""
    reading: Flat[ReadingOptions] = AS_FOUND

    def __post_init__(self) -> None:
        if self.videos < 1 or not self.seconds >= 1 or self.pixels < 64 or self.pixels % 2:
            raise BodysenseError(
                f"render: {self.videos} videos of {self.seconds:g} s, {self.pixels} pixels high; "
                "give at least 1 video, 1 s, and an even height from 64 on"
            )
