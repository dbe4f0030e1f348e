"""The link to OpenXR runtimes on Linux (Monado, WiVRn): they connect to SlimeVR's sockets, send a headset, get a body.

SlimeVR's own programs get the same updates by a WebSocket. A client's first message tells its protocol: that of SlimeVR
22, whose drivers send their headset by the same connection, or the one before.

A runtime connects once, when it starts, so the server must run before. It sends its headset after each update that it
receives, so updates continue while no wearer is tracked.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import struct
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import SignalFrame
from bodysense_live.protocols.links import LOST, DeviceInput, listen_tcp
from bodysense_live.protocols.solarxr.driver_input import DriverReader
from bodysense_live.protocols.solarxr.driver_messages import BoneParts, SkeletonUpdates, is_hello
from bodysense_live.protocols.solarxr.runtime_messages import Updates, read_bundle, settings_bundle
from bodysense_live.protocols.solarxr.solarxr_body import BodyFrame, body_frame, body_layout
from bodysense_live.protocols.solarxr.solarxr_input import LARGEST
from bodysense_live.protocols.webxr import between_eyes
from bodysense_live.security.safety import local_refusal_reason
from bodysense_live.server.live import Live
from bodysense_live.server.metrics import Metrics
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.tracked_devices import DeviceReader

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response


RPC, INPUT = "SlimeVRRpc", "SlimeVRInput"
PORT = 21110  # TCP, SlimeVR's WebSocket
FASTEST = 1 / 120  # s, shortest interval between updates, and so between poses of a headset
_SLOWEST = 1 / 45  # s, longest interval between updates
_LENGTH_TOLERANCE = 0.01  # m; smaller changes of a bone are not sent, because a runtime rebuilds its skeleton for each
_LARGEST_REQUEST = 1 << 16  # bytes
_MAX_UNREAD_BYTES = 1 << 16  # bytes; a client with more unread bytes gets no updates
_MAX_CLIENTS = 8
_SIZE = struct.Struct("<I")  # size of a message, including these bytes
_QUIET_LOGGER = logging.getLogger("bodysense.solarxr")
_QUIET_LOGGER.setLevel(logging.CRITICAL)  # do not log connections that are not clients


@dataclass(frozen=True)
class SolarxrSettings:
    """The folder of the sockets that runtimes connect to, and the TCP port of the WebSocket."""

    folder: Path
    port: int = PORT


def runtime_folder(environment: Mapping[str, str]) -> Path:
    """Return the folder in which runtimes look for sockets. Raises BodysenseError if the system has none."""
    found = environment.get("XDG_RUNTIME_DIR") or environment.get("XDG_CACHE_HOME")
    if not hasattr(socket, "AF_UNIX") or not found:
        raise BodysenseError(
            "--solarxr: this system has no folder for sockets (XDG_RUNTIME_DIR is not set); "
            "start it in a session of Linux, or give SteamVR its trackers with --vmt"
        )
    return Path(found)


@dataclass(eq=False)
class _Client:
    transport: Any
    write: Callable[[bytes], None]  # sends one message
    interval: float | None = None  # s between updates; None: the client has not requested any
    mask: BoneParts | None = None  # parts of bones that a driver requests; None: the client is older
    driver: str = ""  # name of a registered driver
    sent: float = field(default=-np.inf)  # s, time of the last update
    later: asyncio.TimerHandle | None = None  # runs until the next update is due


class SolarxrLink:
    """The link to OpenXR runtimes (`links.Link`). Raises BodysenseError if a socket cannot be bound."""

    def __init__(
        self, settings: SolarxrSettings, metrics: Metrics, reader: DeviceReader, points: tuple[str, ...]
    ) -> None:
        self._metrics, self._reader, self._points = metrics, reader, points
        self._clients: list[_Client] = []
        self._servers: list[Any] = []
        self._heartbeat_task: asyncio.Task[None] | None = None
        self._eyes = between_eyes(default_skeleton())
        self._layout = body_layout(default_skeleton(), self._eyes)
        self._updates: dict[BoneParts | None, Updates | SkeletonUpdates] = {}  # by a driver's mask; None: older clients
        self._body: BodyFrame | None = None  # None: no wearer is tracked
        self._packets: dict[BoneParts | None, bytes] = {}  # updates of the body that have been built
        self._sent_skeleton: Skeleton = default_skeleton()
        self._last_body = -np.inf  # s, when a body was last sent
        self._paths = [settings.folder / name for name in (RPC, INPUT)]
        self._bound: list[socket.socket] = []
        try:
            for path in self._paths:
                self._bound.append(_listen_at(path))
            self._bound.append(listen_tcp("--solarxr-port", "127.0.0.1", settings.port))
        except BaseException:
            self.close()
            raise

    async def open(self, live: Live) -> None:
        """Start to serve."""
        slot = live.add_input("solarxr", self._points)
        self._receive_frame: Callable[[SignalFrame], None] = partial(live.receive, slot)
        from websockets.asyncio.server import serve

        rpc, inputs, web = self._bound
        self._servers.append(await asyncio.start_unix_server(self._rpc, sock=rpc))
        self._servers.append(await asyncio.start_unix_server(self._input, sock=inputs))
        self._servers.append(
            await serve(
                self._websocket,
                sock=web,
                process_request=_refuse,
                max_size=_LARGEST_REQUEST,
                compression=None,
                server_header=None,
                logger=_QUIET_LOGGER,
            )
        )
        self._heartbeat_task = live.supervisor.start(self._send_heartbeats())

    def send_body(self, answer: Answer) -> None:
        """Send a body to the clients that have requested updates."""
        skeleton = answer.pose.skeleton
        self._update_lengths(skeleton)
        self._last_body = asyncio.get_running_loop().time()
        if any(client.interval is not None for client in self._clients):
            self._replace_body(body_frame(*answer.in_signal, self._eyes))
            for client in self._clients:
                self._schedule_update(client)

    def close(self) -> None:
        """Stop serving, and remove the sockets."""
        if self._heartbeat_task is not None:
            self._heartbeat_task.cancel()
        for server in self._servers:
            server.close()
        for client in self._clients:
            client.transport.close()
        for bound in self._bound:
            bound.close()
        for _, path in zip(self._bound, self._paths, strict=False):
            path.unlink(missing_ok=True)

    def _update_lengths(self, skeleton: Skeleton) -> None:
        """Adopt the lengths of a skeleton's bones, if they changed noticeably."""
        if skeleton is self._sent_skeleton:
            return
        self._sent_skeleton, eyes = skeleton, between_eyes(skeleton)
        layout = body_layout(skeleton, eyes)
        both = zip(layout.bones, self._layout.bones, strict=True)
        if max(abs(now - before) for (_, now), (_, before) in both) > _LENGTH_TOLERANCE:
            self._layout, self._eyes = layout, eyes
            self._updates.clear()
            self._packets.clear()

    def _replace_body(self, body: BodyFrame | None) -> None:
        self._body = body
        self._packets.clear()

    def _update_for(self, client: _Client) -> bytes:
        """Return the newest update as the client requests it."""
        packet = self._packets.get(client.mask)
        if packet is None:
            updates = self._updates.get(client.mask)
            if updates is None:
                mask = client.mask
                updates = Updates(self._layout) if mask is None else SkeletonUpdates(self._layout, mask)
                self._updates[client.mask] = updates
            packet = updates.without_body if self._body is None else updates.packet(self._body)
            self._packets[client.mask] = packet
        return packet

    async def _rpc(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        def write(packet: bytes) -> None:
            writer.write(_SIZE.pack(_SIZE.size + len(packet)) + packet)

        try:
            await self._converse(_Client(writer.transport, write), _packets(reader, _LARGEST_REQUEST))
        finally:
            writer.close()

    async def _websocket(self, connection: ServerConnection) -> None:
        from websockets.asyncio.server import broadcast

        client = _Client(connection.transport, partial(broadcast, [connection]))
        await self._converse(client, _binary(connection))

    async def _converse(self, client: _Client, packets: AsyncIterator[bytes]) -> None:
        """Answer a client until it disconnects."""
        if len(self._clients) >= _MAX_CLIENTS:
            return
        self._clients.append(client)
        try:
            device_input: DeviceInput | None = None
            is_first = True
            async for packet in packets:
                if is_first and is_hello(packet):
                    device_input = self._driver_input(client)
                is_first = False
                if device_input is None:
                    self._answer(client, packet)
                elif not self._answer_driver(client, device_input, packet):
                    return
        finally:
            self._clients.remove(client)

    def _driver_input(self, client: _Client) -> DeviceInput:
        """Return the input of a client that speaks the protocol of SlimeVR 22."""

        def names() -> list[str]:
            return [other.driver for other in self._clients if other is not client]

        reader = DriverReader(self._reader.devices, self._reader.sensors, names)
        return DeviceInput(self._receive_frame, self._metrics, reader, self._points, group_time=0.0)

    def _answer_driver(self, client: _Client, device_input: DeviceInput, packet: bytes) -> bool:
        """Read and answer a packet of a driver. Return whether the connection continues."""
        before = device_input.state
        device_input.datagram_received(packet, None)
        state = device_input.state
        if state is before:  # too many packets
            return True
        for reply in state.replies:
            self._send(client, reply)
        client.driver, client.mask = state.name, state.mask
        client.interval = None if state.mask is None else FASTEST
        return not state.closes

    def _answer(self, client: _Client, packet: bytes) -> None:
        requests = read_bundle(packet)
        if isinstance(requests, str):
            self._metrics.dropped("malformed packet")
            return
        if requests.interval is not None:
            client.interval = max(requests.interval, FASTEST)
        if requests.polls:  # a runtime expects an update as its first message
            self._send(client, self._update_for(client))
        for transaction in requests.settings:
            self._send(client, settings_bundle(transaction))

    async def _input(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        device_input = DeviceInput(self._receive_frame, self._metrics, self._reader, self._points, group_time=0.0)
        try:
            async for packet in _packets(reader, LARGEST):
                device_input.datagram_received(packet, None)
        finally:
            writer.close()

    async def _send_heartbeats(self) -> None:
        """Send updates while there is no new body."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(_SLOWEST)
            if loop.time() - self._last_body > LOST:
                self._replace_body(None)
            for client in self._clients:
                if loop.time() - client.sent >= _SLOWEST:
                    self._schedule_update(client)

    def _schedule_update(self, client: _Client) -> None:
        """Send the update now, or when the client's interval has passed."""
        if client.interval is None or client.later is not None:
            return
        loop = asyncio.get_running_loop()
        if loop.time() >= client.sent + client.interval:
            self._send_update(client)
        else:
            client.later = loop.call_at(client.sent + client.interval, self._send_update, client)

    def _send_update(self, client: _Client) -> None:
        client.later, client.sent = None, asyncio.get_running_loop().time()
        if client.interval is None:  # a driver has withdrawn
            return
        self._send(client, self._update_for(client))

    def _send(self, client: _Client, packet: bytes) -> None:
        if client.transport.is_closing():
            return
        if client.transport.get_write_buffer_size() > _MAX_UNREAD_BYTES:
            self._metrics.dropped("slow client")
            return
        client.write(packet)


async def _packets(reader: asyncio.StreamReader, largest: int) -> AsyncIterator[bytes]:
    """Yield messages of a stream until its end, or until one is too large."""
    with contextlib.suppress(asyncio.IncompleteReadError, OSError):
        while True:
            size = _SIZE.unpack(await reader.readexactly(_SIZE.size))[0] - _SIZE.size
            if not 0 <= size <= largest:
                return
            yield await reader.readexactly(size)


async def _binary(connection: ServerConnection) -> AsyncIterator[bytes]:
    """Yield binary messages of a WebSocket until its end; texts belong to an older protocol of SlimeVR."""
    from websockets.exceptions import ConnectionClosed

    with contextlib.suppress(ConnectionClosed):
        async for message in connection:
            if isinstance(message, bytes):
                yield message


def _refuse(connection: ServerConnection, request: Request) -> Response | None:
    """Return a refusal of a WebSocket, or None if it is admitted."""
    reason = local_refusal_reason(request.headers.get("Host"), request.headers.get("Origin"))
    return None if reason is None else connection.respond(403, f"{reason}\n")


def _listen_at(path: Path) -> socket.socket:
    """Return a socket that listens at a path, and replace an abandoned one. Raises BodysenseError if that fails."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(os.fspath(path))
        except (FileNotFoundError, ConnectionRefusedError):
            pass
        except OSError as error:
            raise BodysenseError(f"--solarxr: {path}: {error.strerror or error}; give it a shorter folder") from None
        else:
            raise BodysenseError(f"--solarxr: {path} is in use: SlimeVR, or another bodysense, runs; stop it")
    found = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        path.unlink(missing_ok=True)
        found.bind(os.fspath(path))
        found.listen(8)
    except OSError as error:
        found.close()
        raise BodysenseError(
            f"--solarxr: {path}: {error.strerror or error}; set XDG_RUNTIME_DIR to a folder of yours"
        ) from None
    return found
