"""Reading options of a motion file; omitted ones are inferred from the file."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from bodysense.body.person import SHORTEST, TALLEST
from bodysense.errors import BodysenseError
from bodysense.observing.world_axes import UpAxis, metres_of, turn_of


def given_options(options: Any) -> str:
    """Return the options of a dataclass that are given, as '--names, --rate'; nothing if all have their defaults."""
    names = (one.name for one in fields(options) if getattr(options, one.name) != one.default)
    return ", ".join(f"--{name.replace('_', '-')}" for name in names)


@dataclass(frozen=True)
class ReadingOptions:
    """Facts that a motion file omits or has wrong."""

    unit: str | None = None
    """length unit of the file: m, cm, mm, in, ft, or metres, as 0.056444; if omitted, the file's own, or the unit that
    makes the body of a motion as tall as a person.
    """
    up: UpAxis | None = None
    """upward axis of the file; if omitted, the file's own, or the one along which the body stands."""
    floor: float | None = None
    """height of the floor in the file, metres along the upward axis; if omitted, the height of the feet in a motion,
    and 0 in a recording.
    """
    height: float | None = None
    """height of the body in metres, to which a motion is scaled; the file's, or inferred, if omitted."""
    left_handed: bool = False
    """the axes of the file are left-handed, as in Unity and Unreal: of markers and of a motion's joints."""
    joints: Path | None = None
    """joint map of a motion: a JSON file, drafted by `bodysense data joints`; if omitted, joints are recognised."""
    figure: int | None = None
    """number of the body in a file of several, counted from 1."""
    animation: str | None = None
    """name of the animation in an FBX or glTF file of several; the one that moves most joints if omitted."""
    skin: str | None = None
    """name of the skinned mesh in an FBX file, whose skeleton is read; if omitted, every skeleton is looked at."""
    smpl_model: Path | None = None
    """SMPL, SMPL-H or SMPL-X model (.npz), or a folder of one for each gender, for the bones of bodies in AMASS and
    SMPL files; if omitted, the default body, in AMASS files as tall as its steps show.
    """

    def __post_init__(self) -> None:
        if self.unit is not None:
            _ = self.metres
        if self.up is not None:
            turn_of(self.up, "--up")
        if self.figure is not None and self.figure < 1:
            raise BodysenseError(f"--figure {self.figure}: bodies are counted from 1")
        if self.height is not None and not SHORTEST <= self.height <= TALLEST:
            raise BodysenseError(
                f"--height {self.height:g}: people are {SHORTEST:g} to {TALLEST:g} m high; give metres, such as 1.75"
            )
        if self.floor is not None and not abs(self.floor) <= 1000:
            raise BodysenseError(f"floor {self.floor:g} m; give the floor's height in metres")
        if self.smpl_model is not None and not self.smpl_model.exists():
            raise BodysenseError(
                f"--smpl-model {self.smpl_model}: no such file; give a model (.npz), or a folder of one for each gender"
            )

    def for_motions(self) -> list[str]:
        """Return the given options that only motions have."""
        given = (
            name for name in ("joints", "figure", "animation", "skin", "smpl_model") if getattr(self, name) is not None
        )
        return [f"--{name.replace('_', '-')}" for name in given]

    def for_the_world(self) -> list[str]:
        """Return the given options that place a body in our world, with their values."""
        given = ((name, getattr(self, name)) for name in ("unit", "up", "floor", "height"))
        mirrored = ["--left-handed"] if self.left_handed else []
        return [*(f"--{name} {value}" for name, value in given if value is not None), *mirrored]

    @property
    def metres(self) -> float | None:
        """Metres of one unit of the file; None if unknown."""
        return None if self.unit is None else metres_of(self.unit, "--unit")


AS_FOUND = ReadingOptions()
