"""The tree of commands."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import EntryPoint

from tyro.extras import SubcommandApp

from bodysense.cli import data, demo, motion, packages, repair


def application(found: Mapping[str, EntryPoint]) -> SubcommandApp:
    """Return the tree of all commands (`bodysense demo`, `bodysense data info` …), with those of the found packages."""
    root, data_group = SubcommandApp(), data.commands()
    for command in (demo.demo, motion.track, motion.convert, motion.simulate, repair.check, repair.repair):
        root.command(command)
    root.command(data_group, name="data", help="Look at motion data, and prepare it.")
    packages.add_commands(found, root, data_group)
    return root
