"""The tree of commands."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import EntryPoint

from tyro.extras import SubcommandApp

from bodysense.cli import data, demo, motion, packages, samples


def application(found: Mapping[str, EntryPoint]) -> SubcommandApp:
    """All commands: `bodysense demo`, `bodysense data info` …, and those of the packages that were found."""
    root, data_group = SubcommandApp(), data.commands()
    for command in (demo.demo, motion.track, motion.convert, motion.simulate, samples.generate):
        root.command(command)
    root.command(data_group, name="data", help="Look at motion data, and prepare it.")
    packages.add_commands(found, root, data_group)
    return root
