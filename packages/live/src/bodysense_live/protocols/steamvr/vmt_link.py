"""The link to SteamVR by VMT: requests devices, tracks them in a session, and sends virtual trackers and hands."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from functools import partial

from bodysense.errors import BodysenseError
from bodysense_live.protocols.links import LOST, DeviceInput, UdpPort, address_toward, host_address
from bodysense_live.protocols.steamvr.vmt import DRIVER_PORT, LAST_INDEX, off_messages, subscriptions, tracker_packet
from bodysense_live.protocols.steamvr.vmt_hands import hand_packet
from bodysense_live.protocols.virtual_trackers import TURNED_BY
from bodysense_live.server.live import Live
from bodysense_live.server.metrics import Metrics
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.tracked_devices import SIGNALS, DeviceReader, TrackedDevices

_REQUEST_INTERVAL = 1.0  # s; requests are repeated, because a restarted SteamVR has lost them
_SIDES = ("left", "right")


@dataclass(frozen=True)
class VmtSettings:
    """The address of VMT's driver and what is sent to it."""

    host: str = "127.0.0.1"
    driver_port: int = DRIVER_PORT
    port: int = 39575  # ours; VMT's own manager uses 39571
    first: int = 0  # index of the first virtual device
    hands: bool = False  # skeletal hands, as two virtual controllers
    devices: TrackedDevices = TrackedDevices()

    def __post_init__(self) -> None:
        most = LAST_INDEX + 1 - len(TURNED_BY) - len(_SIDES)
        if not 0 <= self.first <= most:
            raise BodysenseError(f"--vmt-first {self.first}: VMT has devices 0 to {LAST_INDEX}; give 0 to {most}")


class VmtLink:
    """The link to VMT's driver (`links.Link`)."""

    def __init__(
        self, settings: VmtSettings, metrics: Metrics, reader: DeviceReader, points: tuple[str, ...] = SIGNALS
    ) -> None:
        self._settings, self._metrics, self._reader, self._points = settings, metrics, reader, points
        address = host_address("--vmt-host", settings.host, "SteamVR")
        self._driver = (address, settings.driver_port)
        self._here = address_toward(address)
        self._port = UdpPort("--vmt-port", self._here, settings.port)
        self._input: DeviceInput | None = None
        self._request_task: asyncio.Task[None] | None = None
        self._active: set[int] = set()  # indices of virtual devices that are on
        self._last_body = 0.0  # s, when a body was last sent

    async def open(self, live: Live) -> None:
        """Start to listen, and to request devices."""
        device_input = partial(DeviceInput, metrics=self._metrics, reader=self._reader, points=self._points)
        self._input = await self._port.add_input(
            live, "vmt", self._points, partial(device_input, sender=self._driver[0])
        )
        self._request_task = live.supervisor.start(self._request_devices())

    def send_body(self, answer: Answer) -> None:
        """Send the virtual trackers of a body, and its hands if they are chosen."""
        places, turns = answer.in_signal
        first = self._settings.first
        packets = [tracker_packet(first, places, turns)]
        active = set(range(first, first + len(TURNED_BY)))
        if self._settings.hands:
            for k, side in enumerate(_SIDES, start=first + len(TURNED_BY)):
                packets.append(hand_packet(side, k, answer.pose.skeleton, places, turns))
                active.add(k)
        self._port.send(packets, self._driver)
        self._active, self._last_body = active, asyncio.get_running_loop().time()

    def close(self) -> None:
        """Switch the virtual devices off."""
        if self._request_task is not None:
            self._request_task.cancel()
        self._switch_off()
        self._port.close()

    async def _request_devices(self) -> None:
        loop, requested_at = asyncio.get_running_loop(), -_REQUEST_INTERVAL
        while True:
            now = loop.time()
            if now - requested_at >= _REQUEST_INTERVAL and self._input is not None:
                requested_at = now
                self._port.send(subscriptions(self._input.state, self._here, self._port.number), self._driver)
            if now - self._last_body > LOST:
                self._switch_off()
            await asyncio.sleep(LOST / 2)

    def _switch_off(self) -> None:
        self._port.send(off_messages(sorted(self._active)), self._driver)
        self._active = set()
