"""`bodysense data`: what motion there is, and preparing it for training."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from tyro.extras import SubcommandApp

from bodysense.cli.data_info import info, joints

Folder = Annotated[Path, tyro.conf.Positional]


def commands() -> SubcommandApp:
    """The group's commands."""
    group = SubcommandApp()
    for command in (info, joints, sources):
        group.command(command)
    return group


def sources() -> None:
    """List public motion data that bodysense reads, with licence and where to get it."""
    from rich.console import Console
    from rich.table import Table

    from bodysense.io.datasets.catalogue import CATALOGUE

    shown = Table(title="Motion data that bodysense reads")
    for column in ("name", "what", "format", "fingers", "licence", "where", "tables"):
        shown.add_column(column)
    for entry in CATALOGUE:
        shown.add_row(entry.name, entry.what, entry.format, entry.fingers, entry.licence, entry.where, entry.tables)
    Console().print(shown)
