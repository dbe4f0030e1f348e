"""Sessions in a real Valkey or Redis: resuming, expiry, and a store that is gone."""

from __future__ import annotations

import asyncio
import json
import time
import urllib.error
import urllib.request
from collections.abc import Callable

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.geometry.rigid import RigidTransform
from bodysense_live.protocols.webxr import Placement
from bodysense_live.security.safety import Limits
from bodysense_live.server.messages import KnownLength, Resume, Settings, UpdateSettings, Worn
from bodysense_live.server.session_store import SessionStore, StoredSession, check_store
from bodysense_live.server.settings import ServerSettings

from ...conftest import Refused
from ..conftest import Address, Connecting, Serving, free_port, signal, storing

IDENTITY = 16 * "a"
MOUNT = RigidTransform(np.array([0.0, 0.1, 0.02]), np.array([0.6, 0.8, 0.0, 0.0]))
KEPT = StoredSession(
    "its own",
    "watch",
    "ada",
    Settings(
        height=1.6,
        mirror=True,
        regions=("head", "arms"),
        lengths=(KnownLength("left_hip", "left_knee", 0.41),),
        worn=(Worn("tracker_2", "pelvis"),),
    ),
    Person(height=1.6, mounts={"pelvis": MOUNT}),
    Placement(0.5, (1.0, 0.0, 2.0)),
)


def with_store(address: str, seconds: float, use: Callable[[SessionStore], object]) -> None:
    async def go() -> None:
        store = SessionStore(address, seconds)
        await use(store)  # type: ignore[misc]
        await store.close()

    asyncio.run(asyncio.wait_for(go(), 20))


def until(holds: Callable[[], bool], seconds: float = 5.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_stored_session_needs_its_token_and_expires(shared: str) -> None:
    async def use(store: SessionStore) -> None:
        assert await store.put({IDENTITY: (1, KEPT.to_json())}) == []
        assert await store.take(Resume(IDENTITY, "another's")) is None
        assert await store.take(Resume(16 * "b", "its own")) is None
        assert await store.take(Resume("../../etc/passwd", "its own")) is None
        taken = await store.take(Resume(IDENTITY, "its own"))
        assert taken is not None and taken[0] == 2
        found = taken[1]
        assert found.person.to_json() == KEPT.person.to_json()
        assert vars(found) | {"person": None} == vars(KEPT) | {"person": None}
        await store.put({IDENTITY: (2, KEPT.to_json())})
        await asyncio.sleep(0.6)
        assert await store.take(Resume(IDENTITY, "its own")) is None

    with_store(shared, 0.5, use)


def test_an_older_generation_stores_nothing(shared: str) -> None:
    async def use(store: SessionStore) -> None:
        await store.put({IDENTITY: (1, KEPT.to_json())})
        assert await store.take(Resume(IDENTITY, "its own")) is not None
        old = StoredSession(**{**vars(KEPT), "name": "old"}).to_json()
        assert await store.put({16 * "c": (1, KEPT.to_json()), IDENTITY: (1, old)}) == [IDENTITY]
        taken = await store.take(Resume(IDENTITY, "its own"))
        assert taken is not None and taken[0] == 3 and taken[1].name == "ada"

    with_store(shared, 10.0, use)


@pytest.mark.parametrize("text", ["", '{"token": 3}', "[" * 100_000, None])
def test_any_stored_text_is_read_or_ignored(shared: str, text: str | None) -> None:
    """`text` None: a value of another type."""
    from redis import Redis

    with Redis.from_url(shared) as client:
        if text is None:
            client.set(f"bodysense:session:{IDENTITY}", "x")
        else:
            client.hset(f"bodysense:session:{IDENTITY}", "state", text)

    async def use(store: SessionStore) -> None:
        assert await store.take(Resume(IDENTITY, "its own")) is None

    with_store(shared, 10.0, use)


def test_two_servers_resume_one_anothers_sessions(server_of: Serving, connect: Connecting, shared: str) -> None:
    """A client behind a proxy reconnects to the second server, and later to the first."""
    one, other = (server_of(ServerSettings(shared=shared)) for _ in range(2))
    first = connect(one, settings=Settings(height=1.6, mirror=True))
    again = Resume(first.welcome["session"], first.welcome["token"])
    from redis import Redis

    with Redis.from_url(shared) as client:
        until(lambda: client.exists(f"bodysense:session:{again.session}") == 1)
    second = connect(other, resume=again)
    assert second.welcome["resumed"] and second.welcome["session"] == again.session
    assert second.welcome["settings"]["mirror"] and second.welcome["height"] == pytest.approx(1.6)
    # The first server has not noticed that its client is gone, and learns it from the store.
    assert "resumed by another connection" in first.text("error")["reason"]
    second.send_message(UpdateSettings({"height": 1.7}))
    until(lambda: second.text("welcome")["height"] == pytest.approx(1.7))
    time.sleep(0.3)  # stored
    third = connect(one, resume=again)
    assert third.welcome["resumed"] and third.welcome["settings"]["height"] == 1.7
    assert not connect(other, resume=Resume(again.session, "another")).welcome["resumed"]


def test_a_wearer_who_returns_to_the_same_server_keeps_the_motion(
    server_of: Serving, connect: Connecting, shared: str
) -> None:
    server = server_of(ServerSettings(shared=shared))
    client = connect(server)
    again = Resume(client.welcome["session"], client.welcome["token"])
    client.answered(signal(0, 0.0))
    client.answered(signal(1, 0.02))
    client.socket.close()
    time.sleep(0.7)
    back = connect(server, resume=again)
    assert back.welcome["resumed"]
    back.send(signal(2, 0.02))  # late for the session's clock, which is kept
    until(lambda: b'bodysense_drops_total{reason="late"} 1.0' in metrics(server))
    assert back.answered(signal(3, 0.04)).sequence == 3


def metrics(server: Address) -> bytes:
    with urllib.request.urlopen(f"{server.http}/metrics", timeout=5) as answer:
        return answer.read()


def test_sessions_continue_without_the_store_and_are_stored_once_it_returns(
    server_of: Serving, connect: Connecting
) -> None:
    port = free_port()
    with storing(port) as address:
        server, other = (server_of(ServerSettings(shared=address)) for _ in range(2))
        client = connect(server, settings=Settings(height=1.5))
    until(lambda: b"bodysense_unshared_total 0.0" not in metrics(server))
    assert client.answered(signal(0, 0.0)).sequence == 0
    again = Resume(client.welcome["session"], client.welcome["token"])
    assert not connect(other, resume=again).welcome["resumed"]
    with storing(port):
        time.sleep(1.5)
        found = connect(other, resume=again).welcome
        assert found["resumed"] and found["settings"]["height"] == 1.5


def test_a_full_server_is_not_ready(server_of: Serving, connect: Connecting) -> None:
    server = server_of(ServerSettings(limits=Limits(sessions=1)))
    with urllib.request.urlopen(f"{server.http}/readyz", timeout=5) as answer:
        assert answer.read() == b"ready\n"
    client = connect(server)
    with pytest.raises(urllib.error.HTTPError, match="503"):
        urllib.request.urlopen(f"{server.http}/readyz", timeout=5)
    client.socket.close()

    def is_ready() -> bool:  # a disconnected session may be replaced
        try:
            return urllib.request.urlopen(f"{server.http}/readyz", timeout=5).status == 200
        except urllib.error.HTTPError:
            return False

    until(is_ready)


def test_steps_are_counted_for_an_autoscaler(server_of: Serving, connect: Connecting) -> None:
    server = server_of()
    connect(server).answered(signal(0, 0.0))
    rows = dict(line.rsplit(b" ", 1) for line in metrics(server).splitlines() if not line.startswith(b"#"))
    assert 0 < float(rows[b"bodysense_step_seconds_total"]) < 60


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        (
            "/srv/sessions",
            "--shared /srv/sessions: give the address of a Valkey or Redis, such as redis://10.0.0.2:6379",
        ),
        ("http://here", "--shared http://here: give the address of a Valkey or Redis"),
        ("redis://127.0.0.1:port", "--shared redis://127.0.0.1:port: refused (Port could not be cast"),
    ],
)
def test_an_address_of_no_store_is_refused(refused: Refused, address: str, expected: str) -> None:
    pytest.importorskip("redis", reason="needs packages/live[shared]")
    line = refused("serve", "--port", 0, "--shared", address)
    assert expected in line and "secret99" not in line


def test_a_wrong_password_is_refused(refused: Refused, store: str) -> None:
    line = refused("serve", "--port", 0, "--shared", store.replace(":pw@", ":secret99@"))
    assert "refused (" in line and "give the address and the password" in line and "secret99" not in line


def test_a_server_starts_while_its_store_is_away(capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("redis", reason="needs packages/live[shared]")
    port = free_port()
    address = f"redis://ada:secret99@127.0.0.1:{port}/0"
    assert check_store(address) == address
    line = capfd.readouterr().err
    assert line.startswith(f"bodysense: --shared redis://127.0.0.1:{port}/0: no Valkey or Redis answers there yet (")
    assert line.count("\n") == 1 and "secret99" not in line


def test_a_server_that_started_without_its_store_shares_sessions_once_it_answers(
    server_of: Serving, connect: Connecting
) -> None:
    pytest.importorskip("redis", reason="needs packages/live[shared]")
    port = free_port()
    address = f"redis://:pw@127.0.0.1:{port}"
    one, other = (server_of(ServerSettings(shared=check_store(address))) for _ in range(2))
    client = connect(one, settings=Settings(height=1.5))
    again = Resume(client.welcome["session"], client.welcome["token"])
    with storing(port):
        time.sleep(1.5)
        found = connect(other, resume=again).welcome
        assert found["resumed"] and found["settings"]["height"] == 1.5


def test_stored_text_is_valid_json() -> None:
    settings = json.loads(KEPT.to_json())["settings"]
    assert "NaN" not in KEPT.to_json() and settings["worn"] == [{"tracker": "tracker_2", "joint": "pelvis"}]
