"""Sessions for other server processes to resume, in a Valkey or Redis that they share.

The estimator's memory is not kept, so the motion begins anew; who the wearer is, how trackers are worn, where the
middle is and what was set stay.

A session has a turn, which rises each time it is taken on. A process whose turn is over stores nothing: a server that
lost its wearers without noticing cannot undo what the next one stored.
"""

from __future__ import annotations

import hmac
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from bodysense.body.person import Person
from bodysense.errors import BodysenseError, missing_package
from bodysense_live.message_text import changed
from bodysense_live.messages import Resume, Settings
from bodysense_live.webxr import Placement

_SESSION_ID = re.compile(r"[0-9a-f]{16}")
_PATIENCE = 0.5  # s for an answer
# KEYS: the session's. ARGV: turn, state, ms to keep. Returns 1; or 0 if another process has had a later turn.
_PUT = """
if tonumber(redis.call('HGET', KEYS[1], 'turn') or '0') > tonumber(ARGV[1]) then return 0 end
redis.call('HSET', KEYS[1], 'turn', ARGV[1], 'state', ARGV[2])
redis.call('PEXPIRE', KEYS[1], ARGV[3])
return 1
"""


@dataclass(frozen=True, eq=False)
class StoredSession:
    """A session as another process takes it on."""

    token: str
    watch_token: str
    name: str
    settings: Settings
    person: Person
    placement: Placement
    worn: dict[str, str]  # undecided trackers → joints

    def to_json(self) -> str:
        """Return the text that is stored."""
        plain = vars(self) | {"person": self.person.to_json()}
        return json.dumps(plain, default=asdict)


class SessionStore:
    """Sessions at a redis:// address, each for `seconds` after it was last put there."""

    def __init__(self, address: str, seconds: float) -> None:
        self._redis = _client("asyncio", address)
        self._milliseconds = int(1000 * seconds)

    async def put(self, states: Mapping[str, tuple[int, str]]) -> list[str] | None:
        """Keep turns and states of sessions. Return those that another process took on; None without an answer."""
        pipeline = self._redis.pipeline(transaction=False)
        for session_id, (generation, state) in states.items():
            pipeline.eval(_PUT, 1, _key(session_id), generation, state, self._milliseconds)
        try:
            found = await pipeline.execute()
        except _failures():
            return None
        return [session_id for session_id, is_ours in zip(states, found, strict=True) if not is_ours]

    async def take(self, resume: Resume) -> tuple[int, StoredSession] | None:
        """Return the session that a client had, and its next turn.

        Return None for an unknown session, for one that is over, for a wrong token, and without an answer.
        """
        if not _SESSION_ID.fullmatch(resume.session):
            return None
        try:
            kept = _read(await self._redis.hget(_key(resume.session), "state"))
            if kept is None or not hmac.compare_digest(kept.token.encode(), resume.token.encode()):
                return None
            return int(await self._redis.hincrby(_key(resume.session), "turn", 1)), kept
        except _failures():
            return None

    async def close(self) -> None:
        """Hang up."""
        await self._redis.aclose()


def check_store(address: str) -> str:
    """Return the address of a Valkey or Redis that answers. Raises BodysenseError, without its password, for others."""
    redacted = re.sub("//.*@", "//", address)
    if not address.startswith(("redis://", "rediss://", "unix://")):
        raise BodysenseError(
            f"--shared {redacted}: give the address of a Valkey or Redis, such as redis://10.0.0.2:6379"
        )
    try:
        with _client("client", address) as client:
            client.ping()
    except (*_failures(), ValueError) as error:
        raise BodysenseError(
            f"--shared {redacted}: no Valkey or Redis answers there ({error}); start one, or leave --shared out"
        ) from None
    return address


def _client(module: str, address: str) -> Any:
    """Return a client of redis.client or redis.asyncio, which connects with its first command."""
    from importlib import import_module

    try:
        kind = import_module(f"redis.{module}").Redis
    except ImportError as error:
        raise missing_package(error) from None
    return kind.from_url(address, socket_timeout=_PATIENCE, socket_connect_timeout=_PATIENCE)


def _failures() -> tuple[type[Exception], ...]:
    """Return what a client raises if nothing answers, or not what was asked for."""
    from redis.exceptions import RedisError

    return RedisError, OSError


def _key(session_id: str) -> str:
    return f"bodysense:session:{session_id}"


def _read(state: bytes | None) -> StoredSession | None:
    """Return what was stored; None for anything that `StoredSession.to_json` did not write."""
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
            {str(name): str(joint) for name, joint in row["worn"].items()},
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, BodysenseError):
        return None
