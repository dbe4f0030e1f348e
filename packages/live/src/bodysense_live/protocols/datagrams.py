"""UDP inputs and outputs: trackers by VMC, markers by OSC; poses to avatars by VMC and to VRChat."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from bodysense.body.hands.glove_set import GloveSet
from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import SignalFrame
from bodysense.io.markers.raw_markers import MarkerFormat
from bodysense_live.protocols.links import MAX_PACKETS, Command, UdpPort, signal_of
from bodysense_live.protocols.marker_stream import read_frame
from bodysense_live.protocols.vmc import vmc_packets
from bodysense_live.protocols.vrchat import ADVISED, vrchat_packets
from bodysense_live.security.safety import RateLimit
from bodysense_live.server.live import Live
from bodysense_live.server.messages import Source
from bodysense_live.server.metrics import Metrics
from bodysense_live.sessions.answer import Answer


def marker_points(glove_set: GloveSet) -> tuple[str, ...]:
    """Return the points of both hands in gloves of a marker set."""
    return tuple(f"{side}_glove_{name}" for side in ("left", "right") for name in glove_set.names)


@dataclass(frozen=True)
class Receiver:
    """An address that poses are sent to."""

    protocol: Literal["vmc", "vrchat"]
    host: str
    port: int
    parts: tuple[str, ...] = ADVISED  # parts of the body whose trackers are sent to VRChat


class PoseSender:
    """A sender of poses as datagrams; drops those not sent at once. Raises BodysenseError for unknown hosts."""

    def __init__(self, receivers: Sequence[Receiver], metrics: Metrics) -> None:
        self._metrics = metrics
        self._begun: float | None = None  # s, moment of the first pose
        self._out: list[tuple[Receiver, socket.socket]] = []
        for receiver in receivers:
            option = f"--{receiver.protocol}-out {receiver.host}:{receiver.port}"
            try:
                found = socket.getaddrinfo(receiver.host, receiver.port, type=socket.SOCK_DGRAM)[0]
                out = socket.socket(*found[:2])
                self._out.append((receiver, out))
                out.setblocking(False)
                out.connect(found[4])
            except OSError as error:
                self.close()
                raise BodysenseError(f"{option}: {error.strerror or error}; give HOST:PORT of the avatar") from None

    async def open(self, live: Live) -> None:
        """Do nothing: the sockets are open."""

    def send_body(self, answer: Answer) -> None:
        """Send one pose. VMC's time starts at the first pose, because single precision cannot hold Unix time."""
        if self._begun is None:
            self._begun = answer.moment
        for receiver, out in self._out:
            packets = (
                vmc_packets(answer.pose, answer.moment - self._begun)
                if receiver.protocol == "vmc"
                else vrchat_packets(answer.pose, (answer.points, answer.turns), receiver.parts)
            )
            for packet in packets:
                try:
                    out.send(packet)
                except OSError:  # no receiver, or a full network; the next pose follows soon
                    self._metrics.dropped("output")

    def close(self) -> None:
        """Close the sockets."""
        for _, out in self._out:
            out.close()


class MarkerInput(asyncio.DatagramProtocol):
    """The input of gloves' markers by OSC: one signal frame per packet, at the sender's time."""

    def __init__(
        self,
        receive_frame: Callable[[SignalFrame], None],
        metrics: Metrics,
        glove_set: GloveSet,
        apply_command: Callable[[Command], None] = lambda command: None,
    ) -> None:
        self._receive_frame, self._metrics = receive_frame, metrics
        self._points = marker_points(glove_set)
        labels = [label for marker in glove_set.markers for label in marker.labels.values()]
        self._form = MarkerFormat(glove_set.points(labels))
        self._sequence = 0
        self._rate = RateLimit(MAX_PACKETS, 0.0)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one packet."""
        if not self._rate.allows(asyncio.get_running_loop().time()):
            self._metrics.dropped("flood")
            return
        observation = read_frame(data, self._points, self._form)
        if observation is None:
            self._metrics.dropped("malformed packet")
            return
        self._sequence = (self._sequence + 1) % 2**32
        self._receive_frame(signal_of(observation, self._points, self._sequence, float(observation.time[0])))


class InputLink:
    """A UDP port whose packets drive a session of the server's own."""

    def __init__(
        self,
        source: Source,
        port: UdpPort,
        points: tuple[str, ...],
        protocol: Callable[..., asyncio.DatagramProtocol],  # made with `receive_frame` and `apply_command`
    ) -> None:
        self._source: Source = source
        self._port, self._points, self._protocol = port, points, protocol

    async def open(self, live: Live) -> None:
        """Start to listen."""
        await self._port.add_input(live, self._source, self._points, self._protocol)

    def send_body(self, answer: Answer) -> None:
        """Do nothing: the sender takes no bodies."""

    def close(self) -> None:
        """Stop listening."""
        self._port.close()
