"""Supervision: a server without answers reports it and ends, and a failing session does not stop others."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Awaitable, Callable

import numpy as np
import pytest

from bodysense.io.formats.protocol import ProtocolError
from bodysense_live.server import scheduler as scheduler_module
from bodysense_live.server import supervisor as supervisor_module
from bodysense_live.server.scheduler import Scheduler, complete
from bodysense_live.server.supervisor import Supervisor
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.session import Session

from ..conftest import DEVICES, Address, Connecting, Serving, signal
from .test_scheduler import Wearer


async def fails() -> None:
    raise ZeroDivisionError


async def returns() -> None:
    await asyncio.sleep(0)


async def is_cancelled() -> None:
    await asyncio.sleep(60)


def ended(task: Callable[[], Awaitable[None]], cancel: bool = False) -> list[str]:
    """Return the types of the failures for which a supervisor ends the server."""

    async def go() -> list[str]:
        failures: list[BaseException] = []
        supervisor = Supervisor(failures.append)
        started = [supervisor.start(task()) for _ in range(2)]  # type: ignore[arg-type]
        if cancel:
            started[0].cancel()
        await asyncio.sleep(0.01)
        await supervisor.stop()
        assert supervisor.is_stuck == bool(failures) and supervisor.failure is (failures[0] if failures else None)
        return [type(failure).__name__ for failure in failures]

    return asyncio.run(go())


def test_any_end_of_a_task_ends_the_server_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(fails) == ["ZeroDivisionError"]
    assert ended(returns) == ["RuntimeError"]
    assert capsys.readouterr().err.count("Error") >= 2  # told on the standard error output
    assert ended(is_cancelled, cancel=True) == [] and not capsys.readouterr().err


def test_a_server_that_answers_no_frame_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor_module, "_CHECK_INTERVAL", 0.01)
    monkeypatch.setattr(supervisor_module, "HOPELESS_AFTER", 0.05)
    failures: list[BaseException] = []
    waits: list[float] = []

    async def go() -> None:
        supervisor, begun = Supervisor(failures.append), time.monotonic()
        supervisor.watch(lambda: begun, waits.append)
        await asyncio.sleep(0.03)
        assert not failures
        await asyncio.sleep(0.1)
        await supervisor.stop()

    asyncio.run(go())
    assert not waits  # it ended before a second was over
    assert [type(failure) for failure in failures] == [TimeoutError]


def test_a_wait_is_reported_once_a_second_until_it_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor_module, "_CHECK_INTERVAL", 0.01)
    monkeypatch.setattr(supervisor_module, "STUCK_AFTER", 0.1)
    waits: list[float] = []

    async def go() -> None:
        since: list[float | None] = [None]
        supervisor = Supervisor(lambda failure: None)
        supervisor.watch(lambda: since[0], waits.append)
        for wait in (0.05, 0.25, None, 0.15):
            since[0] = None if wait is None else time.monotonic()
            await asyncio.sleep(wait or 0.05)
        await supervisor.stop()

    asyncio.run(go())
    assert [int(wait / 0.1) for wait in waits] == [1, 2, 1]


FAILING = ("job", "complete", "answer", "abandon", "deliver")


def faults() -> list[tuple[tuple[str, ...], int]]:
    """Return sets of calls that fail for one session, and the frame from which they do."""
    rng, found = np.random.default_rng(3), [((name,), 0) for name in FAILING]
    for _ in range(12):
        names = rng.choice(FAILING, int(rng.integers(1, 4)), replace=False)
        found.append((tuple(sorted(names.tolist())), int(rng.integers(0, 4))))
    return found


@pytest.mark.parametrize(("names", "frame"), faults())
def test_a_fault_of_one_session_reaches_no_other(
    monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...], frame: int
) -> None:
    slots = [Wearer(Session(DEVICES)) for _ in range(3)]
    broken = slots[1]
    begun, refused = [False], list[str]()
    answered: list[tuple[Wearer, Answer | None]] = []

    def fail_if(name: str, original: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object) -> object:
            if begun[0] and name in names:
                raise ZeroDivisionError(name)
            return original(*arguments)

        return call

    for name in ("job", "answer", "abandon"):
        monkeypatch.setattr(broken.session, name, fail_if(name, getattr(broken.session, name)))

    def failing(jobs: list) -> list:
        if begun[0] and "complete" in names and any(job.pipeline is broken.session._pipeline for job in jobs):
            raise ZeroDivisionError
        return complete(jobs)

    def step(jobs: list) -> list:
        try:
            return failing(jobs)
        except ZeroDivisionError:
            return [None if job.pipeline is broken.session._pipeline else complete([job])[0] for job in jobs]

    monkeypatch.setattr(scheduler_module, "complete", step)

    def deliver(slot: Wearer, answer: Answer | None) -> None:
        if begun[0] and slot is broken and "deliver" in names:
            raise ZeroDivisionError
        answered.append((slot, answer))

    def refuse(slot: Wearer, error: ProtocolError) -> None:
        assert slot is broken and error.code == 1011
        refused.append(str(error))

    async def go() -> None:
        scheduler: Scheduler[Wearer] = Scheduler(deliver, refuse, lambda seconds: None)
        task = asyncio.create_task(scheduler.run())
        for k in range(6):
            begun[0] = k >= frame
            for one in slots:
                one.session.receive(signal(k, k / 72), 0.0)
                scheduler.ready(one)
            async with asyncio.timeout(10):
                while sum(slot is not broken for slot, _ in answered) < 2 * (k + 1) or scheduler.waiting_since:
                    await asyncio.sleep(0.001)
        assert not task.done()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(go())
    for one in (slots[0], slots[2]):
        assert [a.frame.sequence for slot, a in answered if slot is one and a is not None] == list(range(6))
    mine = [answer for slot, answer in answered if slot is broken]
    assert refused or mine.count(None) >= 1 or names == ("abandon",)  # told, or counted as failed


def health(address: Address, path: str = "healthz") -> tuple[int, str]:
    try:
        with urllib.request.urlopen(f"{address.http}/{path}", timeout=5) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def test_a_server_is_unhealthy_while_a_frame_waits(
    server_of: Serving, connect: Connecting, monkeypatch: pytest.MonkeyPatch
) -> None:
    released = threading.Event()
    server = server_of()
    client = connect(server)
    assert client.answered(signal(0, 0.0)).sequence == 0 and health(server) == (200, "ok\n")

    def hang(jobs: list) -> list:
        released.wait(30)
        return complete(jobs)

    monkeypatch.setattr(scheduler_module, "complete", hang)
    client.send(signal(1, 0.1))
    time.sleep(0.3)
    assert health(server)[0] == 200  # not yet
    time.sleep(1.0)
    status, text = health(server)
    assert status == 503 and text.startswith("a frame waits for 1.") and health(server, "readyz")[0] == 503
    released.set()
    assert client.pose().sequence == 1 and health(server) == (200, "ok\n")


BROKEN = """
import sys
from bodysense_live.server import scheduler
run = scheduler.Scheduler.run
async def broken(self):
    self._deliver = None
    async def step(batch):
        raise ZeroDivisionError("of this test")
    self._step = step
    await run(self)
scheduler.Scheduler.run = broken
from bodysense.cli import entry_point
sys.argv = ["bodysense", "serve", "--port", "0"]
entry_point()
"""


def test_a_server_whose_scheduler_ends_closes_its_connections_and_ends_loudly(connect: Connecting) -> None:
    from websockets import ConnectionClosed

    with subprocess.Popen(
        [sys.executable, "-c", BROKEN], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        try:
            port = int(process.stdout.readline().rstrip("/\n").rpartition(":")[2])
            client = connect(Address(port))
            begun = time.monotonic()
            client.send(signal(0, 0.0))
            with pytest.raises(ConnectionClosed) as caught:
                while True:
                    client.socket.recv(timeout=5)
            assert time.monotonic() - begun < 2.0
            assert caught.value.rcvd is not None and caught.value.rcvd.code == 1012
            _, errors = process.communicate(timeout=20)
        finally:
            process.kill()
    assert process.returncode == 1
    assert "ZeroDivisionError: of this test" in errors and "the server failed, and has ended" in errors
