"""The link to VRChat, found by OSCQuery: it sends head and wrists and receives trackers."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
import threading
from dataclasses import dataclass
from functools import partial
from typing import Any

from bodysense.errors import BodysenseError, missing_package
from bodysense_live.protocols.links import DeviceInput, UdpPort, address_toward, host_address
from bodysense_live.protocols.oscquery import OscQueryServer, OscService
from bodysense_live.protocols.vrchat import ACCEPTED_ADDRESSES, ADVISED, PORT, vrchat_packets
from bodysense_live.server.live import Live
from bodysense_live.server.metrics import Metrics
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.tracked_devices import DeviceReader

_HTTP, _OSC = "_oscjson._tcp.local.", "_osc._udp.local."
_VRCHAT = "VRChat-Client"  # prefix of its service names
_RESOLVE_TIMEOUT = 3000  # ms
_ANNOUNCE_TIMEOUT = 5.0  # s


@dataclass(frozen=True)
class VrchatSettings:
    """The address of VRChat, and the trackers that are sent to it."""

    host: str = "127.0.0.1"
    port: int = PORT  # until OSCQuery finds another
    parts: tuple[str, ...] = ADVISED  # parts of the body whose trackers are sent


class VrchatLink:
    """The link to VRChat (`links.Link`). `reader` decodes its packets to a signal of `points`.

    Raises BodysenseError if zeroconf is missing, the host is unknown, or the network allows no discovery.
    """

    def __init__(
        self, settings: VrchatSettings, metrics: Metrics, reader: DeviceReader, points: tuple[str, ...]
    ) -> None:
        self._metrics, self._reader, self._points, self._parts = metrics, reader, points, settings.parts
        self._host = host_address("--vrchat-host", settings.host, "VRChat")
        self._default = self.target = (self._host, settings.port)
        self._here = address_toward(self._host)
        self._port = UdpPort("--vrchat", self._here, 0)
        self._web = socket.create_server((self._here, 0))
        name = f"bodysense-{secrets.token_hex(3)}"
        self.service = OscService(name, self._here, self._port.number, ACCEPTED_ADDRESSES)
        self._query = OscQueryServer(self.service)
        try:
            self._found = _Discovery(self.service, self._web.getsockname()[1], self._host)
        except BodysenseError:
            self._port.close()
            self._web.close()
            raise

    async def open(self, live: Live) -> None:
        """Start to listen, to announce the service and to look for VRChat."""
        device_input = partial(DeviceInput, metrics=self._metrics, reader=self._reader, points=self._points)
        await self._port.add_input(live, "vrchat", self._points, partial(device_input, sender=self._host))
        await self._query.start(self._web)
        loop = asyncio.get_running_loop()

        def found(target: tuple[str, int] | None) -> None:
            self.target = self._default if target is None else target

        self._found.start(lambda target: loop.call_soon_threadsafe(found, target))

    def send_body(self, answer: Answer) -> None:
        """Send the trackers of a body to the VRChat that was found, or to the default address."""
        self._port.send(vrchat_packets(answer.pose, (answer.points, answer.turns), self._parts), self.target)

    def close(self) -> None:
        """Withdraw the announcement and close the sockets."""
        self._found.close()
        self._query.close()
        self._web.close()
        self._port.close()


class _Discovery:
    """Discovery by mDNS: announces a service and looks for VRChat, in threads of zeroconf."""

    def __init__(self, service: OscService, web_port: int, host: str) -> None:
        try:
            import zeroconf
        except ImportError as error:
            raise missing_package(error) from None
        self._host = host
        self._on_target: Any = None
        self._announcing: threading.Thread | None = None
        self._closing = threading.Event()
        self._known: dict[str, tuple[str, int]] = {}  # service name → address, the newest last
        try:
            self._network = zeroconf.Zeroconf(ip_version=zeroconf.IPVersion.V4Only)
        except OSError as error:
            raise BodysenseError(
                f"--vrchat: nothing can be announced in this network ({error.strerror or error}); "
                "leave it out and give VRChat's port with --vrchat-out 127.0.0.1:9000"
            ) from None
        address = socket.inet_aton(service.host)
        self._ours = [
            zeroconf.ServiceInfo(
                kind, f"{service.name}.{kind}", port, addresses=[address], server=f"{service.name}.local."
            )
            for kind, port in ((_HTTP, web_port), (_OSC, service.port))
        ]

    def start(self, on_target: Any) -> None:
        """Start. `on_target` is called, in another thread, with VRChat's OSC address, or None when it is gone."""
        from zeroconf import ServiceBrowser

        self._on_target = on_target
        self._browser = ServiceBrowser(self._network, _OSC, handlers=[self._changed])
        # In a thread, because zeroconf first checks that the name is free.
        self._announcing = threading.Thread(target=self._announce, daemon=True)
        self._announcing.start()

    def close(self) -> None:
        """Withdraw the announcement, after waiting for a running one (about 2 s)."""
        self._closing.set()
        if self._announcing is not None:
            self._announcing.join(_ANNOUNCE_TIMEOUT)
        self._network.close()

    def _announce(self) -> None:
        for one in self._ours:
            if self._closing.is_set():
                return
            with contextlib.suppress(Exception):  # the name is in use; VRChat then cannot find the service
                self._network.register_service(one)

    def _changed(self, zeroconf: Any, service_type: str, name: str, state_change: Any) -> None:
        if not name.startswith(_VRCHAT):
            return
        self._known.pop(name, None)
        if state_change.name != "Removed":
            info: Any = zeroconf.get_service_info(service_type, name, timeout=_RESOLVE_TIMEOUT)
            addresses = [] if info is None else info.parsed_addresses()
            is_here = _is_own(self._host)  # then every address of this machine is near
            near = [one for one in addresses if one == self._host or (is_here and _is_own(one))]
            if info is not None and info.port and near:
                self._known[name] = (near[0], info.port)
        self._on_target(next(reversed(self._known.values()), None))


def _is_own(address: str) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, 0))
        except OSError:
            return False
        return True
