"""Types of numbers with a range, for options of the command line. Other values are refused before any work."""

from __future__ import annotations

from typing import Annotated, Any

from tyro.constructors import PrimitiveConstructorSpec


def within(kind: type[int] | type[float], least: float, most: float) -> PrimitiveConstructorSpec[Any]:
    """Return tyro's rule for a number from `least` to `most`; its metavar names the range."""

    def read(words: list[str]) -> float:
        value = kind(words[0])
        if not least <= value <= most:
            raise ValueError(f"{value} is not from {least} to {most}")
        return value

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{kind.__name__.upper()}({least} to {most})",
        instance_from_str=read,
        is_instance=lambda value: isinstance(value, (int, kind)),
        str_from_instance=lambda value: [str(value)],
    )


Samples = Annotated[int, within(int, 1, 1000)]  # bodies; each is a file, or a figure of a picture
Processes = Annotated[int, within(int, 1, 1024)]  # processes, threads or machines
Sessions = Annotated[int, within(int, 1, 10_000)]  # wearers of a server
Count = Annotated[int, within(int, 1, 10_000_000)]  # clips, frames, steps
Port = Annotated[int, within(int, 0, 65535)]  # 0: any that is free
Seed = Annotated[int, within(int, 0, 2**32 - 1)]
Megabytes = Annotated[float, within(float, 1, 1_000_000_000)]
