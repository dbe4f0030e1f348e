"""`bodysense bench live-fuzz`: hostile messages against the live server's code."""

from __future__ import annotations

import time
from dataclasses import asdict

from bodysense.ranges import Count, Seed
from bodysense_lab.core.options import Json


def live_fuzz(frames: Count = 1_000_000, seed: Seed = 1, json: Json = None) -> None:
    """Send hostile messages to the server's code, without a network; fails on any other result than a refusal.

    Args:
        frames: number of messages.
        seed: random seed of the messages.
    """
    from rich.progress import Progress

    from bodysense.cli.show import write_numbers
    from bodysense_lab.serving.hostile_clients import FuzzCounts, run_fuzz

    counts, begun, part = FuzzCounts(), time.perf_counter(), 10_000
    with Progress() as progress:
        bar = progress.add_task("fuzzing", total=frames)
        while counts.frames < frames:  # in parts, each with its own server
            run_fuzz(min(frames, counts.frames + part), seed + counts.frames, counts)
            progress.update(bar, completed=counts.frames)
    seconds = time.perf_counter() - begun
    print(
        f"{counts.frames} messages of {counts.connections} clients in {seconds:.0f} s: {counts.refused} refused, "
        f"{counts.answered} poses, another client answered {counts.watched} times, no failure"
    )
    numbers = {name: value for name, value in asdict(counts).items() if name != "errors"}
    write_numbers(json, numbers | {"seed": seed, "seconds": round(seconds, 1)})
