"""The packaged demo performance: a motion of the project's own, made by `scripts/make_performance.py`."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import as_file, files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bodysense.data.clip import Clip


def packaged_performance() -> Clip:
    """The project's own motion: arms crossed, chin on hand, sitting down, a few steps."""
    from bodysense.data.amass import read_amass

    with as_file(files("bodysense.demo").joinpath("performance.npz")) as path:
        return replace(read_amass(path), name="performance")
