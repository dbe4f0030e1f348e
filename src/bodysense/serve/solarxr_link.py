"""The link to OpenXR runtimes on Linux (Monado, WiVRn): they find SlimeVR's sockets here, give a headset, take a body.

SlimeVR's own programs hear the same by a WebSocket.

A runtime connects once, when it starts: the server has to be up before. It tells of its headset after every update that
it gets, so updates go on while nobody is tracked.

Headset and controllers that an OpenXR runtime tells SlimeVR's server of: protobuf messages, read by hand.

Source: SlimeVR's driver protocol (`ProtobufMessages.proto`) and its sender in Monado. A controller comes as the pose by
which it points, not as it is held, so of controllers the place alone is taken.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import struct
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.serve.answer import Answer
from bodysense.serve.links import LOST, MOST_PACKETS, Reader, listen_tcp, signal_of
from bodysense.serve.live import Live
from bodysense.serve.metrics import Metrics
from bodysense.serve.protocol import SignalFrame
from bodysense.serve.safety import RateLimit, why_not_local
from bodysense.serve.solarxr import Updates, moved, read_bundle, settings_bundle, told_of
from bodysense.serve.tracked_devices import Device, DeviceReader, DeviceState, pose_of
from bodysense.serve.unity import from_driver_rotation
from bodysense.serve.webxr import between_eyes

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response


LARGEST = 1024  # bytes of a message
_POSITION, _ADDED, _STATUS = 1, 3, 4  # fields of a message: what it is of
_ROLES = {19: ("Hmd", "HMD"), 13: ("Con", "left controller"), 14: ("Con", "right controller")}
_MOST_ADDED = 64
_TRACKED = 1
Value = int | float | bytes


@dataclass(frozen=True, eq=False)
class InputState:
    """What came in until now."""

    roles: Mapping[int, int] = field(default_factory=dict)  # by id
    lost: frozenset[int] = frozenset()  # ids that are not tracked now
    devices: DeviceState = DeviceState()


@dataclass(frozen=True)
class InputReader(DeviceReader):
    """How messages are read."""

    def start(self) -> InputState:
        """Nothing came yet."""
        return InputState()

    def take(self, packet: bytes, now: float, state: InputState) -> tuple[InputState, str | None]:
        """Take in a message that came at `now` s; the reason, too, where it is of no use."""
        try:
            for number, value in fields_of(packet).items():
                if not isinstance(value, bytes):
                    continue
                told = fields_of(value)
                identity = _whole(told.get(1))
                if number == _ADDED and len(state.roles) < _MOST_ADDED:
                    state = replace(state, roles={**state.roles, identity: _whole(told.get(4))})
                elif number == _STATUS:
                    is_lost = _whole(told.get(2)) != _TRACKED
                    state = replace(state, lost=state.lost | {identity} if is_lost else state.lost - {identity})
                elif number == _POSITION:
                    return self._placed(told, identity, now, state)
        except ValueError as error:
            return state, str(error)
        return state, None

    def _placed(
        self, told: Mapping[int, Value], identity: int, now: float, state: InputState
    ) -> tuple[InputState, str | None]:
        role = _ROLES.get(state.roles.get(identity, 0))
        if role is None or identity in state.lost or not {2, 3, 4} <= told.keys():
            return state, None
        numbers = [told.get(k, 0.0) for k in range(2, 9)]
        if not all(isinstance(value, float) for value in numbers):
            return state, "a position is not of floats"
        pose = pose_of(numbers, "a position")
        if isinstance(pose, str):
            return state, pose
        (place, turn), (kind, serial) = pose, role
        rotation = None if turn is None or kind != "Hmd" else from_driver_rotation(turn)
        devices, reason = self.devices.put([(serial, Device(kind, place, rotation, now, raw=True))], state.devices)
        return replace(state, devices=devices), reason


def fields_of(data: bytes) -> dict[int, Value]:
    """The fields of a protobuf message by number, the last of each. Raises ValueError for what is none."""
    found: dict[int, Value] = {}
    place = 0
    while place < len(data):
        key, place = _varint(data, place)
        number, kind = key >> 3, key & 7
        if kind == 0:
            found[number], place = _varint(data, place)
        elif kind in (1, 5):
            size, form = (8, "<d") if kind == 1 else (4, "<f")
            if place + size > len(data):
                raise ValueError("a number is cut off")
            found[number] = float(struct.unpack_from(form, data, place)[0])
            place += size
        elif kind == 2:
            size, place = _varint(data, place)
            if place + size > len(data):
                raise ValueError("a field is cut off")
            found[number] = data[place : place + size]
            place += size
        else:
            raise ValueError(f"a field of kind {kind} is not read here")
    return found


def _varint(data: bytes, place: int) -> tuple[int, int]:
    """A number and the place behind it."""
    value = 0
    for k, byte in enumerate(data[place : place + 10]):
        value |= (byte & 127) << 7 * k
        if byte < 128:
            return value, place + k + 1
    raise ValueError("a number is cut off")


def _whole(value: Value | None) -> int:
    return value if isinstance(value, int) else 0


RPC, INPUT = "SlimeVRRpc", "SlimeVRInput"
PORT = 21110  # of SlimeVR's WebSocket
FASTEST = 1 / 120  # s between updates, and so between poses of a headset
_SLOWEST = 1 / 45  # s
_GROWN = 0.01  # m by which a bone must have changed to be told anew: a runtime then makes its skeleton anew
_LARGEST_REQUEST = 1 << 16  # bytes
_MOST_BEHIND = 1 << 16  # bytes that a runtime has not read, after which updates are left out for it
_MOST_CLIENTS = 8
_SIZE = struct.Struct("<I")  # counts itself
_QUIET = logging.getLogger("bodysense.solarxr")
_QUIET.setLevel(logging.CRITICAL)  # who is no client is no news


@dataclass(frozen=True)
class SolarxrSettings:
    """Where the doors are: the folder in which runtimes look, and the TCP port of the WebSocket, on this machine."""

    folder: Path
    port: int = PORT


def runtime_folder(environment: Mapping[str, str]) -> Path:
    """The folder in which runtimes look for sockets. Raises BodysenseError where the system has none."""
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
    write: Callable[[bytes], None]  # one message
    interval: float | None = None  # s between updates; None: none were asked for
    sent: float = field(default=-np.inf)  # s, when
    later: asyncio.TimerHandle | None = None  # an update that waits until it is due


class SolarxrLink:
    """A link (`links.Link`). Raises BodysenseError where its sockets cannot be had."""

    def __init__(self, settings: SolarxrSettings, metrics: Metrics, reader: Reader, points: tuple[str, ...]) -> None:
        self._metrics, self._reader, self._points = metrics, reader, points
        self._clients: list[_Client] = []
        self._servers: list[Any] = []
        self._beating: asyncio.Task[None] | None = None
        self._eyes = between_eyes(default_skeleton())
        self._updates = Updates(told_of(default_skeleton(), self._eyes))
        self._update = self._updates.nobody
        self._measured: Skeleton = default_skeleton()
        self._shown = -np.inf  # s, when a body was last shown
        self._paths = [settings.folder / name for name in (RPC, INPUT)]
        self._bound: list[socket.socket] = []
        try:
            for path in self._paths:
                self._bound.append(_listened(path))
            self._bound.append(listen_tcp("--solarxr-port", "127.0.0.1", settings.port))
        except BaseException:
            self.close()
            raise

    async def open(self, live: Live) -> None:
        """Begin to serve."""
        seat, loop = live.own("solarxr", self._points), asyncio.get_running_loop()
        self._play: Callable[[SignalFrame], None] = partial(live.receive, seat)
        from websockets.asyncio.server import serve

        rpc, told, door = self._bound
        self._servers.append(await asyncio.start_unix_server(self._rpc, sock=rpc))
        self._servers.append(await asyncio.start_unix_server(self._input, sock=told))
        self._servers.append(
            await serve(
                self._websocket,
                sock=door,
                process_request=_refused,
                max_size=_LARGEST_REQUEST,
                compression=None,
                server_header=None,
                logger=_QUIET,
            )
        )
        self._beating = loop.create_task(self._beat())

    def show(self, answer: Answer) -> None:
        """Give a body to whoever asked for updates."""
        skeleton = answer.pose.skeleton
        self._measure(skeleton)
        self._shown = asyncio.get_running_loop().time()
        if any(client.interval is not None for client in self._clients):
            self._update = self._updates.of(moved(*answer.in_signal, self._eyes))
            for client in self._clients:
                self._offer(client)

    def close(self) -> None:
        """Serve no more, and leave no sockets behind."""
        if self._beating is not None:
            self._beating.cancel()
        for server in self._servers:
            server.close()
        for client in self._clients:
            client.transport.close()
        for bound in self._bound:
            bound.close()
        for _, path in zip(self._bound, self._paths, strict=False):
            path.unlink(missing_ok=True)

    def _measure(self, skeleton: Skeleton) -> None:
        """Take bones' lengths over, where they changed noticeably."""
        if skeleton is self._measured:
            return
        self._measured, eyes = skeleton, between_eyes(skeleton)
        told = told_of(skeleton, eyes)
        both = zip(told.bones, self._updates.told.bones, strict=True)
        if max(abs(now - before) for (_, now), (_, before) in both) > _GROWN:
            self._updates, self._eyes = Updates(told), eyes

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
        """Answer a client until it is gone."""
        if len(self._clients) >= _MOST_CLIENTS:
            return
        self._clients.append(client)
        try:
            async for packet in packets:
                self._answer(client, packet)
        finally:
            self._clients.remove(client)

    def _answer(self, client: _Client, packet: bytes) -> None:
        asked = read_bundle(packet)
        if isinstance(asked, str):
            self._metrics.dropped("malformed packet")
            return
        if asked.interval is not None:
            client.interval = max(asked.interval, FASTEST)
        if asked.polls:  # the first thing that a runtime hears must be an update, alone
            self._send(client, self._update)
        for transaction in asked.settings:
            self._send(client, settings_bundle(transaction))

    async def _input(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        loop, state, sequence = asyncio.get_running_loop(), self._reader.start(), 0
        rate, waits = RateLimit(MOST_PACKETS, loop.time()), False

        def flush() -> None:
            nonlocal sequence, waits
            waits, now = False, loop.time()
            observation = self._reader.observation(now, state)
            if observation is not None:
                sequence = (sequence + 1) % 2**32
                self._play(signal_of(observation, self._points, sequence, now))

        try:
            async for packet in _packets(reader, LARGEST):
                if not rate.allows(loop.time()):
                    self._metrics.dropped("flood")
                    continue
                state, reason = self._reader.take(packet, loop.time(), state)
                if reason is not None:
                    self._metrics.dropped("malformed packet")
                if not waits:
                    waits = True
                    loop.call_soon(flush)
        finally:
            writer.close()

    async def _beat(self) -> None:
        """Updates while no body comes."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(_SLOWEST)
            if loop.time() - self._shown > LOST:
                self._update = self._updates.nobody
            for client in self._clients:
                if loop.time() - client.sent >= _SLOWEST:
                    self._offer(client)

    def _offer(self, client: _Client) -> None:
        """Send the update as soon as it is due."""
        if client.interval is None or client.later is not None:
            return
        loop = asyncio.get_running_loop()
        if loop.time() >= client.sent + client.interval:
            self._due(client)
        else:
            client.later = loop.call_at(client.sent + client.interval, self._due, client)

    def _due(self, client: _Client) -> None:
        client.later, client.sent = None, asyncio.get_running_loop().time()
        self._send(client, self._update)

    def _send(self, client: _Client, packet: bytes) -> None:
        if client.transport.is_closing():
            return
        if client.transport.get_write_buffer_size() > _MOST_BEHIND:
            self._metrics.dropped("slow client")
            return
        client.write(packet)


async def _packets(reader: asyncio.StreamReader, largest: int) -> AsyncIterator[bytes]:
    """Messages of a stream until its end, or until one is too large to be any."""
    with contextlib.suppress(asyncio.IncompleteReadError, OSError):
        while True:
            size = _SIZE.unpack(await reader.readexactly(_SIZE.size))[0] - _SIZE.size
            if not 0 <= size <= largest:
                return
            yield await reader.readexactly(size)


async def _binary(connection: ServerConnection) -> AsyncIterator[bytes]:
    """Messages of a WebSocket until its end; texts, an older protocol of SlimeVR's, are left out."""
    from websockets.exceptions import ConnectionClosed

    with contextlib.suppress(ConnectionClosed):
        async for message in connection:
            if isinstance(message, bytes):
                yield message


def _refused(connection: ServerConnection, request: Request) -> Response | None:
    """Why a WebSocket is not opened; None where it is."""
    reason = why_not_local(request.headers.get("Host"), request.headers.get("Origin"))
    return None if reason is None else connection.respond(403, f"{reason}\n")


def _listened(path: Path) -> socket.socket:
    """A socket at a path; one that nobody listens to is replaced. Raises BodysenseError where there is none to have."""
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
