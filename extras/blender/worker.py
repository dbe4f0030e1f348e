"""Completion of one take, in a process of its own: python worker.py PACKAGES TAKE OUT.

PACKAGES is the folder of the extension's wheels, and standard input has the arguments of `bodysense.track` as JSON.
Prints percentages, or one line about an error.
"""

import json
import sys
from typing import Any


def complete(take: str, out: str, given: dict[str, Any]) -> None:
    """Complete a take and write it in its own rig."""
    import bodysense as bs

    printed = -1

    def advance(done: int, frames: int) -> None:
        nonlocal printed
        if (percent := 100 * done // max(frames, 1)) > printed:
            print(f"{percent} %", flush=True)
            printed = percent

    try:
        bs.track(take, advance=advance, **given).save(out, rig="source")
    except bs.BodysenseError as error:
        raise SystemExit(" ".join(str(error).split())) from None


if __name__ == "__main__":
    packages, take, out = sys.argv[1:]
    sys.path.insert(0, packages)
    complete(take, out, json.load(sys.stdin))
