"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from bodysense.errors import BodysenseError
from bodysense.io.reading_options import ReadingOptions

Output = Annotated[Path, tyro.conf.arg(aliases=("-o",))]
Reading = Annotated[ReadingOptions, tyro.conf.OmitArgPrefixes]  # of a motion file: --unit, --up, --floor …

_SLOWEST, _FASTEST = 0.1, 10_000.0  # Hz


def check_rate(option: str, rate: float | None) -> None:
    """Raise BodysenseError, naming the option, for a rate (Hz) that a motion cannot have."""
    if rate is not None and not _SLOWEST <= rate <= _FASTEST:
        raise BodysenseError(f"{option} {rate:g}: give frames a second, {_SLOWEST:g} to {_FASTEST:g}, such as 30")
