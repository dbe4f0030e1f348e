"""`bodysense bench live-fuzz`, `packet-fuzz`, `packet-decoders`, `live-soak`: the live server held to its word."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path


def live_fuzz(frames: int = 1_000_000, seed: int = 1, json: Path | None = None) -> None:
    """Send hostile messages to the server's code, without a network; fails where anything but a refusal comes out.

    Args:
        frames: Messages to send.
        seed: random seed of the messages.
        json: Write the numbers here, as one flat object.
    """
    from rich.progress import Progress

    from bodysense.cli.show import write_numbers
    from bodysense.errors import BodysenseError
    from bodysense_lab.serving.hostile_clients import FuzzCounts, run_fuzz

    if frames < 1:
        raise BodysenseError(f"--frames {frames}: give 1 or more")
    counts, begun, part = FuzzCounts(), time.perf_counter(), 10_000
    with Progress() as progress:
        bar = progress.add_task("fuzzing", total=frames)
        while counts.frames < frames:  # in parts, each with a server of its own
            run_fuzz(min(frames, counts.frames + part), seed + counts.frames, counts)
            progress.update(bar, completed=counts.frames)
    seconds = time.perf_counter() - begun
    print(
        f"{counts.frames} messages of {counts.connections} clients in {seconds:.0f} s: {counts.refused} refused, "
        f"{counts.answered} poses, another client answered {counts.watched} times, no failure"
    )
    numbers = {name: value for name, value in asdict(counts).items() if name != "errors"}
    write_numbers(json, numbers | {"seed": seed, "seconds": round(seconds, 1)})


def packet_fuzz(packets: int = 1_000_000, seed: int = 1, json: Path | None = None) -> None:
    """Read hostile packets of all that comes in by UDP or sockets (VMC, VMT, VRChat, SlimeVR, SolarXR); none may raise.

    Args:
        packets: Packets to read.
        seed: random seed of the packets.
        json: Write the numbers here, as one flat object.
    """
    import numpy as np

    from bodysense.cli.show import write_numbers
    from bodysense_lab.serving.hostile_packets import fuzz_packets

    _some(packets)
    begun = time.perf_counter()
    found = fuzz_packets(packets, np.random.default_rng(seed))
    seconds = time.perf_counter() - begun
    parts = ", ".join(f"{name} {count}" for name, count in found.items())
    print(f"{packets} packets in {seconds:.0f} s, no failure: {parts}")
    numbers: dict[str, float] = {"packets": packets, "seed": seed, "seconds": round(seconds, 1)}
    write_numbers(json, numbers | found)


def packet_decoders(packets: int = 1_000_000, seed: int = 1, json: Path | None = None) -> None:
    """Read all that goes out (VMC, VRChat, VMT, SolarXR) with decoders that are not ours; all must be read as meant.

    python-osc, Wireshark's tshark where it is installed, and a reader of SolarXR's public schema.

    Args:
        packets: Packets to read.
        seed: random seed of the bodies.
        json: Write the numbers here, as one flat object.
    """
    import shutil

    import numpy as np
    from rich.progress import Progress

    from bodysense.cli.show import write_numbers
    from bodysense_lab.serving.decoders import Decoded, decode

    _some(packets)
    begun, found = time.perf_counter(), Decoded()
    with Progress() as progress:
        bar = progress.add_task("decoding", total=packets)
        for found in decode(packets, np.random.default_rng(seed), shutil.which("tshark")):
            progress.update(bar, completed=found.osc + found.solarxr)
    seconds = time.perf_counter() - begun
    wireshark = f"Wireshark {found.wireshark} of these" if found.wireshark else "no tshark here"
    print(
        f"{packets} packets in {seconds:.0f} s, all read as meant: python-osc {found.osc} with {found.osc_messages} "
        f"messages, {wireshark}, a reader of SolarXR {found.solarxr}"
    )
    write_numbers(json, {"packets": packets, "seed": seed, "seconds": round(seconds, 1)} | asdict(found))


def _some(packets: int) -> None:
    from bodysense.errors import BodysenseError

    if packets < 1:
        raise BodysenseError(f"--packets {packets}: give 1 or more")


def live_soak(
    minutes: float = 10.0,
    sessions: int = 8,
    rate: float = 72.0,
    loss: float = 0.05,
    workers: int = 1,
    kill_every: float = 0.0,
    shared: str | None = None,
    json: Path | None = None,
) -> None:
    """Run wearers against a server over a bad network; fails on growth, on NaN and on a session that is stuck.

    Frames are lost, doubled and late by up to 0.3 s; connections break and are resumed. Where processes of the server
    are killed, no wearer may be silent for more than 1.5 s.

    Args:
        minutes: length in minutes.
        sessions: Wearers.
        rate: Frames a second of each.
        loss: Share of frames that are lost.
        workers: Processes of the server.
        kill_every: Seconds after which one of them is killed, repeatedly; 0: never.
        shared: Address of a Valkey or Redis, by which wearers of a killed process resume in another.
        json: Write the numbers here, as one flat object.
    """
    import asyncio

    import numpy as np

    from bodysense.cli.show import write_numbers
    from bodysense.errors import BodysenseError
    from bodysense_lab.serving.soak import SoakPlan, check, soak

    if not (minutes > 0 and sessions > 0 and rate > 0 and 0 <= loss < 0.9):
        raise BodysenseError("live-soak: give positive minutes, sessions and rate, and a loss of 0 to 0.9")
    if kill_every and (workers < 2 or shared is None or not 5 <= kill_every <= 3600):
        raise BodysenseError(
            "live-soak: give --kill-every 5 to 3600 seconds, --workers 2 or more, and --shared ADDRESS"
        )
    plan = SoakPlan(
        sessions, 60 * minutes, rate, loss, workers=workers, shared=shared, seconds_between_kills=kill_every
    )
    counts = asyncio.run(soak(plan, np.random.default_rng(1)))
    killed = f"{counts.killed} processes killed, " if kill_every else ""
    print(
        f"{sessions} sessions at {rate:g} Hz for {minutes:g} min with {loss:.0%} lost: {counts.sent} frames sent, "
        f"{counts.answered} answered, {counts.breaks} breaks, {counts.resumed} resumed, {killed}longest silence "
        f"{counts.longest_silence_s:.2f} s, memory {counts.rss_mb_warm:.1f} to {counts.rss_mb_last:.1f} MB"
    )
    write_numbers(json, asdict(plan) | asdict(counts))
    check(counts, plan)
