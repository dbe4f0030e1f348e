"""What keeps a server safe from whoever reaches it: limits, tokens, origins."""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import urlsplit

from bodysense.errors import BodysenseError
from bodysense.serve.protocol import LARGEST_SIGNAL


@dataclass(frozen=True)
class Limits:
    """How much one client may ask for."""

    message_bytes: int = 8192  # of a WebSocket message
    messages_a_second: float = 400.0  # on average; twice as many at once
    seconds_to_hello: float = 5.0
    sessions: int = 64  # of a process
    seconds_to_resume: float = 10.0  # for which a session whose connection broke is kept
    waiting_messages: int = 64  # text messages that a client has not read
    recording_seconds: float = 3600.0

    def __post_init__(self) -> None:
        if self.message_bytes < LARGEST_SIGNAL:
            raise BodysenseError(f"limits: messages of {self.message_bytes} bytes; a signal takes {LARGEST_SIGNAL}")
        if not 1 <= self.sessions <= 10_000:
            raise BodysenseError(f"limits: {self.sessions} sessions; give 1 to 10000")


@dataclass(frozen=True)
class Access:
    """Who may connect."""

    host: str = "127.0.0.1"  # that the server is bound to
    token: str | None = None  # that clients must show; None is for loopback alone
    origins: tuple[str, ...] = ()  # of pages elsewhere that may connect, as `http://localhost:5173`

    def __post_init__(self) -> None:
        if self.token is None and not is_loopback(self.host):
            raise BodysenseError(f"--host {self.host} can be reached by others: it needs a token")
        if self.token is not None and (len(self.token) < 8 or not self.token.isascii()):
            raise BodysenseError("the token is too easily guessed; give at least 8 characters of ASCII, or none")


class RateLimit:
    """A bucket of twice the rate, filled at the rate."""

    def __init__(self, rate: float, now: float) -> None:
        self._rate, self._left, self._then = rate, 2 * rate, now

    def allows(self, now: float) -> bool:
        """Whether one more may come at `now` s; takes it."""
        self._left = min(2 * self._rate, self._left + (now - self._then) * self._rate)
        self._then = now
        if self._left < 1:
            return False
        self._left -= 1
        return True


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches a host's name or address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def why_refused(access: Access, host: str | None, origin: str | None, tokens: Sequence[str]) -> str | None:
    """Why a WebSocket is not opened, None where it is.

    `host` and `origin` are the headers of the request, `tokens` what it shows. A browser says the origin of the page
    that connects: it must be our own page or one that the server was told of. Without a token the host must be a
    loopback name, so that no page gets in by a name that it made point here.
    """
    if access.token is None:
        if host is None or not is_loopback(_name(host)):
            return f"the host {_short(host)} is not this machine's; open the page at http://{access.host}"
    elif not any([hmac.compare_digest(access.token.encode(), token.encode()) for token in tokens]):
        return "the token is missing or wrong; open the page with the address that the server printed"
    if origin is not None and origin not in access.origins and _authority(origin) != (host or "").lower():
        return f"the page's origin {_short(origin)} may not connect; start the server with --origin {_short(origin)}"
    return None


def _authority(origin: str) -> str:
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
        return ""


def _name(host: str) -> str:
    """The name in a Host header."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _short(text: str | None) -> str:
    return repr((text or "")[:60])
