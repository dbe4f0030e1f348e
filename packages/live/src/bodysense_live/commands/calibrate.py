"""`bodysense calibrate`: measure the wearer of a running server."""

from __future__ import annotations

import json
import time
from typing import Annotated, Any, Literal
from urllib.parse import SplitResult, parse_qs, urlsplit

import tyro

from bodysense.errors import BodysenseError

_TIMEOUT = 5.0  # s for an answer of the server


def calibrate(
    address: Annotated[str, tyro.conf.Positional] = "http://127.0.0.1:8765/",
    watch: Literal["vmc", "vmt", "vrchat", "slimevr", "solarxr"] = "vmc",
    arms_out: bool = False,
    recentre: bool = False,
    wait: float = 5.0,
) -> None:
    """Measure the standing wearer of a running server in one second (VMC, SteamVR, VRChat, OpenXR or SlimeVR).

    Args:
        address: address that `bodysense serve` printed, token included.
        watch: input of the server that tracks the wearer.
        arms_out: stand with the arms out to the sides, so that their reach is measured, too.
        recentre: use the wearer's position and heading afterwards as the origin.
        wait: seconds until the measurement begins.
    """
    from websockets import InvalidStatus, WebSocketException
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    from bodysense.io.formats.protocol import SUBPROTOCOL
    from bodysense_live.server.message_text import write_message
    from bodysense_live.server.messages import Calibrate, Hello, Recentre

    if not 0 <= wait <= 600:
        raise BodysenseError(f"--wait {wait:g}: give 0 to 600 seconds")
    parts = _parsed_address(address)
    if parts is None:
        raise BodysenseError(f"{address}: give the address that `bodysense serve` printed, as http://127.0.0.1:8765/")
    tokens = [f"token.{token}" for token in parse_qs(parts.query).get("token", [])]
    scheme = "wss" if parts.scheme == "https" else "ws"
    protocols = [Subprotocol(name) for name in (SUBPROTOCOL, *tokens)]
    try:
        with connect(f"{scheme}://{parts.netloc}/ws", subprotocols=protocols, compression=None) as server:
            server.send(write_message(Hello(1, watch=watch)))
            _text(server, "welcome")
            if wait:
                print(f"stand upright and look ahead; it begins in {wait:g} s")
                time.sleep(wait)
            server.send(write_message(Calibrate(arms_out)))
            until = time.monotonic() + _TIMEOUT
            while (notice := _text(server, "said", until)) is not None:
                print(notice["text"])
                if notice["text"].startswith(("you are", "calibration:", "to take")):
                    break
            else:
                raise BodysenseError(f"{watch}: nothing is tracked; wear the headset and run it again")
            if recentre:
                server.send(write_message(Recentre()))
    except InvalidStatus as error:
        body = error.response.body.decode(errors="replace").strip()
        reason = body.partition(";")[0] if body else f"status {error.response.status_code}"
        raise BodysenseError(
            f"{address}: the server refuses this address ({reason}); give the address that `bodysense serve` "
            "printed, token included"
        ) from None
    except (OSError, WebSocketException) as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise BodysenseError(f"{address}: {reason}; is `bodysense serve` running?") from None


def _parsed_address(address: str) -> SplitResult | None:
    """Return the parts of an http address; None for any other text."""
    try:
        parts = urlsplit(address)
        return parts if parts.scheme in ("http", "https") and parts.hostname and parts.port != 0 else None
    except ValueError:  # half an IPv6 address, or no port
        return None


def _text(server: Any, kind: str, until: float | None = None) -> dict[str, Any] | None:
    """Return the next text message of a type, or None if none comes in time. Raises BodysenseError for a refusal."""
    until = time.monotonic() + _TIMEOUT if until is None else until
    while (remaining := until - time.monotonic()) > 0:
        try:
            received = server.recv(timeout=remaining)
        except TimeoutError:
            return None
        if isinstance(received, str):
            message = json.loads(received)
            if message["type"] == "error":
                raise BodysenseError(message["reason"])
            if message["type"] == kind:
                return message
    return None
