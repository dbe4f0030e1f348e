"""Sessions that the parent of workers keeps: the same rules as those of a Valkey or Redis."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest

from bodysense_live.processes.kept_sessions import KeptSessions, ParentStore
from bodysense_live.server.messages import Resume

from .test_session_store import IDENTITY, KEPT

pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="this system has no workers")


def with_workers(count: int, use: Callable[[list[ParentStore]], Awaitable[None]], seconds: float = 10.0) -> None:
    async def go() -> None:
        parent, stores = KeptSessions(seconds), []
        for _ in range(count):
            here, there = socket.socketpair()
            parent.serve(here)
            stores.append(ParentStore(there))
        await use(stores)
        for store in stores:
            await store.close()

    asyncio.run(asyncio.wait_for(go(), 20))


def test_a_session_of_one_worker_resumes_in_another() -> None:
    async def use(stores: list[ParentStore]) -> None:
        one, other = stores
        assert await one.put({IDENTITY: (1, KEPT.to_json())}) == []
        for wrong in (Resume(IDENTITY, "another's"), Resume(16 * "b", "its own"), Resume("../../x", "its own")):
            assert await other.take(wrong) is None
        taken = await other.take(Resume(IDENTITY, "its own"))
        assert taken is not None and taken[0] == 2
        assert taken[1].person.to_json() == KEPT.person.to_json()
        assert vars(taken[1]) | {"person": None} == vars(KEPT) | {"person": None}
        old = replace(KEPT, name="old").to_json()
        assert await one.put({16 * "c": (1, KEPT.to_json()), IDENTITY: (1, old)}) == [IDENTITY]
        again = await one.take(Resume(IDENTITY, "its own"))
        assert again is not None and again[0] == 3 and again[1].name == KEPT.name

    with_workers(2, use)


def test_a_kept_session_expires() -> None:
    async def use(stores: list[ParentStore]) -> None:
        await stores[0].put({IDENTITY: (1, KEPT.to_json())})
        await asyncio.sleep(0.3)
        assert await stores[0].take(Resume(IDENTITY, "its own")) is None
        assert await stores[0].put({16 * "c": (1, "{")}) == []
        assert await stores[0].take(Resume(16 * "c", "its own")) is None  # not a session

    with_workers(1, use, seconds=0.2)


def test_many_requests_at_once_get_their_own_answers() -> None:
    async def use(stores: list[ParentStore]) -> None:
        names = [f"{k:016x}" for k in range(60)]
        put = (store.put({name: (1, replace(KEPT, name=name).to_json())}) for name in names for store in stores[:1])
        assert await asyncio.gather(*put) == [[]] * 60
        found = await asyncio.gather(*(stores[k % 2].take(Resume(name, "its own")) for k, name in enumerate(names)))
        assert [one[1].name for one in found if one is not None] == names

    with_workers(2, use)


def test_a_parent_that_does_not_answer_or_has_ended_delays_nobody_for_long() -> None:
    async def go() -> None:
        here, there = socket.socketpair()
        store = ParentStore(there)
        assert await store.put({IDENTITY: (1, KEPT.to_json())}) is None  # silent
        here.close()
        assert await store.put({IDENTITY: (1, KEPT.to_json())}) is None
        assert await store.take(Resume(IDENTITY, "its own")) is None
        await store.close()

    asyncio.run(asyncio.wait_for(go(), 3))
