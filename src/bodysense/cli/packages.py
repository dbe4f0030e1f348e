"""Packages that add commands, and messages about those that are not installed.

A package has an entry point in the group `bodysense.commands`, a function `add_commands(root, data)`. It adds commands
to the tree and to its group `data`. A command replaces another one of the same name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points

from tyro.extras import SubcommandApp

from bodysense.errors import BodysenseError, how_to_install

GROUP = "bodysense.commands"
OWN = ("demo", "track", "check", "repair", "simulate", "convert", "data")  # commands of the library


@dataclass(frozen=True)
class Package:
    """A package of the repository that adds commands."""

    name: str  # of its entry point; it is in the folder packages/NAME of the repository
    commands: Mapping[tuple[str, ...], str]  # commands with a short description of each

    @property
    def source(self) -> str:
        """The folder of the package in a clone of the repository."""
        return f"packages/{self.name}"


PACKAGES = (
    Package(
        "live",
        {
            ("serve",): "serve live tracking and the page",
            ("calibrate",): "calibrate the wearer of a running server",
            ("page",): "write the page as static files",
        },
    ),
    Package("conform", {("conform",): "judge the output of a body tracker"}),
    Package(
        "lab",
        {
            ("train",): "train a network",
            ("evaluate",): "compute a table",
            ("papers",): "run the system of a paper",
            ("bench",): "time a part",
            ("study",): "make a user study",
            ("data", "prepare"): "prepare motion for training",
            ("data", "render"): "draw videos of motion",
        },
    ),
)


def installed() -> dict[str, EntryPoint]:
    """Return the entry points of installed packages by name, those of `PACKAGES` first and in their order."""
    found = {point.name: point for point in entry_points(group=GROUP)}
    order = [package.name for package in PACKAGES]
    return dict(sorted(found.items(), key=lambda item: order.index(item[0]) if item[0] in order else len(order)))


def needed(found: Mapping[str, EntryPoint], arguments: Sequence[str]) -> dict[str, EntryPoint]:
    """Return the packages whose commands a command line may run; those that a command of the library leaves out load
    slowly. Packages that are not in `PACKAGES` are kept, for their commands are unknown."""
    if not arguments or arguments[0] not in OWN:
        return dict(found)
    others = {package.name for package in PACKAGES if all(command[0] != arguments[0] for command in package.commands)}
    return {name: point for name, point in found.items() if name not in others}


def add_commands(found: Mapping[str, EntryPoint], root: SubcommandApp, data: SubcommandApp) -> None:
    """Add the commands of the found packages to the tree and to its group `data`."""
    for point in found.values():
        point.load()(root, data)


def check_installed(found: Mapping[str, EntryPoint], arguments: Sequence[str]) -> None:
    """Raise BodysenseError, with the install line, for a command of a package that is not installed."""
    for package in _missing(found):
        for command in package.commands:
            if tuple(arguments[: len(command)]) == command:
                raise BodysenseError(
                    f"{' '.join(command)}: this command is part of bodysense-{package.name}, which is not installed; "
                    + how_to_install(package.source)
                )


def _missing(found: Mapping[str, EntryPoint]) -> list[Package]:
    return [package for package in PACKAGES if package.name not in found]


def lines_of_missing(found: Mapping[str, EntryPoint]) -> list[str]:
    """Return a line for each package that is not installed: its commands, and the install line."""
    lines = []
    for package in _missing(found):
        commands = ", ".join(f"{' '.join(name)} ({what})" for name, what in package.commands.items())
        lines.append(f"Not installed: {commands}; {how_to_install(package.source)}")
    return lines
