"""Links to other programs, which receive bodies and may send signals, and the sockets that the server listens on."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import math
import socket
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, Protocol

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import HAS_POSITION, HAS_ROTATION, SignalFrame, wire_accuracy
from bodysense.observing.observation import Observation
from bodysense_live.security.safety import RateLimit
from bodysense_live.server.live import Live
from bodysense_live.server.messages import Calibrate, Recentre, Source
from bodysense_live.server.metrics import Metrics
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.signal_clock import SHORTEST_STEP
from bodysense_live.sessions.tracked_devices import DeviceReader

GROUP_TIME = 0.002  # s; packets within this time share a frame
MAX_PACKETS = 2000.0  # accepted packets per second; twice as many in a burst
LOST = 0.5  # s without a body until trackers are reported as lost


Command = Calibrate | Recentre


class Link(Protocol):
    """A link to another program. The constructor binds its sockets, so that errors occur before the server starts."""

    async def open(self, live: Live) -> None:
        """Start, in the running event loop."""
        ...

    def send_body(self, answer: Answer) -> None:
        """Send a body, without waiting or raising."""
        ...

    def close(self) -> None:
        """Disconnect and close the sockets."""
        ...


class DeviceInput(asyncio.DatagramProtocol):
    """A protocol that converts packets to signal frames. Packets within `group_time` s share a frame.

    Args:
        receive_frame: called with each frame.
        metrics: counters.
        reader: decoder of the packets.
        points: names of the signal's points.
        apply_command: called with each command in a packet.
        sender: the only accepted address, or None for any.
        group_time: s.
    """

    def __init__(
        self,
        receive_frame: Callable[[SignalFrame], None],
        metrics: Metrics,
        reader: DeviceReader,
        points: tuple[str, ...],
        apply_command: Callable[[Command], None] = lambda command: None,
        sender: str | None = None,
        group_time: float = GROUP_TIME,
    ) -> None:
        self._receive_frame, self._metrics, self._reader, self._points = receive_frame, metrics, reader, points
        self._apply_command, self._sender, self._group_time = apply_command, sender, group_time
        self.state: Any = reader.start()
        self._flush_timer: asyncio.TimerHandle | None = None  # runs while a frame waits for further packets
        self._sequence = 0
        self._frame_time = -math.inf  # s, of the last frame
        self._rate = RateLimit(MAX_PACKETS, 0.0)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Decode one packet."""
        if self._sender is not None and addr[0] != self._sender:
            self._metrics.dropped("second sender")
            return
        loop = asyncio.get_running_loop()
        now = loop.time()
        if not self._rate.allows(now):
            self._metrics.dropped("flood")
            return
        self.state, reason = self._reader.take(data, now, self.state)
        if reason is not None:
            self._metrics.dropped("malformed packet")
        for command in self._reader.commands(data):
            self._apply_command(command)
        if self._reader.is_whole(now, self.state):
            self._flush()
        elif self._flush_timer is None:
            self._flush_timer = loop.call_later(self._group_time, self._flush)

    def serials(self) -> Mapping[str, str]:
        """Return the signal's names of unassigned trackers, by serial."""
        return self._reader.serials(self.state)

    def _flush(self) -> None:
        if self._flush_timer is not None:
            self._flush_timer.cancel()
            self._flush_timer = None
        now = asyncio.get_running_loop().time()
        observation = self._reader.observation(now, self.state)
        if observation is not None:
            # All packets of one turn of the event loop have its time; the newest must not seem to be late.
            self._frame_time = max(now, self._frame_time + 2 * SHORTEST_STEP)
            self._sequence = (self._sequence + 1) % 2**32
            self._receive_frame(signal_of(observation, self._points, self._sequence, self._frame_time))


class UdpPort:
    """A bound UDP socket. It sends and receives packets once it is open."""

    def __init__(self, option: str, host: str, port: int) -> None:
        self._socket = listen_udp(option, host, port)
        self.number: int = self._socket.getsockname()[1]
        self._transport: asyncio.DatagramTransport | None = None

    async def open(self, protocol: asyncio.DatagramProtocol) -> None:
        """Start to pass received packets to a protocol."""
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: protocol, sock=self._socket)

    async def add_input(self, live: Live, source: Source, points: tuple[str, ...], protocol: Callable[..., Any]) -> Any:
        """Add a session that the port drives, open the port, and return its protocol, made by `protocol`."""
        slot = live.add_input(source, points)
        opened = protocol(receive_frame=partial(live.receive, slot), apply_command=partial(live.apply, slot))
        await self.open(opened)
        if isinstance(opened, DeviceInput):
            slot.serials = opened.serials
        return opened

    def send(self, packets: Iterable[bytes], address: Any) -> None:
        """Send packets; drop those that the network does not accept."""
        if self._transport is None or self._transport.is_closing():
            return
        for packet in packets:
            with contextlib.suppress(OSError):  # no receiver; the next packet follows soon
                self._transport.sendto(packet, address)

    def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()
        else:
            self._socket.close()


def signal_of(observation: Observation, points: tuple[str, ...], sequence: int, time: float) -> SignalFrame:
    """Return the first frame of an observation as a signal of `points`; other points are dropped."""
    here = [k for k, name in enumerate(observation.points) if name in points]
    has = HAS_POSITION * observation.has_position[0, here] + HAS_ROTATION * observation.has_rotation[0, here]
    return SignalFrame(
        sequence,
        time,
        np.array([points.index(observation.points[k]) for k in here], dtype=np.uint8),
        has.astype(np.uint8),
        np.nan_to_num(observation.position[0, here]).astype(np.float32),
        np.nan_to_num(observation.rotation[0, here]).astype(np.float32),
        wire_accuracy(observation.accuracy[0, here]),
    )


def listen_tcp(option: str, host: str, port: int) -> socket.socket:
    """Return a listening TCP socket. Raises BodysenseError, naming the option, if it cannot be bound."""
    sock = _bind(option, host, port, socket.SOCK_STREAM)
    try:
        sock.listen(128)
    except OSError as error:
        sock.close()
        raise BodysenseError(_bind_error(error, option, host, port)) from None
    return sock


def listen_udp(option: str, host: str, port: int) -> socket.socket:
    """Return a bound UDP socket. Raises BodysenseError, naming the option, if it cannot be bound."""
    sock = _bind(option, host, port, socket.SOCK_DGRAM)
    sock.setblocking(False)
    return sock


def _bind(option: str, host: str, port: int, kind: socket.SocketKind) -> socket.socket:
    if not 0 <= port <= 65535:
        raise BodysenseError(f"{option} {port}: ports are 0 (any that is free) to 65535")
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=kind)[0]
        sock = socket.socket(family, kind)
    except OSError:
        option = option.replace("port", "host")
        raise BodysenseError(f"{option} {host}: no such host; give an address of this machine") from None
    try:
        if kind == socket.SOCK_STREAM:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind(address)
    except OSError as error:
        sock.close()
        raise BodysenseError(_bind_error(error, option, host, port)) from None
    return sock


def _bind_error(error: OSError, option: str, host: str, port: int) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"{option} {port} is in use by another program; stop it or choose another {option} (0 takes any)"
    if error.errno == errno.EACCES:
        return f"{option} {port}: no permission to listen there; choose a {option} of 1024 or more"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{option.replace('port', 'host')} {host}: no address of this machine; give one, or 0.0.0.0 for all"
    return f"{option} {port}: {host} cannot be listened on ({error.strerror}); choose another {option}"


def host_address(option: str, host: str, program: str) -> str:
    """Return the address of a program's machine. Raises BodysenseError, naming the option, for unknown hosts."""
    try:
        return socket.gethostbyname(host)
    except OSError:
        raise BodysenseError(f"{option} {host}: no such host; give the machine of {program}") from None


def address_toward(host: str) -> str:
    """Return this machine's address in the network of a host."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((host, 9))  # nothing is sent
        except OSError:
            return "127.0.0.1"
        return probe.getsockname()[0]
