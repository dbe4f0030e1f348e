"""VRChat by OSCQuery, against an independent browser, plain HTTP and a simulated VRChat."""

from __future__ import annotations

import json
import socket
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pythonosc.osc_bundle_builder import OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder
from pythonosc.osc_packet import OscPacket

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply
from bodysense.io.formats.osc import message_bytes
from bodysense.io.formats.unity import unity_euler
from bodysense_live.protocols.driver_axes import ABOUT_Y
from bodysense_live.protocols.oscquery import OscService
from bodysense_live.protocols.vrchat import ACCEPTED_ADDRESSES, VRCHAT_POINTS, VrchatReader
from bodysense_live.protocols.vrchat_link import VrchatLink, VrchatSettings
from bodysense_live.server.messages import Calibrate, Recentre
from bodysense_live.server.metrics import Metrics
from bodysense_live.server.settings import ServerSettings

from ..conftest import Connecting, Serving

SERVICE = OscService("bodysense-1", "127.0.0.1", 9999, ACCEPTED_ADDRESSES)


def pose(part: str, place: tuple[float, ...] = (0.0, 1.6, 0.0), angles: tuple[float, ...] = (0.0, 0.0, 0.0)) -> bytes:
    return message_bytes(f"/tracking/vrsystem/{part}/pose", "ffffff", *place, *angles)


def test_the_tree_has_the_addresses_that_vrchat_looks_for() -> None:
    for target in ("/?HOST_INFO", "/HOST_INFO", "/tracking?HOST_INFO"):
        status, info = SERVICE.answer(target)
        assert status == 200 and info["OSC_PORT"] == 9999 and info["OSC_TRANSPORT"] == "UDP"
    status, node = SERVICE.answer("/tracking/vrsystem")
    assert status == 200 and set(node["CONTENTS"]) == {"head", "leftwrist", "rightwrist"}
    status, leaf = SERVICE.answer("/tracking/vrsystem/head/pose")
    assert leaf["ACCESS"] == 2 and leaf["TYPE"] == "ffffff" and leaf["FULL_PATH"] == "/tracking/vrsystem/head/pose"
    assert SERVICE.answer("/tracking/vrsystem/head/pose?TYPE") == (200, {"TYPE": "ffffff"})
    assert SERVICE.answer("/?VALUE") == (204, None)
    assert SERVICE.answer("/avatar")[0] == 404 and SERVICE.answer("/?COLOUR")[0] == 400


@given(st.text(max_size=40) | st.binary(max_size=40).map(lambda data: data.decode("latin-1")))
def test_any_request_is_answered(target: str) -> None:
    with suppress(ValueError):  # an invalid address; the server answers 400
        status, found = SERVICE.answer(target)
        assert status in (200, 204, 400, 404)
        json.dumps(found)


def test_head_and_wrists_of_vrchat() -> None:
    reader, state = VrchatReader(), VrchatReader().start()
    turn = quaternion_exp(np.array([0.3, -0.8, 0.2]))
    angles = tuple(unity_euler(turn).tolist())
    builder = OscBundleBuilder(1)  # type: ignore[arg-type]
    for part, place in (("head", (0.1, 1.6, 0.2)), ("leftwrist", (-0.3, 1.0, 0.3)), ("rightwrist", (0.3, 1.0, 0.3))):
        message = OscMessageBuilder(f"/tracking/vrsystem/{part}/pose")
        for value in (*place, *angles):
            message.add_arg(float(value))
        builder.add_content(message.build())  # type: ignore[arg-type]
    state, reason = reader.take(builder.build().dgram, 5.0, state)
    observation = reader.observation(5.1, state)
    assert reason is None and observation is not None and observation.points == VRCHAT_POINTS
    np.testing.assert_allclose(observation.position[0, 0], [-0.1, 1.6, 0.2], atol=1e-6)  # mirrored in x = 0
    assert observation.position[0, 1, 0] > 0  # our left hand is at +X
    assert observation.has_rotation.tolist() == [[True, False, False]]
    # A headset's axes are WebXR's: half a turn about +Y from those with +Z forward.
    assert geodesic_angle(observation.rotation[0, 0], quaternion_multiply(turn, ABOUT_Y)) < 1e-6
    assert reader.observation(6.0, state) is None  # silence


def test_malformed_poses_are_refused_with_a_reason() -> None:
    reader = VrchatReader()
    for packet in (
        pose("head", (float("nan"), 0.0, 0.0)),
        pose("head", (1e9, 0.0, 0.0)),
        message_bytes("/tracking/vrsystem/head/pose", "fff", 0.0, 0.0, 0.0),
    ):
        state, reason = reader.take(packet, 0.0, reader.start())
        assert reason and reader.observation(0.0, state) is None
    assert reader.commands(message_bytes("/bodysense/recentre", "")) == [Recentre()]
    assert reader.commands(message_bytes("/bodysense/calibrate", "")) == [Calibrate()]


class Vrchat:
    """A simulated VRChat: announces itself, finds services that accept its tracking, and sends it to them."""

    def __init__(self, zeroconf: Any) -> None:
        self.zeroconf = zeroconf
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.02)
        self.network = zeroconf.Zeroconf(interfaces=["127.0.0.1"])
        self.info = zeroconf.ServiceInfo(
            "_osc._udp.local.",
            "VRChat-Client-1A2B3C._osc._udp.local.",
            self.socket.getsockname()[1],
            addresses=[socket.inet_aton("127.0.0.1")],
            server="VRChat-Client-1A2B3C.local.",
        )

    def announce(self) -> None:
        self.network.register_service(self.info)

    def service(self, kind: str, seconds: float = 10.0) -> Any:
        """Return our service of a type, as an independent browser finds it."""
        names: list[str] = []

        class Listener:
            def add_service(self, zc: Any, type_: str, name: str) -> None:
                names.append(name)

            def update_service(self, *_: Any) -> None: ...

            def remove_service(self, *_: Any) -> None: ...

        browser = self.zeroconf.ServiceBrowser(self.network, kind, Listener())
        until = time.monotonic() + seconds
        try:
            while time.monotonic() < until:
                for name in names:
                    if name.startswith("bodysense-"):
                        return self.network.get_service_info(kind, name)
                time.sleep(0.02)
        finally:
            browser.cancel()
        raise AssertionError("not found")

    def trackers(self) -> set[str]:
        """Return addresses of the messages received since the last call, and within the next second."""
        found, until = set[str](), time.monotonic() + 1
        with suppress(TimeoutError):
            while time.monotonic() < until:
                found |= {one.message.address for one in OscPacket(self.socket.recv(5000)).messages}
        return found


@pytest.fixture
def vrchat() -> Iterator[Vrchat]:
    zeroconf = pytest.importorskip("zeroconf", reason="needs packages/live")
    try:
        found = Vrchat(zeroconf)
    except OSError:
        pytest.skip("no multicast on this machine's loopback")
    with found.socket:
        yield found
        found.network.close()


@pytest.mark.slow
def test_vrchat_and_server_find_each_other_and_a_body_is_returned(
    server_of: Serving, connect: Connecting, vrchat: Vrchat
) -> None:
    server = server_of(ServerSettings(vrchat=VrchatSettings()))
    connect(server, points=(), watch="vrchat")
    web, osc = vrchat.service("_oscjson._tcp.local."), vrchat.service("_osc._udp.local.")
    assert web.name.partition(".")[0] == osc.name.partition(".")[0]  # one name for both
    address = f"http://{web.parsed_addresses()[0]}:{web.port}"
    with urllib.request.urlopen(f"{address}/?HOST_INFO", timeout=5) as answer:
        assert answer.headers["Content-Type"] == "application/json"
        info = json.load(answer)
    assert (info["OSC_IP"], info["OSC_PORT"]) == (osc.parsed_addresses()[0], osc.port)
    with urllib.request.urlopen(f"{address}/", timeout=5) as answer:
        assert "vrsystem" in json.load(answer)["CONTENTS"]["tracking"]["CONTENTS"]
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(f"{address}/nowhere", timeout=5)
    vrchat.announce()
    until, seen = time.monotonic() + 15, set[str]()
    while not seen and time.monotonic() < until:
        for part, x in (("head", 0.0), ("leftwrist", -0.3), ("rightwrist", 0.3)):
            place = (x, 1.6 if part == "head" else 1.0, 0.0 if part == "head" else 0.3)
            vrchat.socket.sendto(pose(part, place), (info["OSC_IP"], info["OSC_PORT"]))
        seen = vrchat.trackers()
    assert {"/tracking/trackers/1/position", "/tracking/trackers/head/rotation"} <= seen


def test_malformed_http_is_answered_or_closed(server_of: Serving, vrchat: Vrchat) -> None:
    server_of(ServerSettings(vrchat=VrchatSettings()))
    web = vrchat.service("_oscjson._tcp.local.")
    for sent in (b"\x00\xff nonsense\r\n\r\n", b"POST / HTTP/1.1\r\nHost: x\r\n\r\n", b"GET /" + 20000 * b"a"):
        address = web.parsed_addresses()[0], web.port
        with socket.create_connection(address, timeout=5) as client, suppress(OSError):
            client.sendall(sent)
            assert client.recv(100).startswith(b"HTTP/1.1 400")


def test_a_missing_zeroconf_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zeroconf", None)
    with pytest.raises(BodysenseError, match="needs the package zeroconf"):
        VrchatLink(VrchatSettings(), Metrics(), VrchatReader(), VRCHAT_POINTS)
