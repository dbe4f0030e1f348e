"""Access to a server: limits, tokens, origins."""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import LARGEST_SIGNAL

FIRST_WAIT, LONGEST_WAIT = 0.25, 8.0  # s until a wrong token is refused
FORGET_AFTER = 60.0  # s; a wrong token after a longer pause counts as the first
ANY_ORIGIN = "*"
_WRONG_TOKEN = "the token is missing or wrong"
TOO_MANY_WRONG = "too many wrong tokens; open the page with the address that the server printed"
_MAX_WAITING = 4  # pending refusals of one key
_MAX_ADDRESSES = 4096
_TOKEN = re.compile(r"[A-Za-z0-9._~-]{8,}")  # characters that addresses and subprotocols allow
_HOST = re.compile(r"([A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\])(:[0-9]{1,5})?")  # a Host header
_ORIGIN = re.compile(r"[a-z][a-z0-9+.-]*://([a-z0-9._-]+|\[[0-9a-f:.]+\])(:[0-9]{1,5})?")  # the form that browsers send


@dataclass(frozen=True)
class RecordingLimits:
    """Limits of recordings, each checked while poses are written."""

    seconds: float = 3600.0  # of one recording
    megabytes: float = 400.0  # of one recording
    folder_megabytes: float = 10_000.0  # of all .bvh files in the folder
    folder_files: int = 10_000  # .bvh files in the folder


@dataclass(frozen=True)
class Limits:
    """Limits of clients and sessions."""

    message_bytes: int = 8192  # of a WebSocket message
    messages_a_second: float = 400.0  # on average; twice as many at once
    seconds_to_hello: float = 5.0
    seconds_to_request: float = 10.0  # for the head of a connection's first request
    sessions: int = 64  # of a process
    seconds_to_resume: float = 10.0  # for which a session whose connection broke is kept
    waiting_messages: int = 64  # text messages that a client has not read
    recording: RecordingLimits = RecordingLimits()

    def __post_init__(self) -> None:
        if self.message_bytes < LARGEST_SIGNAL:
            raise BodysenseError(f"limits: messages of {self.message_bytes} bytes; a signal takes {LARGEST_SIGNAL}")
        if not 1 <= self.sessions <= 10_000:
            raise BodysenseError(f"limits: {self.sessions} sessions; give 1 to 10000")


@dataclass(frozen=True)
class Access:
    """Conditions for connecting."""

    host: str = "127.0.0.1"  # that the server is bound to
    token: str | None = None  # that clients must show; None is for loopback alone
    origins: tuple[str, ...] = ()  # of pages elsewhere that may connect, as `http://localhost:5173`, or ANY_ORIGIN
    certificate: Path | None = None  # PEM, with `key`: connections are encrypted
    key: Path | None = None
    trusted_proxies: tuple[str, ...] = ()  # addresses or networks whose X-Forwarded-For names the client

    def __post_init__(self) -> None:
        if self.token is None and not is_loopback(self.host):
            raise BodysenseError(f"--host {self.host} can be reached by others: it needs a token")
        if self.token is None and ANY_ORIGIN in self.origins:
            raise BodysenseError("pages of any origin can reach this server: it needs a token")
        if self.token is not None and not _TOKEN.fullmatch(self.token):
            raise BodysenseError(
                "--token: give at least 8 characters of A-Z, a-z, 0-9 and -._~, for the token is part of an address; "
                "or leave it out"
            )
        for proxy in self.trusted_proxies:
            try:
                ipaddress.ip_network(proxy)
            except ValueError as error:
                raise BodysenseError(
                    f"--trusted-proxy {proxy}: {error}; give an address or a network, such as 10.0.0.0/8"
                ) from None
        for origin in self.origins:
            if origin not in (ANY_ORIGIN, "null") and not _ORIGIN.fullmatch(origin):
                raise BodysenseError(
                    f"--origin {origin}: an origin has a scheme, a host and no path; give one as http://localhost:5173"
                )


class RateLimit:
    """A token bucket, which holds up to twice the rate and is filled at the rate."""

    def __init__(self, rate: float, now: float) -> None:
        self._rate, self._remaining, self._last = rate, 2 * rate, now

    def allows(self, now: float, count: int = 1) -> bool:
        """Return whether `count` more messages are allowed at `now` s, and count them."""
        self._remaining = min(2 * self._rate, self._remaining + (now - self._last) * self._rate)
        self._last = now
        if self._remaining < count:
            return False
        self._remaining -= count
        return True


class TokenThrottle:
    """Delays after wrong tokens: each takes twice as long as the one before, and few may be pending per key.

    Right tokens are never delayed. A key is an address, or an address and the session whose token was guessed.
    """

    def __init__(self) -> None:
        self._wrong: dict[str, tuple[int, float]] = {}  # by key: count, time of the last (s)
        self._waiting: dict[str, int] = {}

    async def delay(self, key: str, now: float) -> bool:
        """Wait for the delay of a key after one more wrong token. Return False, at once, if too many are pending."""
        if self._waiting.get(key, 0) >= _MAX_WAITING:
            return False
        before, last = self._wrong.pop(key, (0, now))
        count = before + 1 if now - last < FORGET_AFTER else 1
        while len(self._wrong) >= _MAX_ADDRESSES:
            del self._wrong[next(iter(self._wrong))]  # the oldest entry
        self._wrong[key] = count, now
        self._waiting[key] = self._waiting.get(key, 0) + 1
        try:
            await asyncio.sleep(min(FIRST_WAIT * 2 ** min(count - 1, 30), LONGEST_WAIT))
        finally:
            self._waiting[key] -= 1
            if not self._waiting[key]:
                del self._waiting[key]
        return True


class AccessCheck:
    """The access check of requests. A wrong token is answered after a delay, a right one at once."""

    def __init__(self, access: Access) -> None:
        self._access, self._throttle = access, TokenThrottle()

    async def refusal_reason(self, request: Any, origin: str | None, tokens: Sequence[str]) -> str | None:
        """Return why a request or WebSocket of Starlette is refused, or None if it is admitted."""
        reason = refusal_reason(self._access, request.headers.get("host"), origin, tokens)
        if reason is not None and reason.startswith(_WRONG_TOKEN):
            address = request.client.host if request.client else ""
            if not await self._throttle.delay(address, asyncio.get_running_loop().time()):
                return TOO_MANY_WRONG
        return reason


def is_loopback(host: str) -> bool:
    """Return whether a host's name or address can be reached by this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def refusal_reason(access: Access, host: str | None, origin: str | None, tokens: Sequence[str]) -> str | None:
    """Return why a WebSocket is refused, or None if it is admitted.

    `host` and `origin` are headers of the request, `tokens` those that it presents. Browsers send the origin of the
    connecting page: it must be our own page or an allowed origin. Without a token the host must be a loopback name;
    otherwise a page could connect by a name of its own that resolves to this machine (DNS rebinding).
    """
    if access.token is None:
        if host is None or not is_loopback(_name(host)):
            return f"the host {_short(host)} is not this machine's; open the page at http://{access.host}"
    elif not any([hmac.compare_digest(access.token.encode(), token.encode()) for token in tokens]):
        return f"{_WRONG_TOKEN}; open the page with the address that the server printed"
    known = {origin, ANY_ORIGIN} & set(access.origins)
    if origin is not None and not known and _authority(origin) != (host or "").lower():
        return f"the page's origin {_short(origin)} may not connect; start the server with --origin {_short(origin)}"
    return None


def local_refusal_reason(host: str | None, origin: str | None) -> str | None:
    """Return why a WebSocket for programs and pages of this machine is refused, or None if it is admitted."""
    if host is None or not is_loopback(_name(host)):
        return f"the host {_short(host)} is not this machine's; connect to 127.0.0.1"
    if origin is not None and not is_loopback(_name(_authority(origin))):
        return f"the page's origin {_short(origin)} is not this machine's"
    return None


def _authority(origin: str) -> str:
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""


def _name(host: str) -> str:
    """Return the name in a Host header; nothing for an invalid one."""
    found = _HOST.fullmatch(host)
    return "" if found is None else found[1].strip("[]")


def _short(text: str | None) -> str:
    return repr((text or "")[:60])
