"""`bodysense calibrate`: a calibration second for whoever a running server tracks."""

from __future__ import annotations

import json
import time
from typing import Annotated, Any, Literal
from urllib.parse import parse_qs, urlsplit

import tyro

from bodysense.errors import BodysenseError

_TO_ANSWER = 5.0  # s


def calibrate(
    address: Annotated[str, tyro.conf.Positional] = "http://127.0.0.1:8765/",
    watch: Literal["vmc", "vmt", "vrchat", "slimevr", "solarxr"] = "vmc",
    arms_out: bool = False,
    recentre: bool = False,
    wait: float = 5.0,
) -> None:
    """Calibrate whoever a running server tracks by VMC, SteamVR, VRChat or SlimeVR in a standing second.

    Args:
        address: what `bodysense serve` printed, token included.
        watch: which of the server's inputs.
        arms_out: stand with the arms out to the sides; their reach is measured, too.
        recentre: where the wearer stands afterwards, and faces, becomes the middle.
        wait: seconds until the second begins.
    """
    from websockets import WebSocketException
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    from bodysense.io.protocol import SUBPROTOCOL
    from bodysense_live.message_text import write_message
    from bodysense_live.messages import Calibrate, Hello, Recentre

    if not 0 <= wait <= 600:
        raise BodysenseError(f"--wait {wait:g}: give 0 to 600 seconds")
    place = urlsplit(address)
    if place.scheme not in ("http", "https") or not place.hostname:
        raise BodysenseError(f"{address}: give the address that `bodysense serve` printed, as http://127.0.0.1:8765/")
    tokens = [f"token.{token}" for token in parse_qs(place.query).get("token", [])]
    scheme = "wss" if place.scheme == "https" else "ws"
    protocols = [Subprotocol(name) for name in (SUBPROTOCOL, *tokens)]
    try:
        with connect(f"{scheme}://{place.netloc}/ws", subprotocols=protocols, compression=None) as server:
            server.send(write_message(Hello(1, watch=watch)))
            _text(server, "welcome")
            if wait:
                print(f"stand upright and look ahead; it begins in {wait:g} s")
                time.sleep(wait)
            server.send(write_message(Calibrate(arms_out)))
            until = time.monotonic() + _TO_ANSWER
            while (said := _text(server, "said", until)) is not None:
                print(said["text"])
                if said["text"].startswith(("you are", "calibration:", "to take")):
                    break
            else:
                raise BodysenseError(f"{watch}: nothing is tracked; wear the headset and run it again")
            if recentre:
                server.send(write_message(Recentre()))
    except (OSError, WebSocketException) as error:
        raise BodysenseError(
            f"{address}: {str(error) or type(error).__name__}; is `bodysense serve` running?"
        ) from None


def _text(server: Any, kind: str, until: float | None = None) -> dict[str, Any] | None:
    """The next text message of a type; None where none comes in time. Raises BodysenseError for a refusal."""
    until = time.monotonic() + _TO_ANSWER if until is None else until
    while (left := until - time.monotonic()) > 0:
        try:
            received = server.recv(timeout=left)
        except TimeoutError:
            return None
        if isinstance(received, str):
            message = json.loads(received)
            if message["type"] == "error":
                raise BodysenseError(message["reason"])
            if message["type"] == kind:
                return message
    return None
