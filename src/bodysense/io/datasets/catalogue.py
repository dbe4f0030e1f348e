"""Catalogue of public motion data that can be read, for `bodysense data sources`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files


@dataclass(frozen=True)
class Entry:
    """One collection."""

    name: str
    what: str
    format: str
    fingers: str
    licence: str
    where: str
    tables: str = ""  # of the papers, that need it


_FILE = files("bodysense.io.datasets").joinpath("catalogue.toml")
CATALOGUE = tuple(Entry(**row) for row in tomllib.loads(_FILE.read_text(encoding="utf-8"))["data"])
