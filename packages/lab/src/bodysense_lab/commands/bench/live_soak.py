"""`bodysense bench live-soak`: wearers against a server over a bad network."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

from bodysense.errors import BodysenseError
from bodysense.ranges import Processes, Sessions, within
from bodysense_lab.core.options import Json, Rate


def live_soak(
    minutes: Annotated[float, within(float, 0.01, 10_000)] = 10.0,
    sessions: Sessions = 8,
    rate: Rate = 72.0,
    loss: Annotated[float, within(float, 0, 0.9)] = 0.05,
    workers: Processes = 1,
    kill_every: float = 0.0,
    shared: str | None = None,
    json: Json = None,
) -> None:
    """Run wearers against a server over a bad network; fails if memory grows, for NaN, and if a session hangs.

    Frames are lost, repeated and late by up to 0.3 s; connections break and are resumed. If processes of the server
    are killed, no wearer may be without a pose for more than 1.5 s.

    Args:
        minutes: length in minutes.
        sessions: number of wearers.
        rate: frames per second of each wearer.
        loss: share of lost frames.
        workers: processes of the server.
        kill_every: seconds between two kills of a process; 0: no kills.
        shared: address of a Valkey or Redis server, by which wearers of a killed process resume in another.
    """
    import numpy as np

    from bodysense.cli.show import write_numbers
    from bodysense_lab.serving.soak import SoakPlan, check, soak

    if kill_every and (workers < 2 or shared is None or not 5 <= kill_every <= 3600):
        raise BodysenseError(
            "live-soak: give --kill-every 5 to 3600 seconds, --workers 2 or more, and --shared ADDRESS"
        )
    plan = SoakPlan(
        sessions, 60 * minutes, rate, loss, workers=workers, shared=shared, seconds_between_kills=kill_every
    )
    counts = soak(plan, np.random.default_rng(1))
    killed = f"{counts.killed} processes killed, " if kill_every else ""
    print(
        f"{sessions} sessions at {rate:g} Hz for {minutes:g} min with {loss:.0%} lost: {counts.sent} frames sent, "
        f"{counts.answered} answered, {counts.breaks} breaks, {counts.resumed} resumed, {killed}longest silence "
        f"{counts.longest_silence_s:.2f} s, memory {counts.rss_mb_warm:.1f} to {counts.rss_mb_last:.1f} MB"
    )
    write_numbers(json, asdict(plan) | asdict(counts))
    check(counts, plan)
