"""Wearers over a bad network, against a server in its own process: what they send and get, and what it keeps."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import psutil

from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import POSE, SUBPROTOCOL, SignalFrame, read_pose, write_signal
from bodysense_lab.serving.server import running_server
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import Hello, Resume

_POINTS = ("head", "left_wrist", "right_wrist")
_MAX_SILENCE = 5.0  # s without an answer while frames are sent
_MAX_SILENCE_KILLS = 1.5  # s, if processes are killed
_RECONNECT_DELAY = 0.02  # s until a wearer reconnects after the server closed the connection
_WARM = 0.25  # share of the time after which memory and descriptors are measured first
_CLOSING = 1.0  # s in which the server closes the connections of wearers who left
_MORE_DESCRIPTORS = 3  # of a server that keeps none: connections that are being opened or closed


@dataclass(frozen=True)
class SoakPlan:
    """Plan of a soak test: network and wearers."""

    sessions: int = 4
    seconds: float = 12.0
    rate: float = 72.0  # Hz
    loss: float = 0.05
    doubled: float = 0.01
    late: float = 0.05  # share of frames that are delayed by up to `latest` s
    latest: float = 0.3
    seconds_connected: float = 20.0  # mean time until the connection breaks
    workers: int = 1  # processes of the server
    shared: str | None = None  # address of a Valkey or Redis, for sessions of processes that are killed
    seconds_between_kills: float = 0.0  # 0: no process is killed


@dataclass
class SoakCounts:
    """Counts of a soak test."""

    sent: int = 0
    answered: int = 0
    not_finite: int = 0
    breaks: int = 0
    resumed: int = 0
    killed: int = 0  # processes of the server
    longest_silence_s: float = 0.0  # of a wearer with a working network
    rss_mb_warm: float = 0.0
    rss_mb_last: float = 0.0
    descriptors_warm: int = 0  # open files and sockets of the server, without established connections
    descriptors_last: int = 0


def soak(plan: SoakPlan, rng: np.random.Generator) -> SoakCounts:
    """Run a soak test. Raises BodysenseError if the server does not start, or ends."""
    counts = SoakCounts()
    shared = () if plan.shared is None else ("--shared", plan.shared)
    options = ("--sessions", str(plan.sessions + 4), "--workers", str(plan.workers), *shared)
    with running_server(*options) as (address, process):
        asyncio.run(_all_wearers(f"{address.replace('http://', 'ws://')}ws", process, plan, rng, counts))
    return counts


async def _all_wearers(
    address: str, server: subprocess.Popen[str], plan: SoakPlan, rng: np.random.Generator, counts: SoakCounts
) -> None:
    """Run all wearers, measure the server's memory, and kill its processes if planned."""
    end = time.monotonic() + plan.seconds
    wearers = [
        asyncio.create_task(_wearer(address, plan, end, np.random.default_rng(int(seed)), counts))
        for seed in rng.integers(2**32, size=plan.sessions)
    ]
    killer = asyncio.create_task(_kill(server.pid, plan, rng, counts)) if plan.seconds_between_kills else None
    await asyncio.sleep(_WARM * plan.seconds)
    counts.rss_mb_warm, counts.descriptors_warm = rss_mb(server.pid), descriptors(server.pid)
    await asyncio.gather(*wearers)
    await asyncio.sleep(_CLOSING)
    if server.poll() is not None:
        raise BodysenseError("the server ended during the soak")
    counts.rss_mb_last, counts.descriptors_last = rss_mb(server.pid), descriptors(server.pid)
    if killer is not None:
        killer.cancel()


async def _wearer(address: str, plan: SoakPlan, end: float, rng: np.random.Generator, counts: SoakCounts) -> None:
    """Run one wearer, who reconnects and resumes after each break."""
    from websockets import WebSocketException
    from websockets.asyncio.client import connect
    from websockets.typing import Subprotocol

    resume, begun, seen = None, time.monotonic(), _Received()
    while time.monotonic() < end:
        opened = connect(address, subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None)
        try:
            async with opened as client:
                await client.send(write_message(Hello(1, _POINTS, resume=resume)))
                welcome = json.loads(await client.recv())
                counts.resumed += welcome["resumed"]
                resume = Resume(welcome["session"], welcome["token"])
                until = min(end, time.monotonic() + rng.exponential(plan.seconds_connected))
                reader = asyncio.create_task(_read(client, len(welcome["points"]), counts, seen))
                await _send_frames(client, plan, begun, until, rng, counts, reader)
                was_cut = reader.done()
                client.transport.abort()  # as if the network were gone
                reader.cancel()
                await asyncio.gather(reader, return_exceptions=True)
        except (WebSocketException, OSError):
            if not plan.seconds_between_kills:
                raise
            was_cut = True
        if was_cut:  # by the server: reconnect at once, and count the time as silence
            await asyncio.sleep(_RECONNECT_DELAY)
            continue
        counts.breaks += 1
        seen.last = None
        await asyncio.sleep(rng.uniform(0, 2))


@dataclass
class _Received:
    """Answers that a wearer received."""

    last: float | None = None  # s, time of the last answer; None after a break of the wearer's network


async def _kill(server: int, plan: SoakPlan, rng: np.random.Generator, counts: SoakCounts) -> None:
    """Kill one of the server's processes at regular intervals."""
    while True:
        await asyncio.sleep(plan.seconds_between_kills)
        workers = workers_of(server)
        if workers:
            os.kill(int(rng.choice(workers)), signal.SIGKILL)
            counts.killed += 1


def workers_of(server: int) -> list[int]:
    """Return the worker processes of a server, oldest first."""
    found = []
    for child in psutil.Process(server).children():
        with contextlib.suppress(psutil.Error):  # it may have ended
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child.pid)
    return sorted(found)


async def _send_frames(
    client: object,
    plan: SoakPlan,
    begun: float,
    until: float,
    rng: np.random.Generator,
    counts: SoakCounts,
    reader: asyncio.Task[None],
) -> None:
    """Send frames over a bad network until `until`, or until the connection is closed."""
    loop = asyncio.get_running_loop()
    tasks: set[asyncio.Task[None]] = set()

    async def send(data: bytes) -> None:
        with contextlib.suppress(Exception):  # after a break the frame is lost
            await client.send(data)  # type: ignore[attr-defined]

    def later(data: bytes) -> None:
        task = loop.create_task(send(data))
        tasks.add(task)
        task.add_done_callback(tasks.discard)

    due, phase = loop.time(), rng.uniform(0, 10)
    while time.monotonic() < until and not reader.done():
        due += 1 / plan.rate
        await asyncio.sleep(max(0.0, due - loop.time()))
        data = write_signal(swaying_wearer(counts.sent, time.monotonic() - begun, phase))
        counts.sent += 1
        chance = rng.random()
        if chance < plan.loss:
            continue
        if chance < plan.loss + plan.late:
            loop.call_later(rng.uniform(0, plan.latest), later, data)
            continue
        await send(data)
        if chance > 1 - plan.doubled:
            await send(data)


async def _read(client: object, points: int, counts: SoakCounts, seen: _Received) -> None:
    """Read poses until the connection breaks."""
    if seen.last is None:
        seen.last = time.monotonic()
    async for message in client:  # type: ignore[attr-defined]
        if isinstance(message, bytes) and message[0] == POSE:
            pose = read_pose(message, points)
            finite = np.isfinite(pose.rotation).all() and np.isfinite(pose.root_position).all()
            counts.not_finite += not finite
            counts.answered += 1
            now = time.monotonic()
            counts.longest_silence_s = max(counts.longest_silence_s, now - seen.last)
            seen.last = now


def swaying_wearer(sequence: int, now: float, phase: float) -> SignalFrame:
    """Return head and wrists of a wearer who sways and waves."""
    a, b = np.sin(now + phase), np.sin(2.3 * now + phase)
    places = np.array(
        [[0.1 * a, 1.55, 0.05 * b], [0.3, 1.1 + 0.2 * b, 0.3], [-0.3, 1.1 + 0.2 * a, 0.3]], dtype=np.float32
    )
    turned = np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (3, 1))
    return SignalFrame(sequence % 2**32, now, np.arange(3), np.full(3, 3), places, turned)


def rss_mb(process: int) -> float:
    """Return the memory of a process and of those that it started, MB."""
    return sum(_of_each(process, lambda one: one.memory_info().rss)) / 2**20


def descriptors(process: int) -> int:
    """Return the open files and sockets of a process and of those that it started, without established connections."""

    def kept(one: psutil.Process) -> int:
        established = [each for each in one.net_connections("tcp") if each.status == psutil.CONN_ESTABLISHED]
        return one.num_fds() - len(established)

    return sum(_of_each(process, kept))


def _of_each(process: int, measure: Callable[[psutil.Process], int]) -> list[int]:
    """Return a measure of a process and of each that it started, without those that end meanwhile."""
    server, measured = psutil.Process(process), []
    for one in (server, *server.children(recursive=True)):
        with contextlib.suppress(psutil.NoSuchProcess):
            measured.append(measure(one))
    return measured


def faults(counts: SoakCounts, plan: SoakPlan) -> list[str]:
    """Return what failed: a session hung, memory or descriptors grew, poses were not finite, nothing was answered."""
    longest = _MAX_SILENCE_KILLS if plan.seconds_between_kills else _MAX_SILENCE
    growth = counts.rss_mb_last - counts.rss_mb_warm
    kept = counts.descriptors_last - counts.descriptors_warm
    checks = {
        f"{counts.not_finite} poses are not finite": counts.not_finite > 0,
        f"a session was not answered for {counts.longest_silence_s:.1f} s": counts.longest_silence_s > longest,
        f"memory grew by {growth:.0f} MB": growth > max(10.0, 0.05 * counts.rss_mb_warm),
        f"{kept} more descriptors are open": kept > _MORE_DESCRIPTORS,
        "no process was killed": plan.seconds_between_kills > 0 and not counts.killed,
        "nothing was answered": counts.answered == 0,
    }
    return [text for text, failed in checks.items() if failed]
