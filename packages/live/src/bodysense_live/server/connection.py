"""One WebSocket: a hello, then signals in and poses out until either side closes it."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any

from bodysense.io.formats.protocol import ProtocolError
from bodysense_live.security.safety import RateLimit
from bodysense_live.server.live import Live
from bodysense_live.server.message_text import read_message, write_message
from bodysense_live.server.messages import ErrorMessage, Hello, Ping, Pong
from bodysense_live.server.send_queue import SendQueue
from bodysense_live.server.session_slot import SessionSlot
from bodysense_live.sessions.newest_frames import SKIPPED

if TYPE_CHECKING:
    from starlette.websockets import WebSocket

_TO_CLOSE = 2.0  # s for a client to read the reason of a refusal
_LONGEST_REASON = 120  # bytes of a closing frame (RFC 6455, section 5.5)


async def serve_client(socket: WebSocket, live: Live) -> None:
    """Serve an accepted WebSocket until it closes. An error of the client closes it, with a reason."""
    queue, slot, sender = SendQueue(live.limits.waiting_messages), None, None
    try:
        hello = await _hello(socket, live)
        if hello is None:
            return
        slot = await live.admit(hello, queue, socket.client.host if socket.client else "")
        sender = asyncio.create_task(_send(socket, queue))
        await _listen(socket, live, slot, queue, sender)
    except ProtocolError as error:
        if sender is not None:
            sender.cancel()
        live.metrics.closed(error.code)
        await _close(socket, error)
    finally:
        if sender is not None:
            sender.cancel()
        if slot is not None:
            live.disconnect(slot, queue)


async def _hello(socket: WebSocket, live: Live) -> Hello | None:
    """Return the first message; None if the client left without one."""
    seconds = live.limits.seconds_to_hello
    try:
        async with asyncio.timeout(seconds):
            received = await socket.receive()
    except TimeoutError:
        raise ProtocolError(f"no hello within {seconds:g} s; send it first", 1008) from None
    if received["type"] == "websocket.disconnect":
        return None
    text = received.get("text")
    if text is None:
        raise ProtocolError("the first message is a hello, as text; see docs/protocol.md")
    _check_size(text, live)
    message = read_message(text)
    if not isinstance(message, Hello):
        raise ProtocolError("the first message is a hello; see docs/protocol.md")
    return message


async def _listen(
    socket: WebSocket, live: Live, slot: SessionSlot, queue: SendQueue, sender: asyncio.Task[None]
) -> None:
    clock = asyncio.get_running_loop().time
    rate = RateLimit(live.limits.messages_a_second, clock())
    while True:
        if not queue.is_watcher and slot.source is None:
            await live.wait_to_read(slot)
        received: Any = await socket.receive()
        if received["type"] == "websocket.disconnect" or sender.done():
            return
        skipped = received.get(SKIPPED, 0)
        if not rate.allows(clock(), 1 + skipped):
            most = live.limits.messages_a_second
            raise ProtocolError(
                f"more than {most:g} messages a second; send each frame once, at the display's rate", 1008
            )
        data = received.get("bytes")
        if data is not None:
            _check_size(data, live)
            if slot.source is not None or queue.is_watcher:
                raise ProtocolError("a client that watches sends no signal")
            live.receive(slot, data, skipped)
        else:
            _apply_command(received["text"], live, slot, queue)
        if queue.is_full:
            raise ProtocolError("the client does not read the server's messages; read them", 1008)


def _apply_command(text: str, live: Live, slot: SessionSlot, queue: SendQueue) -> None:
    _check_size(text, live)
    message = read_message(text)
    if isinstance(message, Ping):
        queue.put_message(Pong(message.time))
    elif isinstance(message, Hello):
        raise ProtocolError("a second hello; connect again to begin another session")
    elif queue.is_watcher:
        raise ProtocolError("a client that watches another's session cannot change it")
    else:
        live.apply(slot, message)


def _check_size(message: str | bytes, live: Live) -> None:
    if len(message) > live.limits.message_bytes:
        raise ProtocolError(f"a message of {len(message)} bytes; at most {live.limits.message_bytes}", 1009)


async def _send(socket: WebSocket, queue: SendQueue) -> None:
    """Send the queued messages until the client is gone or another connection replaced it."""
    from starlette.websockets import WebSocketDisconnect

    try:
        while True:
            texts, frames = await queue.take()
            for text in texts:
                await socket.send_text(text)
            for frame in frames:
                await socket.send_bytes(frame)
            if queue.closing is not None:
                await _close(socket, queue.closing)
                return
    except (WebSocketDisconnect, RuntimeError, OSError):  # the client is gone; `_listen` notices it, too
        return


async def _close(socket: WebSocket, error: ProtocolError) -> None:
    """Send the reason, and close."""
    reason = str(error).encode()[:_LONGEST_REASON].decode(errors="ignore")
    try:
        async with asyncio.timeout(_TO_CLOSE):
            await socket.send_text(write_message(ErrorMessage(str(error))))
            await socket.close(error.code, reason)
    except Exception:  # the client is gone already, or does not read
        return
