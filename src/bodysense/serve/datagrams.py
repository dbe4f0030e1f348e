"""UDP in and out: trackers by VMC, markers by OSC; poses to avatars by VMC and to VRChat."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from bodysense.body.glove_set import GloveSet
from bodysense.capture.marker_stream import read_frame
from bodysense.capture.raw_markers import MarkerFormat
from bodysense.errors import BodysenseError
from bodysense.observation import Observation
from bodysense.serve.metrics import Metrics
from bodysense.serve.protocol import HAS_POSITION, HAS_ROTATION, SignalFrame, wire_accuracy
from bodysense.serve.safety import RateLimit
from bodysense.serve.session import Answer
from bodysense.serve.vmc import vmc_packets
from bodysense.serve.vmc_trackers import SIGNALS as VMC_POINTS
from bodysense.serve.vmc_trackers import VmcTrackers
from bodysense.serve.vrchat import vrchat_packets


def marker_points(worn: GloveSet) -> tuple[str, ...]:
    """The points of both hands in gloves of a marker set."""
    return tuple(f"{side}_glove_{name}" for side in ("left", "right") for name in worn.names)


_TOGETHER = 0.002  # s: packets that come so soon after one another are one frame
_MOST = 2000.0  # packets a second that are looked at; twice as many in a burst


@dataclass(frozen=True)
class Receiver:
    """Where poses are sent."""

    protocol: Literal["vmc", "vrchat"]
    host: str
    port: int


class PoseSender:
    """Sends each pose as datagrams; what cannot be sent at once is dropped. Raises BodysenseError for unknown hosts."""

    def __init__(self, receivers: Sequence[Receiver], metrics: Metrics) -> None:
        self._metrics = metrics
        self._begun: float | None = None  # the moment of the first pose
        self._out: list[tuple[Literal["vmc", "vrchat"], socket.socket]] = []
        for receiver in receivers:
            option = f"--{receiver.protocol}-out {receiver.host}:{receiver.port}"
            try:
                found = socket.getaddrinfo(receiver.host, receiver.port, type=socket.SOCK_DGRAM)[0]
                out = socket.socket(*found[:2])
                self._out.append((receiver.protocol, out))
                out.setblocking(False)
                out.connect(found[4])
            except OSError as error:
                self.close()
                raise BodysenseError(f"{option}: {error.strerror or error}; give HOST:PORT of the avatar") from None

    def __call__(self, answer: Answer) -> None:
        """Send one pose; VMC's time is that since the first, because single precision does not hold Unix time."""
        if self._begun is None:
            self._begun = answer.moment
        for protocol, out in self._out:
            packets = (
                vmc_packets(answer.pose, answer.moment - self._begun)
                if protocol == "vmc"
                else vrchat_packets(answer.pose, answer.points)
            )
            for packet in packets:
                try:
                    out.send(packet)
                except OSError:  # nobody listens there now, or the network is full: the next pose is on its way
                    self._metrics.dropped("output")

    def close(self) -> None:
        """Send no more."""
        for _, out in self._out:
            out.close()


class TrackerInput(asyncio.DatagramProtocol):
    """Trackers by VMC become signal frames, each of what came within two milliseconds."""

    def __init__(self, play: Callable[[SignalFrame], None], metrics: Metrics, reader: VmcTrackers) -> None:
        self._play, self._metrics, self._reader = play, metrics, reader
        self._state: Any = self._reader.start()
        self._waits = False
        self._sequence = 0
        self._rate = RateLimit(_MOST, 0.0)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one packet."""
        loop = asyncio.get_running_loop()
        if not self._rate.allows(loop.time()):
            self._metrics.dropped("flood")
            return
        self._state, reason = self._reader.take(data, loop.time(), self._state)
        if reason is not None:
            self._metrics.dropped("malformed packet")
        if not self._waits:
            self._waits = True
            loop.call_later(_TOGETHER, self._flush)

    def _flush(self) -> None:
        self._waits = False
        now = asyncio.get_running_loop().time()
        observation = self._reader.observation(now, self._state)
        if observation is not None:
            self._sequence = (self._sequence + 1) % 2**32
            self._play(signal_of(observation, VMC_POINTS, self._sequence, now))


class MarkerInput(asyncio.DatagramProtocol):
    """Markers of gloves by OSC become signal frames, by the sender's own time."""

    def __init__(self, play: Callable[[SignalFrame], None], metrics: Metrics, worn: GloveSet) -> None:
        self._play, self._metrics = play, metrics
        self._points = marker_points(worn)
        labels = [label for marker in worn.markers for label in marker.labels.values()]
        self._form = MarkerFormat(worn.points(labels))
        self._sequence = 0
        self._rate = RateLimit(_MOST, 0.0)

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
        self._play(signal_of(observation, self._points, self._sequence, float(observation.time[0])))


def listened(option: str, host: str, port: int) -> socket.socket:
    """A UDP socket that is listened on. Raises BodysenseError, naming the option, where the port cannot be had."""
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        found = socket.socket(family, kind)
    except OSError as error:
        raise BodysenseError(f"{option} {port}: {host}: {error.strerror}; give an address of this machine") from None
    try:
        found.setblocking(False)
        found.bind(address)
    except (OSError, OverflowError) as error:
        found.close()
        reason = getattr(error, "strerror", None) or error
        raise BodysenseError(f"{option} {port}: UDP port {port} of {host}: {reason}; choose another port") from None
    return found


def signal_of(observation: Observation, points: tuple[str, ...], sequence: int, time: float) -> SignalFrame:
    """The first frame of an observation as a signal of `points`; others are left out."""
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
