"""Options that several commands share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from bodysense.errors import BodysenseError
from bodysense.io.reading_options import ReadingOptions
from bodysense.ranges import Processes

Output = Annotated[Path, tyro.conf.arg(aliases=("-o",))]
Reading = Annotated[ReadingOptions, tyro.conf.OmitArgPrefixes]  # of a motion file: --unit, --up, --floor …


@dataclass(frozen=True)
class ManyOptions:
    """Options of several files or a folder."""

    ending: Literal[".bvh", ".fbx", ".glb", ".vrma", ".mcap"] | None = None
    """many files: ending of the outputs in the folder; .bvh if omitted."""
    jobs: Processes = 1
    """many files: processes."""
    scheduler: str | None = None
    """many files: address of a Dask scheduler, such as tcp://HOST:8786, whose machines do the work; they share the
    files."""


ONE_FILE = ManyOptions()
Many = Annotated[ManyOptions, tyro.conf.OmitArgPrefixes]
MoreFiles = Annotated[tuple[Path, ...], tyro.conf.Positional]

_SLOWEST, _FASTEST = 0.1, 10_000.0  # Hz


def check_rate(option: str, rate: float | None) -> None:
    """Raise BodysenseError, naming the option, for a rate (Hz) that a motion cannot have."""
    if rate is not None and not _SLOWEST <= rate <= _FASTEST:
        raise BodysenseError(f"{option} {rate:g}: give frames a second, {_SLOWEST:g} to {_FASTEST:g}, such as 30")
