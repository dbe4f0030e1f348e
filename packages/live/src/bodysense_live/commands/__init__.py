"""The commands of the live server: serve, calibrate and page."""

from __future__ import annotations

from tyro.extras import SubcommandApp


def add_commands(root: SubcommandApp, data: SubcommandApp) -> None:
    """Add the live server's commands to the command line."""
    from bodysense_live.commands import calibrate, page, serve

    root.command(serve.serve)
    root.command(calibrate.calibrate)
    root.command(page.page)
