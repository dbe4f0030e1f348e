"""The link to SlimeVR's trackers. They find this machine in the network, and join the input that tracks a headset."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.observing.observation import Observation
from bodysense_live.protocols.links import Command, UdpPort, signal_of
from bodysense_live.protocols.slimevr import HEARTBEAT_EVERY, PORT, SlimevrState, heartbeat, take
from bodysense_live.security.safety import RateLimit
from bodysense_live.server.live import Live
from bodysense_live.server.metrics import Metrics
from bodysense_live.server.session_slot import SessionSlot
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.inertial import IMUS, JOINTS
from bodysense_live.sessions.tracked_devices import one_frame

SENSORS = tuple(IMUS)
LOST = 0.5  # s without a rotation, after which a sensor is lost
FRAME_RATE = 90.0  # frames per second, if no other input tracks the wearer
_MAX_PACKETS = 10_000.0  # per second: 32 trackers without bundles
_MAX_PRINTED = 64  # serials
_SERIAL = re.compile(r"((?:[0-9A-F]{2}:){5}[0-9A-F]{2})(?:/([0-9]{1,2}))?")


@dataclass(frozen=True)
class SlimevrSettings:
    """The address for trackers, and joints by serial: 'AA:BB:CC:DD:EE:FF', or '…/1' for a tracker's second sensor."""

    host: str = "0.0.0.0"
    port: int = PORT
    joints: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for serial, joint in self.joints.items():
            if joint not in JOINTS:
                raise BodysenseError(
                    f"devices: {joint!r} (for {serial!r}) is not a joint of a SlimeVR tracker; valid are "
                    f"{', '.join(JOINTS)}"
                )

    @property
    def known(self) -> frozenset[str]:
        """Serials of accepted trackers; empty: all."""
        return frozenset(serial.partition("/")[0] for serial in self.joints)


def is_serial(text: str) -> bool:
    """Return whether a name in a table is a SlimeVR tracker's serial."""
    return _SERIAL.fullmatch(text) is not None


class SlimevrLink(asyncio.DatagramProtocol):
    """The link to SlimeVR's trackers (`links.Link`). `alone`: no other input tracks the wearer; make frames here."""

    def __init__(self, settings: SlimevrSettings, metrics: Metrics, alone: bool) -> None:
        self._settings, self._metrics, self._alone = settings, metrics, alone
        self._port = UdpPort("--slimevr-port", settings.host, settings.port)
        self.state = SlimevrState()
        self._printed: set[str] = set()
        self._rate = RateLimit(_MAX_PACKETS, 0.0)
        self._tasks: list[asyncio.Task[None]] = []

    async def open(self, live: Live) -> None:
        """Start to listen."""
        self._apply_command: Callable[[Command], None] = live.apply_to_inputs
        slot = live.add_input("slimevr", SENSORS) if self._alone else None
        await self._port.open(self)
        self._tasks.append(live.supervisor.start(self._send_heartbeats()))
        if slot is not None:
            self._tasks.append(live.supervisor.start(self._play(live, slot)))

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Read one datagram and reply."""
        now = asyncio.get_running_loop().time()
        if not self._rate.allows(now):
            self._metrics.dropped("flood")
            return
        result = take(data, (addr[0], addr[1]), now, self.state, self._settings.known)
        self.state = result.state
        if result.reason is not None:
            self._metrics.dropped("malformed packet")
        self._port.send(result.replies, addr)
        if result.replies:
            self._print_serials()
        for command in result.commands:
            self._apply_command(command)

    def observation(self, now: float) -> Observation | None:
        """Return one frame of the sensors that are tracked now, or None. Points are named `{joint}_imu`."""
        found: dict[str, tuple[float, np.ndarray]] = {}
        for serial, number, sensor in self._sensors():
            joint = self._joint(serial, number) or sensor.joint
            if joint is None or not sensor.works or sensor.rotation is None or now - sensor.at > LOST:
                continue
            name = f"{joint}_imu"
            if name not in found or sensor.at > found[name][0]:
                found[name] = sensor.at, sensor.rotation
        if not found:
            return None
        nowhere, turned = np.full((len(found), 3), np.nan), np.stack([rotation for _, rotation in found.values()])
        return one_frame(tuple(found), nowhere, turned, max(at for at, _ in found.values()))

    def send_body(self, answer: Answer) -> None:
        """Do nothing: trackers take no poses."""

    def close(self) -> None:
        """Stop listening."""
        for task in self._tasks:
            task.cancel()
        self._port.close()

    def _sensors(self) -> list[tuple[str, int, Any]]:
        trackers = self.state.trackers.items()
        return [(serial, number, one) for serial, tracker in trackers for number, one in tracker.sensors.items()]

    def _joint(self, serial: str, number: int) -> str | None:
        """Return the joint of a sensor in the table of devices."""
        return self._settings.joints.get(f"{serial}/{number}" if number else serial)

    def _print_serials(self) -> None:
        """Print the serials of new trackers, for the table of devices."""
        for serial, number, sensor in self._sensors():
            name = f"{serial}/{number}" if number else serial
            if name in self._printed or len(self._printed) >= _MAX_PRINTED:
                continue
            self._printed.add(name)
            joint = self._joint(serial, number) or sensor.joint
            where = (
                f"on {joint}"
                if joint
                else 'on nothing yet: name its joint in --device-names, {"' + name + '": "left_knee"}'
            )
            print(f"SlimeVR tracker {name} {where}", flush=True)

    async def _send_heartbeats(self) -> None:
        while True:
            for tracker in self.state.trackers.values():
                self._port.send([heartbeat()], tracker.address)
            await asyncio.sleep(HEARTBEAT_EVERY)

    async def _play(self, live: Live, slot: SessionSlot) -> None:
        loop, sequence = asyncio.get_running_loop(), 0
        while True:
            await asyncio.sleep(1 / FRAME_RATE)
            observation = self.observation(loop.time())
            if observation is not None:
                sequence = (sequence + 1) % 2**32
                live.receive(slot, signal_of(observation, SENSORS, sequence, loop.time()))
