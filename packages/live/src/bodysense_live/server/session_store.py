"""Sessions for other server processes to resume, in a Valkey or Redis that they share.

Person, tracker joints, placement and settings are stored. The tracker's state is not, so the motion starts anew.

A session has a generation, which increases whenever a process resumes it. A process with an older generation cannot
store the session: a server that has lost its clients without noticing cannot overwrite what the next one stored.
"""

from __future__ import annotations

import hmac
import json
import re
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Protocol

from bodysense.body.person import Person
from bodysense.errors import BodysenseError, missing_package
from bodysense_live.protocols.webxr import Placement
from bodysense_live.server.message_text import changed
from bodysense_live.server.messages import Resume, Settings

SESSION_ID = re.compile(r"[0-9a-f]{16}")
_TIMEOUT = 0.5  # s for an answer
# KEYS: the session's. ARGV: generation, state, ms to keep. Returns 1, or 0 if another process stored a later one.
_PUT = """
if tonumber(redis.call('HGET', KEYS[1], 'turn') or '0') > tonumber(ARGV[1]) then return 0 end
redis.call('HSET', KEYS[1], 'turn', ARGV[1], 'state', ARGV[2])
redis.call('PEXPIRE', KEYS[1], ARGV[3])
return 1
"""


@dataclass(frozen=True, eq=False)
class StoredSession:
    """A session in the form that another process resumes."""

    token: str
    watch_token: str
    name: str
    settings: Settings
    person: Person
    placement: Placement

    def to_json(self) -> str:
        """Return the text to store."""
        plain = vars(self) | {"person": self.person.to_json()}
        return json.dumps(plain, default=asdict)


class SessionKeeper(Protocol):
    """A place where processes keep the sessions that others may resume."""

    async def put(self, states: Mapping[str, tuple[int, str]]) -> list[str] | None:
        """Store generations and states of sessions by id.

        Return the ids of sessions that another process has resumed, or None if the store does not answer.
        """
        ...

    async def take(self, resume: Resume) -> tuple[int, StoredSession] | None:
        """Return a client's session and its next generation, or None."""
        ...

    async def close(self) -> None:
        """Close the connection to the store."""
        ...


class SessionStore:
    """Sessions at a redis:// address, each kept for `seconds` after it was last stored."""

    def __init__(self, address: str, seconds: float) -> None:
        self._redis = _client("asyncio", address)
        self._milliseconds = int(1000 * seconds)

    async def put(self, states: Mapping[str, tuple[int, str]]) -> list[str] | None:
        """Store generations and states of sessions by id.

        Return the ids of sessions that another process has resumed, or None if the store does not answer.
        """
        pipeline = self._redis.pipeline(transaction=False)
        for session_id, (generation, state) in states.items():
            pipeline.eval(_PUT, 1, _key(session_id), generation, state, self._milliseconds)
        try:
            found = await pipeline.execute()
        except _failures():
            return None
        return [session_id for session_id, is_ours in zip(states, found, strict=True) if not is_ours]

    async def take(self, resume: Resume) -> tuple[int, StoredSession] | None:
        """Return a client's session and its next generation.

        Return None for an unknown or expired session, for a wrong token, or if the store does not answer.
        """
        if not SESSION_ID.fullmatch(resume.session):
            return None
        try:
            kept = read_session(await self._redis.hget(_key(resume.session), "state"))
            if kept is None or not hmac.compare_digest(kept.token.encode(), resume.token.encode()):
                return None
            return int(await self._redis.hincrby(_key(resume.session), "turn", 1)), kept
        except _failures():
            return None

    async def close(self) -> None:
        """Close the connection to the store."""
        await self._redis.aclose()


def check_store(address: str) -> str:
    """Return the address of a Valkey or Redis. Print a warning if it is away: sessions are stored once it answers.

    Raises BodysenseError, without the password, for an address or a password that is wrong.
    """
    redacted = re.sub("//.*@", "//", address)
    if not address.startswith(("redis://", "rediss://", "unix://")):
        raise BodysenseError(
            f"--shared {redacted}: give the address of a Valkey or Redis, such as redis://10.0.0.2:6379"
        )
    try:
        with _client("client", address) as client:
            client.ping()
    except (*_failures(), ValueError) as error:
        if not _is_away(error):
            raise BodysenseError(
                f"--shared {redacted}: refused ({error}); give the address and the password of a Valkey or Redis"
            ) from None
        text = f"no Valkey or Redis answers there yet ({error}); sessions are shared once one does"
        print(f"bodysense: --shared {redacted}: {text}", file=sys.stderr)
    return address


def _client(module: str, address: str) -> Any:
    """Return a client of redis.client or redis.asyncio, which connects with its first command."""
    from importlib import import_module

    try:
        kind = import_module(f"redis.{module}").Redis
    except ImportError as error:
        raise missing_package(error) from None
    return kind.from_url(address, socket_timeout=_TIMEOUT, socket_connect_timeout=_TIMEOUT)


def _failures() -> tuple[type[Exception], ...]:
    """Return the exceptions of a client whose server does not answer, or answers with an error."""
    from redis.exceptions import RedisError

    return RedisError, OSError


def _is_away(error: Exception) -> bool:
    """Return whether a server does not answer yet."""
    from redis.exceptions import AuthenticationError, ConnectionError, TimeoutError

    return isinstance(error, (ConnectionError, TimeoutError, OSError)) and not isinstance(error, AuthenticationError)


def _key(session_id: str) -> str:
    return f"bodysense:session:{session_id}"


def read_session(state: bytes | str | None) -> StoredSession | None:
    """Return a stored session; None for text that `StoredSession.to_json` did not write."""
    if state is None:
        return None
    try:
        row: Any = json.loads(state)
        x, y, z = row["placement"]["offset"]
        return StoredSession(
            str(row["token"]),
            str(row["watch_token"]),
            str(row["name"]),
            changed(Settings(), row["settings"]),
            Person.from_json(row["person"]),
            Placement(float(row["placement"]["heading"]), (float(x), float(y), float(z))),
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, BodysenseError):
        return None
