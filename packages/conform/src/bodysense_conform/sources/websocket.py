"""WebSocket of a server as a subject: the server's own input, watched (docs/protocol.md)."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError, missing_package
from bodysense.io.formats.protocol import POSE, SUBPROTOCOL, VERSION, PoseFrame, read_pose
from bodysense_conform.sources.files import pose_subject
from bodysense_conform.subject import Subject, Transport

_LARGEST = 1 << 20  # bytes of a message
_WAIT = 5.0  # s for the welcome


def record_websocket(url: str, seconds: float, watch: str | None) -> Subject:
    """Watch a server's input for some seconds. Raises BodysenseError if it gives none."""
    try:
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import ClientConnection, connect
        from websockets.typing import Subprotocol
    except ImportError as error:
        raise missing_package(error) from None
    messages: list[str | bytes] = []

    def connection(**more: str) -> ClientConnection:
        """Return a connection to the server, after its handshake."""
        link = connect(url, subprotocols=[Subprotocol(SUBPROTOCOL)], max_size=_LARGEST, open_timeout=_WAIT)
        link.send(json.dumps({"type": "hello", "version": VERSION, **more}))
        return link

    try:
        if watch is None:
            with connection() as link:
                sources = _object(link.recv(timeout=_WAIT)).get("sources") or []
                if not sources:
                    raise BodysenseError(
                        f"{url}: the server has no input of its own to watch; start it with --vmc-in or --replay"
                    )
                watch = str(sources[0])
        with connection(watch=watch) as link:
            end = time.monotonic() + seconds
            with suppress(TimeoutError):
                while (remaining := end - time.monotonic()) > 0:
                    messages.append(link.recv(timeout=remaining))
    except (OSError, WebSocketException, ValueError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split()) or type(error).__name__
        if not messages:
            raise BodysenseError(
                f"{url}: no server answers ({reason[:80]}); start it: bodysense serve --vmc-in 39539"
            ) from None
    return messages_subject(messages, url)


def messages_subject(messages: Sequence[str | bytes], name: str) -> Subject:
    """Return messages of the server as a subject. Raises BodysenseError if there is no welcome or no pose."""
    welcome: dict[str, Any] | None = None
    skeleton: Skeleton | None = None
    rows: list[tuple[PoseFrame, np.ndarray]] = []
    malformed = 0
    for message in messages:
        if isinstance(message, str):
            text = _object(message)
            if text.get("type") == "error":
                raise BodysenseError(f"{name}: the server says: {text.get('reason')}")
            if text.get("type") == "welcome":
                welcome, skeleton = text, _skeleton(name, text)
            if text.get("type") == "proportions" and skeleton is not None:
                skeleton = skeleton.with_offsets(np.array(text["rest_offset"], dtype=float))
        elif message[:1] == bytes([POSE]) and skeleton is not None:
            try:
                rows.append((read_pose(message, len(skeleton.points)), skeleton.rest_offset))
            except BodysenseError:
                malformed += 1
    if welcome is None or skeleton is None or not rows:
        raise BodysenseError(f"{name}: {len(messages)} messages and no pose; start a tracker first")
    frames = [frame for frame, _ in rows]
    pose = Pose(skeleton, np.stack([f.root_position for f in frames]), np.stack([f.rotation for f in frames]))
    moments, offsets = np.array([frame.time for frame in frames]), np.stack([offset for _, offset in rows])
    subject = pose_subject(name, "WebSocket", pose, moments, offsets)
    hidden = np.stack([frame.hidden for frame in frames])[:, skeleton.indices(subject.points)]
    steps = np.diff([frame.sequence for frame in frames])
    transport = Transport(len(rows) + malformed, malformed, int((steps[steps > 1] - 1).sum()))
    settings = welcome.get("settings") or {}
    return replace(subject, measured=hidden <= 0, transport=transport, floor=float(settings.get("floor", 0.0)))


def _skeleton(name: str, welcome: dict[str, Any]) -> Skeleton:
    try:
        joints = tuple(welcome["joints"])
        points = tuple(welcome["points"])
        offset = np.array(welcome["rest_offset"], dtype=float)
        return Skeleton(joints, points[len(joints) :], tuple(int(k) for k in welcome["parents"]), offset)
    except (KeyError, TypeError, ValueError) as error:
        raise BodysenseError(
            f"{name}: its welcome describes no body ({error!r:.60}); is this a bodysense server?"
        ) from None


def _object(message: str | bytes) -> dict[str, Any]:
    try:
        value = json.loads(message)
    except (ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}
