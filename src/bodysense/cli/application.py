"""The tree of commands."""

from __future__ import annotations

from tyro.extras import SubcommandApp

from bodysense.cli import calibrate, conform, data, demo, laboratory, motion, page, samples, serve


def application() -> SubcommandApp:
    """All commands: `bodysense demo`, `bodysense data info` …, those of the laboratory where it is installed."""
    root, data_group = SubcommandApp(), data.commands()
    for command in (demo.demo, motion.track, motion.convert, motion.simulate, conform.conform, samples.generate):
        root.command(command)
    root.command(serve.serve)
    root.command(calibrate.calibrate)
    root.command(page.page)
    root.command(data_group, name="data")
    if laboratory.is_installed():
        laboratory.add_commands(root, data_group)
    return root
