"""The commands that come with the laboratory, `bodysense[lab]`; without it they say what to install."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec

from tyro.extras import SubcommandApp

from bodysense.errors import BodysenseError

COMMANDS = (
    ("train",),
    ("evaluate",),
    ("bench",),
    ("study",),
    ("data", "prepare"),
    ("data", "render"),
    ("data", "fingers"),
)
_NEEDED = ("torch", "lightning_fabric", "onnx", "scipy", "zarr", "distributed")
INSTALL = "pip install 'bodysense[lab]', or in a clone pip install -c constraints.txt '.[lab]'"


def is_installed() -> bool:
    """Whether all packages are there that the laboratory needs."""
    return all(find_spec(name) is not None for name in _NEEDED)


def check_installed(arguments: Sequence[str]) -> None:
    """Raise BodysenseError for a command of the laboratory where it is not installed."""
    asked = next((command for command in COMMANDS if tuple(arguments[: len(command)]) == command), None)
    if asked is not None and not is_installed():
        raise BodysenseError(f"{' '.join(asked)}: this command is part of the laboratory; install it: {INSTALL}")


def add_commands(root: SubcommandApp, data: SubcommandApp) -> None:
    """Put the laboratory's commands into the tree, and into its group `data`."""
    from bodysense_lab.commands import bench, evaluate, prepare, rendering, study, train

    data.command(prepare.prepare)
    data.command(prepare.fingers)
    data.command(rendering.render)
    root.command(train.commands(), name="train")
    root.command(evaluate.commands(), name="evaluate")
    root.command(bench.commands(), name="bench")
    root.command(study.commands(), name="study")
