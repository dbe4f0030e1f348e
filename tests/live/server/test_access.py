"""Access: certificates, wrong tokens, endless requests, the selection of a body for avatars, watching, stopping."""

from __future__ import annotations

import asyncio
import socket
import ssl
import threading
import time
import urllib.error
import urllib.request
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509

from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import SIGNAL
from bodysense_live.security import certificate as certificate_module
from bodysense_live.security import safety
from bodysense_live.security.certificate import check_pair, own_certificate, qr_code
from bodysense_live.security.safety import Access, Limits, TokenThrottle
from bodysense_live.server.live import Live
from bodysense_live.server.messages import Hello, Recentre, Resume, Source
from bodysense_live.server.metrics import Metrics
from bodysense_live.server.send_queue import SendQueue
from bodysense_live.server.session_slot import OutputSelector, SessionSlot
from bodysense_live.server.settings import ServerSettings
from bodysense_live.server.supervisor import Supervisor
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.session import Session

from ..conftest import DEVICES, Address, Connecting, Serving, signal


def test_a_certificate_is_created_once_for_its_addresses(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    certificate, key = own_certificate(tmp_path / "state", ("192.168.1.7", "localhost"))
    first = certificate.read_bytes()
    check_pair(certificate, key)
    assert key.stat().st_mode & 0o077 == 0
    own_certificate(tmp_path / "state", ("192.168.1.7",))
    assert certificate.read_bytes() == first
    own_certificate(tmp_path / "state", ("192.168.1.8",))
    assert certificate.read_bytes() != first


def test_browsers_accept_a_certificate_that_cannot_sign_others(tmp_path: Path) -> None:
    """Browsers refuse certificates of more than 398 days; clocks may be late by a day."""
    made = x509.load_pem_x509_certificate(own_certificate(tmp_path, ("192.168.1.7",))[0].read_bytes())
    assert made.extensions.get_extension_for_class(x509.BasicConstraints).value.path_length == 0
    now, day = datetime.now(UTC), timedelta(days=1)
    assert made.not_valid_before_utc <= now - day and now + 300 * day < made.not_valid_after_utc
    assert made.not_valid_after_utc - made.not_valid_before_utc <= 398 * day


def test_invalid_certificate_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.pem").write_text("no")
    with pytest.raises(BodysenseError, match=r"--certificate .*a\.pem --key .*give PEM files"):
        check_pair(tmp_path / "a.pem", tmp_path / "a.pem")


def test_a_browser_that_trusts_the_certificate_connects(server_of: Serving, tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    certificate, key = own_certificate(tmp_path, ("127.0.0.1", "localhost"))
    access = replace(ServerSettings().access, certificate=certificate, key=key)
    server = server_of(ServerSettings(access=access))
    context = ssl.create_default_context(cafile=str(certificate))
    with (
        socket.create_connection(("127.0.0.1", server.port), timeout=10) as plain,
        context.wrap_socket(plain, server_hostname="127.0.0.1") as secure,
    ):
        secure.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        assert secure.recv(4096).startswith(b"HTTP/1.1 200")


def test_a_certificate_that_changes_or_expires_is_renewed_while_serving(
    server_of: Serving, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("cryptography")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(certificate_module, "CHECK_INTERVAL", 0.05)
    monkeypatch.setattr(certificate_module, "_DAYS", 0.001)  # days; it would be refused within two minutes
    certificate, key = certificate_module.own_certificate(tmp_path / "bodysense", ("127.0.0.1", "localhost"))
    first = certificate.read_text()
    server = server_of(ServerSettings(access=Access(certificate=certificate, key=key)))
    open_before = ssl.create_default_context(cafile=str(certificate))
    open_before.check_hostname = False
    open_before.verify_mode = ssl.CERT_NONE
    with (
        socket.create_connection(("127.0.0.1", server.port), timeout=10) as plain,
        open_before.wrap_socket(plain) as secure,
    ):
        monkeypatch.setattr(certificate_module, "_DAYS", 397)
        end = time.monotonic() + 10
        while (served := ssl.get_server_certificate(("127.0.0.1", server.port))) == first:
            assert time.monotonic() < end
            time.sleep(0.05)
        until_renewed = time.monotonic() + 10
        while served != certificate.read_text() and time.monotonic() < until_renewed:
            time.sleep(0.05)
            served = ssl.get_server_certificate(("127.0.0.1", server.port))
        assert served == certificate.read_text() != first
        secure.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
        assert secure.recv(4096).startswith(b"HTTP/1.1 200")  # of the connection that was open before
    certificate.write_text("no certificate")
    monkeypatch.setattr(certificate_module, "own_certificate", lambda *given: given)
    end = time.monotonic() + 10
    while "cannot be renewed" not in capfd.readouterr().err:
        assert time.monotonic() < end
        time.sleep(0.05)
    assert ssl.get_server_certificate(("127.0.0.1", server.port)) == served


def test_a_qr_code_is_drawn() -> None:
    pytest.importorskip("segno")
    assert len(qr_code("https://192.168.1.7:8765/?token=abc").splitlines()) > 10


def test_a_request_that_never_ends_is_closed(server_of: Serving) -> None:
    server = server_of(ServerSettings(limits=Limits(seconds_to_request=0.3)))
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as half:
        half.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0")
        begun = time.monotonic()
        assert half.recv(100) == b"" and time.monotonic() - begun < 5


def test_a_websocket_outlives_the_time_for_its_request(server_of: Serving, connect: Connecting) -> None:
    client = connect(server_of(ServerSettings(limits=Limits(seconds_to_request=0.2))))
    time.sleep(0.5)
    assert client.answered(signal(1, 0.0)).sequence == 1


def test_few_refusals_of_a_key_are_pending() -> None:
    async def guess() -> tuple[bool, list[asyncio.Task[bool]]]:
        throttle = TokenThrottle()
        waiting = [asyncio.create_task(throttle.delay("10.0.0.1", 0.0)) for _ in range(4)]
        other = asyncio.create_task(throttle.delay("10.0.0.2", 0.0))
        await asyncio.sleep(0)
        found = await throttle.delay("10.0.0.1", 0.0)
        pending = [task for task in (*waiting, other) if not task.done()]
        for task in pending:
            task.cancel()
        await asyncio.gather(*pending, return_exceptions=True)
        return found, pending

    found, pending = asyncio.run(guess())
    assert not found and len(pending) == 5


def asked(address: Address, token: str, forwarded: str | None = None) -> tuple[int, float]:
    """Return status and duration (s) of a request for metrics with a token."""
    headers = {"Authorization": f"Bearer {token}"} | ({"X-Forwarded-For": forwarded} if forwarded else {})
    begun = time.monotonic()
    try:
        with urllib.request.urlopen(
            urllib.request.Request(f"{address.http}/metrics", headers=headers), timeout=30
        ) as got:
            return got.status, time.monotonic() - begun
    except urllib.error.HTTPError as error:
        with error:
            return error.code, time.monotonic() - begun


def test_each_wrong_token_doubles_the_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []

    async def sleep(seconds: float) -> None:
        waits.append(seconds)

    monkeypatch.setattr(safety.asyncio, "sleep", sleep)
    throttle = TokenThrottle()

    async def go() -> None:
        for key, now in (*(("one", float(k)) for k in range(7)), ("other", 7.0), ("one", 6.0 + safety.FORGET_AFTER)):
            assert await throttle.delay(key, now)

    asyncio.run(go())
    assert waits == [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 8.0, 0.25, 0.25]


def test_wrong_tokens_never_lock_out_the_right_one(server_of: Serving, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(safety, "LONGEST_WAIT", 1.0)  # s until the last guess is answered
    server, over = server_of(ServerSettings(Access(token="secret-token"))), threading.Event()
    statuses: list[int] = []

    def guess() -> None:
        while not over.is_set():
            statuses.append(asked(server, "wrong-token")[0])

    threads = [threading.Thread(target=guess) for _ in range(8)]
    for thread in threads:
        thread.start()
    try:
        time.sleep(0.5)
        for _ in range(10):
            status, seconds = asked(server, "secret-token")
            assert status == 200 and seconds < 1.0
    finally:
        over.set()
        for thread in threads:
            thread.join(20)
    assert set(statuses) == {403}


@pytest.mark.parametrize(("proxies", "is_one"), [((), True), (("127.0.0.0/8",), False), (("10.0.0.0/8",), True)])
def test_only_a_trusted_proxy_names_the_client(
    server_of: Serving, monkeypatch: pytest.MonkeyPatch, proxies: tuple[str, ...], is_one: bool
) -> None:
    """Wrong tokens of one client delay those of another only if both seem to have the proxy's address."""
    keys: list[str] = []

    async def delay(self: TokenThrottle, key: str, now: float) -> bool:
        keys.append(key)
        return True

    monkeypatch.setattr(TokenThrottle, "delay", delay)
    server = server_of(ServerSettings(Access(token="secret-token", trusted_proxies=proxies)))
    for forwarded in ("203.0.113.1, 203.0.113.5", "203.0.113.5, 203.0.113.2"):  # the last address is the proxy's word
        assert asked(server, "wrong-token", forwarded)[0] == 403
    assert keys == (["127.0.0.1"] * 2 if is_one else ["203.0.113.5", "203.0.113.2"])


@pytest.mark.parametrize("proxy", ["proxy.example", "10.0.0.0/99", "10.0.0.1/8", ""])
def test_proxies_are_addresses(proxy: str) -> None:
    with pytest.raises(BodysenseError, match=r"--trusted-proxy .*give an address or a network"):
        Access(trusted_proxies=(proxy,))


def test_a_wrong_token_of_a_session_is_delayed_by_address_and_session(monkeypatch: pytest.MonkeyPatch) -> None:
    keys: list[str] = []

    async def delay(self: TokenThrottle, key: str, now: float) -> bool:
        keys.append(key)
        return len(keys) < 5

    monkeypatch.setattr(TokenThrottle, "delay", delay)

    async def go() -> list[str]:
        live = Live(ServerSettings(), Metrics(), Supervisor(lambda failure: None))
        live.start()
        slots = [await live.admit(Hello(1, DEVICES), SendQueue(8)) for _ in range(2)]

        async def resumed(k: int, address: str, token: str) -> SessionSlot:
            hello = Hello(1, DEVICES, resume=Resume(slots[k].session_id, token))
            return await live.admit(hello, SendQueue(8), address)

        for k, address in ((0, "10.0.0.1"), (1, "10.0.0.1"), (0, "10.0.0.2"), (0, "10.0.0.1")):
            assert await resumed(k, address, "x") not in slots
        assert await resumed(0, "10.0.0.1", slots[0].token) is slots[0]  # the right token never waits
        with pytest.raises(BodysenseError, match="too many wrong tokens"):
            await resumed(0, "10.0.0.1", "x")
        await live.stop()
        return [slot.session_id for slot in slots]

    one, other = asyncio.run(go())
    assert keys == [f"10.0.0.1 {one}", f"10.0.0.1 {other}", f"10.0.0.2 {one}", f"10.0.0.1 {one}", f"10.0.0.1 {one}"]


def answer(points: int) -> Answer:
    session = Session(DEVICES)
    session.receive(signal(0, 0.0, points), 0.0)
    found = session.step()
    assert found is not None
    return found


def slot(source: Source | None = None) -> SessionSlot:
    return SessionSlot("", "", "", "", Session(DEVICES), source)


def test_the_first_session_with_a_tracked_body_is_selected() -> None:
    body, nothing = answer(3), answer(0)
    selector, page, headset, own = OutputSelector(), slot(), slot(), slot("vmc")
    selected = [
        selector.selects(page, nothing, False, 0.0),
        selector.selects(headset, body, False, 0.1),
        selector.selects(page, body, False, 0.2),
        selector.selects(own, body, True, 0.3),
        selector.selects(headset, body, False, 1.0),
        selector.selects(headset, body, False, 1.4),
    ]
    assert selected == [False, True, False, True, False, True]


def test_a_page_that_watches_a_replay_is_never_selected() -> None:
    selector, page, own = OutputSelector(), slot("replay"), slot("vmc")
    assert not selector.selects(page, answer(3), False, 0.0)
    assert selector.selects(own, answer(3), True, 0.1)
    assert not selector.selects(page, answer(3), False, 60.0)  # even if the input is silent


def test_a_session_is_watched_with_its_token(server_of: Serving, connect: Connecting) -> None:
    server = server_of(ServerSettings())
    wearer = connect(server)
    follow = Resume(wearer.welcome["session"], wearer.welcome["watch_token"])
    watcher = connect(server, points=(), follow=follow)
    assert not watcher.welcome["token"] and not watcher.welcome["watch_token"]
    wearer.answered(signal(7, 0.0))
    assert watcher.frame(SIGNAL) and watcher.pose().sequence == 7
    watcher.send_message(Recentre())
    assert "cannot change it" in watcher.text("error")["reason"]
    assert wearer.answered(signal(9, 0.2)).sequence == 9


def test_a_wrong_token_watches_nothing() -> None:
    async def follow() -> str:
        live = Live(ServerSettings(), Metrics(), Supervisor(lambda failure: None))
        live.start()
        slot = await live.admit(Hello(1, DEVICES), SendQueue(8))
        try:
            await live.admit(Hello(1, follow=Resume(slot.session_id, slot.token)), SendQueue(8))
        except BodysenseError as error:
            return str(error)
        finally:
            await live.stop()
        return ""

    assert "its token is wrong" in asyncio.run(follow())


@pytest.mark.parametrize("turns", range(4))
def test_a_server_stops_in_any_turn_of_its_loop_after_a_client_left(turns: int) -> None:
    async def left_and_stopped() -> None:
        live, queue = Live(ServerSettings(), Metrics(), Supervisor(lambda failure: None)), SendQueue(8)
        live.start()
        slot = await live.admit(Hello(1, DEVICES), queue)
        await asyncio.sleep(0.15)  # until no session must be stored
        live.disconnect(slot, queue)
        for _ in range(turns):
            await asyncio.sleep(0)
        async with asyncio.timeout(5):
            await live.stop()

    asyncio.run(left_and_stopped())
