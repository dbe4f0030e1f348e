"""Each row of the table of events in docs/serve.md: each wearer is answered within 2 s, or is given a reason."""

from __future__ import annotations

import errno
import re
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.io.formats.protocol import SignalFrame
from bodysense_live.security import certificate as certificate_module
from bodysense_live.security.safety import Access
from bodysense_live.server import live as live_module
from bodysense_live.server import scheduler as scheduler_module
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import RecordSwitch, Resume, Settings
from bodysense_live.server.scheduler import complete
from bodysense_live.server.settings import ServerSettings
from bodysense_live.server.supervisor import HOPELESS_AFTER
from bodysense_live.sessions import recorder as recorder_module
from bodysense_live.sessions import recordings as recordings_module

from .conftest import Address, Connecting, Serving, free_port, storing
from .conftest import signal as signal_frame
from .protocols.test_vmc_trackers import packet
from .server.wearers import Wearer, until, worn
from .sessions.test_recordings import Disk, raising

ROOT = Path(__file__).parents[2]
ANSWERED = 2.0  # s until each wearer is answered, or told why
COUNT, SECONDS = 3, 2.5  # wearers; s of disturbance, more than `ANSWERED`


@dataclass
class Chaos:
    """Servers and clients of the test of one row."""

    server_of: Serving
    connect: Connecting
    monkeypatch: pytest.MonkeyPatch
    folder: Path
    rng: np.random.Generator

    @contextmanager
    def wearers(
        self,
        *addresses: Address,
        seconds: float = SECONDS,
        count: int = COUNT,
        secure: ssl.SSLContext | None = None,
    ) -> Iterator[list[Wearer]]:
        """Disturb wearers within the block, then for some seconds more; check that each is answered or told why."""
        wearers = [Wearer(Settings(height=1.7 + 0.05 * k, mirror=True), secure=secure) for k in range(count)]
        with worn(wearers, *(f"{'ws' if secure is None else 'wss'}://127.0.0.1:{one.port}/ws" for one in addresses)):
            until(lambda: all(one.answered and one.placed for one in wearers))
            for one in wearers:
                one.longest = 0.0
            yield wearers
            time.sleep(seconds)
            now = time.monotonic()
            silences = [max(one.longest, now - one.answered) for one in wearers]
            assert max(silences) < ANSWERED, silences


def frames_are_odd(chaos: Chaos) -> None:
    """A wearer for each way in which frames may come, and one whose frames come as they should."""
    kept, shift = list[SignalFrame](), [0.0]

    def lost(frame: SignalFrame) -> list[SignalFrame]:
        return [frame] if chaos.rng.random() < 0.3 else []

    def late(frame: SignalFrame) -> list[SignalFrame]:
        kept.append(frame)
        others = [kept[int(k)] for k in chaos.rng.integers(max(0, len(kept) - 10), len(kept), 3)]
        return [frame, frame, *others]

    def shifted(frame: SignalFrame) -> list[SignalFrame]:
        if chaos.rng.random() < 0.05:
            shift[0] = float(chaos.rng.choice([-5e5, -100.0, -1.5, 0.0, 1.5, 1e6]))
        return [replace(frame, time=frame.time + shift[0])]

    def hasty(frame: SignalFrame) -> list[SignalFrame]:
        return [replace(frame, sequence=10 * frame.sequence + k, time=frame.time + k / 300) for k in range(10)]

    def without_hand(frame: SignalFrame) -> list[SignalFrame]:
        return [replace(frame, has=np.array([3, int(chaos.rng.choice([0, 3])), 3], dtype=np.uint8))]

    changes = (lost, late, shifted, hasty, without_hand)
    with chaos.wearers(chaos.server_of(), count=len(changes) + 1) as wearers:
        for one, change in zip(wearers, changes, strict=False):
            one.frames = change


def four_times_the_load(chaos: Chaos) -> None:
    def slow(jobs: list) -> list:
        time.sleep(4 * len(jobs) / (COUNT * 30))
        return complete(jobs)

    with chaos.wearers(chaos.server_of()):
        chaos.monkeypatch.setattr(scheduler_module, "complete", slow)


def client_does_not_read(chaos: Chaos) -> None:
    server = chaos.server_of()
    with chaos.wearers(server):
        deaf = socket.create_connection(("127.0.0.1", server.port))
        client = chaos.connect(server)
        client.socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        for k in range(300):
            with suppress(Exception):
                client.send(signal_frame(k, k / 300))
        deaf.close()


def connection_breaks(chaos: Chaos) -> None:
    with chaos.wearers(chaos.server_of()) as wearers:
        for one in wearers:
            one.do = lambda client: client.socket.shutdown(socket.SHUT_RDWR) if chaos.rng.random() < 0.03 else None
        time.sleep(SECONDS)
        for one in wearers:
            one.do = lambda client: None
    assert any(len(one.welcomes) > 1 for one in wearers)
    assert all(welcome["resumed"] for one in wearers for welcome in one.welcomes[1:])


def server_is_killed(chaos: Chaos) -> None:
    """Another server that shares nothing with it takes its wearers, who start anew."""
    command = [sys.executable, "-m", "bodysense", "serve", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            first = Address(int(process.stdout.readline().rstrip("/\n").rpartition(":")[2]))
            with chaos.wearers(first, chaos.server_of()) as wearers:
                process.kill()
                until(lambda: all(len(one.welcomes) == 2 for one in wearers))
        finally:
            process.kill()
    for one in wearers:
        first_welcome, second_welcome = one.welcomes
        assert not second_welcome["resumed"] and second_welcome["session"] != first_welcome["session"]


def no_frame_is_answered(chaos: Chaos) -> None:
    """A step hangs; the wearers get a notice once a second, until the server ends and they go to another one."""
    stuck, released = list[bool](), threading.Event()

    def hang_once(jobs: list) -> list:
        if not stuck:
            stuck.append(True)
            released.wait(60)
        return complete(jobs)

    try:
        with chaos.wearers(chaos.server_of(), chaos.server_of()) as wearers:
            chaos.monkeypatch.setattr(scheduler_module, "complete", hang_once)
            until(lambda: all(len(one.welcomes) == 2 for one in wearers))
    finally:
        released.set()
    for one in wearers:
        waits = [reason for reason in one.told if "answered no frame for" in reason]
        assert len(waits) >= HOPELESS_AFTER - 2 and one.told[-1] == "1012", one.told


@contextmanager
def store_process(port: int) -> Iterator[subprocess.Popen[bytes]]:
    program = shutil.which("valkey-server") or shutil.which("redis-server")
    if program is None:
        pytest.skip("needs Debian's valkey-server or redis-server")
    command = [program, "--port", str(port), "--save", "", "--appendonly", "no"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            until(lambda: can_connect(port))
            yield process
        finally:
            process.kill()


def can_connect(port: int) -> bool:
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
        return True
    return False


def store_fails(chaos: Chaos) -> None:
    redis = pytest.importorskip("redis", reason="needs packages/live[shared]")
    port = free_port()
    with store_process(port) as process:
        server = chaos.server_of(ServerSettings(shared=f"redis://127.0.0.1:{port}"))
        with chaos.wearers(server) as wearers:
            redis.Redis(port=port).flushall()
            time.sleep(1.0)
            process.send_signal(signal.SIGSTOP)
            for one in wearers[:2]:  # they reconnect while the store is frozen
                one.do = once(lambda client: client.socket.shutdown(socket.SHUT_RDWR))
            time.sleep(3.0)
            process.kill()
            wearers[2].do = once(lambda client: client.socket.shutdown(socket.SHUT_RDWR))
        assert all(len(one.welcomes) == 2 and one.welcomes[1]["resumed"] for one in wearers)


def once(action: Callable[[Any], object]) -> Callable[[Any], None]:
    """Return an action that does nothing from the second call on."""
    done: list[bool] = []

    def act(client: Any) -> None:
        if not done:
            done.append(True)
            action(client)

    return act


def resumed_elsewhere(chaos: Chaos) -> None:
    with storing(free_port()) as address:
        one, other = (chaos.server_of(ServerSettings(shared=address)) for _ in range(2))
        with chaos.wearers(one) as wearers:
            time.sleep(1.0)  # until the sessions are stored
            welcome = wearers[0].welcomes[0]
            again = chaos.connect(other, resume=Resume(welcome["session"], welcome["token"]))
            assert again.welcome["resumed"]
        assert any("resumed by another connection" in reason for reason in wearers[0].told)


def malformed(chaos: Chaos) -> None:
    with chaos.wearers(chaos.server_of()) as wearers:
        for message in (b"", b"\x07" * 40, "{", '{"type": "settings", "settings": {"height": "tall"}}', b"\x01" * 9000):
            wearers[0].do = once(lambda client, message=message: client.send(message))
            time.sleep(0.3)
    assert len(wearers[0].told) >= 4 and not wearers[1].told


def step_fails(chaos: Chaos) -> None:
    count = [0]

    def failing(jobs: list) -> list:
        count[0] += 1
        return [None if count[0] % 3 == 0 else one for one in complete(jobs)]

    with chaos.wearers(chaos.server_of()):
        chaos.monkeypatch.setattr(scheduler_module, "complete", failing)
    chaos.monkeypatch.undo()
    with chaos.wearers(chaos.server_of()) as wearers:
        chaos.monkeypatch.setattr(scheduler_module, "complete", lambda jobs: [None] * len(jobs))
    assert all(any("could not be completed" in reason for reason in one.told) for one in wearers)


def answer_cannot_be_sent(chaos: Chaos) -> None:
    original, failed = live_module.write_pose, list[bool]()

    def failing(*arguments: Any) -> bytes:
        if len(failed) < 2:
            failed.append(True)
            raise ZeroDivisionError
        return original(*arguments)

    with chaos.wearers(chaos.server_of()) as wearers:
        chaos.monkeypatch.setattr(live_module, "write_pose", failing)
    assert sum("failed to answer" in reason for one in wearers for reason in one.told) >= 1


def disks_fail(chaos: Chaos) -> None:
    """A wearer who records on a full disk, on one that is read-only, and on one that hangs."""
    released = threading.Event()
    disks = [
        Disk("write", 4, raising(errno.ENOSPC)),
        Disk("open", 1, raising(errno.EROFS)),
        Disk("write", 4, lambda: released.wait(60)),
    ]
    remaining = iter(disks)
    chaos.monkeypatch.setattr(recorder_module, "open_file", lambda path: next(remaining).open(path))
    chaos.monkeypatch.setattr(recordings_module, "_BATCH", 4)  # poses, so that few frames fill the queue
    try:
        with chaos.wearers(chaos.server_of(ServerSettings(allow_record=chaos.folder)), count=len(disks)) as wearers:
            for one in wearers:
                one.do = once(lambda client: client.send(write_message(RecordSwitch(True))))
            reasons = ("No space left", "Read-only", "too slow")
            until(lambda: all(any(reason in text for one in wearers for text in one.told) for reason in reasons))
    finally:
        released.set()


def certificate_changes(chaos: Chaos) -> None:
    """One wearer reconnects after the certificate has changed, the others stay connected."""
    pytest.importorskip("cryptography", reason="needs packages/live")
    chaos.monkeypatch.setenv("XDG_STATE_HOME", str(chaos.folder))
    chaos.monkeypatch.setattr(certificate_module, "CHECK_INTERVAL", 0.05)
    chaos.monkeypatch.setattr(certificate_module, "_DAYS", 0.001)  # days; it is renewed at once
    certificate, key = certificate_module.own_certificate(chaos.folder / "bodysense", ("127.0.0.1", "localhost"))
    trusting = ssl.create_default_context()
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
    server = chaos.server_of(ServerSettings(access=Access(certificate=certificate, key=key)))
    with chaos.wearers(server, secure=trusting) as wearers:
        before = ssl.get_server_certificate(("127.0.0.1", server.port))
        chaos.monkeypatch.setattr(certificate_module, "_DAYS", 397)
        until(lambda: ssl.get_server_certificate(("127.0.0.1", server.port)) != before)
        wearers[0].do = once(lambda client: client.socket.shutdown(socket.SHUT_RDWR))
    assert [len(one.welcomes) for one in wearers] == [2, *[1] * (COUNT - 1)]
    assert wearers[0].welcomes[1]["resumed"]


def own_tracker_is_lost(chaos: Chaos) -> None:
    """A controller of the server's own input comes and goes; a client that watches its wearer gets every pose."""
    port, upright = free_port(), (0.0, 0.0, 0.0, 1.0)
    client = chaos.connect(chaos.server_of(ServerSettings(vmc_in=port)), points=(), watch="vmc")
    heard, begun, longest = 0.0, time.monotonic(), 0.0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        while not heard or time.monotonic() - begun < 2 * SECONDS:
            hands = [("Con", "left", (-0.4, 1.0, 0.3), upright), ("Con", "right", (0.4, 1.0, 0.3), upright)]
            shown = hands if time.monotonic() % 1.0 < 0.5 else hands[1:]
            sender.sendto(packet(("Hmd", "HMD", (0.0, 1.6, 0.0), upright), *shown), ("127.0.0.1", port))
            with suppress(TimeoutError):
                client.frame(seconds=1 / 30)
                now = time.monotonic()
                longest, heard = max(longest, now - (heard or now)), now
            assert time.monotonic() - begun < 60
    assert longest < ANSWERED and time.monotonic() - heard < ANSWERED, longest


Row = Callable[[Chaos], None] | str  # a test here, or the name of a test elsewhere that has the same bound
ROWS: dict[str, Row] = {
    "frames are lost": frames_are_odd,
    "frames arrive late, twice, or out of order": frames_are_odd,
    "the client's clock is set (1 s or more, either way)": frames_are_odd,
    "a new frame arrives before the last one was answered": frames_are_odd,
    "several packets of VMC, VMT or OSC arrive at once": "test_bursts.py::test_the_newest_packet_of_a_turn_is_answered",
    "more frames arrive than can be completed": four_times_the_load,
    "a client reads too slowly": client_does_not_read,
    "a connection breaks": connection_breaks,
    "a worker is killed, or has not answered for 1.4 s": (
        "test_workers.py::test_wearers_of_a_worker_that_hangs_or_ends_resume_in_another"
    ),
    "a server is killed, and sessions are `--shared`": (
        "test_machines.py::test_wearers_of_a_host_that_ends_resume_at_the_other"
    ),
    "a server is killed, and nothing is shared": server_is_killed,
    "the Valkey or Redis of `--shared` is gone, frozen or emptied": store_fails,
    "a session is resumed elsewhere while its old connection still seems open": resumed_elsewhere,
    "the disk is full, read-only, slow or broken": disks_fail,
    "the certificate expires or changes while serving": certificate_changes,
    "a message is malformed": malformed,
    "a tracker of the server's own inputs is lost or found": own_tracker_is_lost,
    "a step fails, or is NaN": step_fails,
    "a session's answer cannot be sent": answer_cannot_be_sent,
    "a task of the server ends": (
        "test_supervisor.py::test_a_server_whose_scheduler_ends_closes_its_connections_and_ends_loudly"
    ),
    "no frame is answered for 10 s": no_frame_is_answered,
}


def test_every_row_of_the_documented_events_is_tested() -> None:
    text = (ROOT / "docs" / "serve.md").read_text(encoding="utf-8")
    table = text.partition("## Events\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (?!event |---)(.+?) \|", table, re.MULTILINE)
    assert rows == list(ROWS)
    for row in ROWS.values():
        if isinstance(row, str):
            file, _, name = row.partition("::")
            assert f"def {name}(" in next(Path(__file__).parent.rglob(file)).read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.alone
@pytest.mark.parametrize("row", dict.fromkeys(row for row in ROWS.values() if not isinstance(row, str)))
def test_each_wearer_is_answered_or_told_why(
    row: Callable[[Chaos], None],
    server_of: Serving,
    connect: Connecting,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    row(Chaos(server_of, connect, monkeypatch, tmp_path, np.random.default_rng(5)))
