"""Sessions that the parent of several workers keeps, so that the wearers of a worker that ends resume in another one.

A worker and its parent exchange lines of JSON over a socket: a request and its answer have the same `id`.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import socket
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from bodysense_live.server.messages import Resume
from bodysense_live.server.session_store import SESSION_ID, StoredSession, read_session

_TIMEOUT = 0.5  # s for an answer
_LONGEST_LINE = 1 << 24  # bytes; the sessions of one worker


class KeptSessions:
    """Sessions of all workers, each kept in the parent for `seconds` after it was last stored."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._kept: dict[str, tuple[int, str, float]] = {}  # by id: generation, state, time of expiry (s)
        self._lock = threading.Lock()

    def serve(self, channel: socket.socket) -> None:
        """Answer a worker's requests, in a thread of its own, until the worker ends."""
        threading.Thread(target=self._answer_all, args=(channel,), daemon=True).start()

    def _answer_all(self, channel: socket.socket) -> None:
        with channel, channel.makefile("rb") as lines, suppress(OSError, ValueError):
            for line in lines:
                request = json.loads(line)
                with self._lock:
                    answer = self._answer(request)
                channel.sendall(json.dumps({"id": request["id"], "answer": answer}).encode() + b"\n")

    def _answer(self, request: dict[str, Any]) -> Any:
        now = time.monotonic()
        if "put" in request:
            self._kept = {key: row for key, row in self._kept.items() if row[2] > now}
            lost = []
            for key, (generation, state) in request["put"].items():
                if key in self._kept and self._kept[key][0] > generation:
                    lost.append(key)
                else:
                    self._kept[key] = generation, state, now + self._seconds
            return lost
        generation, state, expiry = self._kept.get(request["take"], (0, "", 0.0))
        if expiry <= now:
            return None
        if request["own"]:
            generation += 1
            self._kept[request["take"]] = generation, state, expiry
        return generation, state


class ParentStore:
    """A worker's access to the sessions that its parent keeps (`session_store.SessionKeeper`)."""

    def __init__(self, channel: socket.socket) -> None:
        self._channel = channel
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._lock = asyncio.Lock()
        self._id = 0

    async def put(self, states: Mapping[str, tuple[int, str]]) -> list[str] | None:
        """Store generations and states of sessions by id.

        Return the ids of sessions that another process has resumed, or None if the parent does not answer.
        """
        return await self._ask({"put": states})

    async def take(self, resume: Resume) -> tuple[int, StoredSession] | None:
        """Return a client's session and its next generation.

        Return None for an unknown or expired session, for a wrong token, or if the parent does not answer.
        """
        if not SESSION_ID.fullmatch(resume.session):
            return None
        found = await self._ask({"take": resume.session, "own": False})
        kept = None if found is None else read_session(found[1])
        if kept is None or not hmac.compare_digest(kept.token.encode(), resume.token.encode()):
            return None
        found = await self._ask({"take": resume.session, "own": True})
        return None if found is None else (int(found[0]), kept)

    async def close(self) -> None:
        """Close the channel."""
        if self._streams is None:
            self._channel.close()
        else:
            self._streams[1].close()

    async def _ask(self, request: dict[str, Any]) -> Any:
        """Return the parent's answer to a request, or None without one."""
        async with self._lock:
            self._id += 1
            try:
                async with asyncio.timeout(_TIMEOUT):
                    if self._streams is None:
                        self._streams = await asyncio.open_unix_connection(sock=self._channel, limit=_LONGEST_LINE)
                    reader, writer = self._streams
                    writer.write(json.dumps({"id": self._id, **request}).encode() + b"\n")
                    await writer.drain()
                    while True:
                        answer = json.loads(await reader.readline())
                        if answer["id"] == self._id:  # others are late answers
                            return answer["answer"]
            except (OSError, TimeoutError, ValueError):
                return None
